"""Rays meet the relief exactly, and at the first place they can."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hypermask_drivers.mask import load_mask
from hypermask_sim.surface import Surface

MASK = load_mask(Path(__file__).parents[2] / "configs/masks/reference")


@pytest.fixture(scope="module")
def surface() -> Surface:
    return Surface(MASK)


def test_heights_are_those_of_the_relief(surface: Surface) -> None:
    half_width, half_height = MASK.half_size_m
    assert surface.height(-half_width, half_height) == pytest.approx(MASK.relief[0, 0])
    assert surface.height(half_width, -half_height) == pytest.approx(MASK.relief[-1, -1])
    middle = MASK.relief[145:147, 110:112].mean()
    assert surface.height(0.0005, -0.0005) == pytest.approx(middle, abs=1e-9)
    x, y = np.random.default_rng(2).uniform(-0.1, 0.1, (2, 500))
    assert np.abs(surface.height(x, y) - MASK.height(x, y)).max() < 6e-5


def test_slopes_are_the_derivatives(surface: Surface) -> None:
    x, y = np.random.default_rng(3).uniform(-0.1, 0.1, (2, 200))
    x, y = np.floor(x * 1e3) * 1e-3 + 4e-4, np.floor(y * 1e3) * 1e-3 + 3e-4
    step = 1e-5
    along = (surface.height(x + step, y) - surface.height(x - step, y)) / (2 * step)
    up = (surface.height(x, y + step) - surface.height(x, y - step)) / (2 * step)
    np.testing.assert_allclose(surface.slope(x, y), np.stack([along, up], -1), atol=1e-6)


def test_rays_meet_the_surface_to_a_micrometre(surface: Surface) -> None:
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-0.09, 0.09, (2, 500))
    for origin in ([0.0, 0.0, 1.2], [0.9, 0.5, 1.5], [-1.0, -0.6, 1.2]):
        centre = np.array(origin)
        through = np.stack([x, y, np.full(500, 0.01)], -1)
        hits = surface.meet(centre, through - centre)
        assert np.abs(hits[:, 2] - surface.height(hits[:, 0], hits[:, 1])).max() < 1e-6
        beside = np.cross(hits - centre, through - centre)
        assert np.abs(beside).max() < 1e-9


def test_the_nearest_of_several_crossings_is_taken(surface: Surface) -> None:
    # From the far right a ray to the left cheek beside the nose is stopped by the nose.
    centre = np.array([1.0, -0.02, 0.35])
    target = np.array([-0.02, -0.02, float(surface.height(-0.02, -0.02))])
    hit = surface.meet(centre, (target - centre)[None])[0]
    assert hit[0] > 0
    assert hit[2] > target[2] + 0.002


def test_a_ray_that_runs_away_meets_nothing(surface: Surface) -> None:
    away = surface.meet(np.array([0.0, 0, 1]), np.array([[0.0, 0, 1], [1.0, 0, 0], [0, 0, -1.0]]))
    assert np.isnan(away[:2]).all()
    assert np.isfinite(away[2]).all()
