"""The audience sees the light where it truly falls."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from hypermask_drivers.errors import DeviceError
from hypermask_drivers.mask import Mask, load_mask
from hypermask_sim.audience import CURTAIN_BEHIND_M, STAGE_FROM_CAMERA, Audience, lit_window

CONFIGS = Path(__file__).parents[2] / "configs"
Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
BLACK = np.zeros((720, 1280, 3), np.uint8)


@dataclass(frozen=True)
class Optics:
    K: Array = field(
        default_factory=lambda: np.array([[1920.0, 0, 639.5], [0, 1920.0, 719.5], [0, 0, 1]])
    )
    R: Array = field(default_factory=lambda: np.eye(3))
    t: Array = field(default_factory=lambda: np.array([-0.15, 0.0, 0.0]))
    size: tuple[int, int] = (1280, 720)

    def project(self, point: Array) -> Array:
        image = self.K @ (self.R @ point + self.t)
        return np.asarray(image[:2] / image[2])


@dataclass
class World:
    """A mask that moves to the right at 0.5 m/s and may be turned or put aside at once."""

    mask: Mask
    rest: Array = field(default_factory=lambda: np.array([0.15, -0.34, 1.8]))
    aside: Array = field(default_factory=lambda: np.zeros(3))
    rotation: Array = field(default_factory=lambda: np.diag([1.0, -1.0, -1.0]))
    projector: Optics = field(default_factory=Optics)

    def camera_from_mask(self, time_s: float) -> tuple[Array, Array]:
        return self.rotation, self.rest + self.aside + np.array([0.5, 0, 0]) * time_s

    def camera_from_masks(self, times_s: Array) -> tuple[Array, Array]:
        count = len(times_s)
        return np.repeat(self.rotation[None], count, 0), np.repeat(self.rest[None], count, 0)

    def surface(self, x: float, y: float) -> Array:
        """A point of the mask in the camera frame."""
        point = self.rotation @ np.array([x, y, float(self.mask.height(x, y))])
        return np.asarray(point + self.rest + self.aside)


@pytest.fixture(scope="module")
def context() -> Iterator[moderngl.Context]:
    gles = pytest.importorskip("hypermask_drivers.projector.gles")
    try:
        made = gles.create_context()
    except DeviceError as error:
        pytest.skip(str(error))
    yield made
    made.release()


@pytest.fixture
def world() -> World:
    return World(load_mask(CONFIGS / "masks/reference"))


@pytest.fixture
def audience(context: moderngl.Context, world: World) -> Iterator[Audience]:
    view = Audience(context, world)
    yield view
    view.close()


def spot(
    world: World, x: float, y: float, colour: tuple[int, int, int] = (255, 255, 255)
) -> Picture:
    """A picture whose light falls on the mask's point (x, y)."""
    picture = BLACK.copy()
    column, row = np.round(world.projector.project(world.surface(x, y)) * 16).astype(int)
    cv2.circle(picture, (int(column), int(row)), 6 * 16, colour, -1, cv2.LINE_AA, 4)
    return picture


def seen_at(audience: Audience, world: World, x: float, y: float) -> Array:
    """Where in the view the mask's point (x, y) must appear, by the view's own camera."""
    return in_view(audience, world.surface(x, y))


def in_view(audience: Audience, point: Array) -> Array:
    """View pixel of a point in the camera frame."""
    view, _ = audience._view(0.0)
    clip = audience._lens() @ view @ np.append(STAGE_FROM_CAMERA @ point, 1)
    return np.asarray((clip[:2] / clip[3] + 1) / 2 * [960, 720] - 0.5)


def gain(audience: Audience, picture: Picture) -> Array:
    """What the picture's light adds to the view, (h, w) grey levels of the brightest channel."""
    with_light = audience.render(picture, 0.0).astype(int)
    return np.asarray((with_light - audience.render(BLACK, 0.0)).max(axis=2), float)


@pytest.mark.parametrize("point", [(0.0, -0.017), (0.05, 0.08), (-0.06, -0.09), (-0.06, 0.05)])
def test_light_is_seen_on_the_point_it_was_sent_to(
    audience: Audience, world: World, point: tuple[float, float]
) -> None:
    light = gain(audience, spot(world, *point))
    rows, columns = np.nonzero(light > 40)
    expected = seen_at(audience, world, *point)
    assert (columns.mean(), rows.mean()) == pytest.approx(tuple(expected), abs=1.5)


def test_light_that_comes_late_is_seen_beside_its_point(audience: Audience, world: World) -> None:
    picture = spot(world, 0.0, 0.08)
    late = audience.render(picture, 0.1).astype(int) - audience.render(BLACK, 0.1)
    rows, columns = np.nonzero(late.max(axis=2) > 40)
    # The mask has gone 50 mm to the right meanwhile; the light still falls where it was.
    expected = seen_at(audience, world, 0.0, 0.08)
    assert (columns.mean(), rows.mean()) == pytest.approx(tuple(expected), abs=6)
    on_point = audience.render(BLACK, 0.1)
    assert not np.array_equal(on_point, audience.render(BLACK, 0.0))


def test_a_turned_mask_is_lit_where_it_is_now(audience: Audience, world: World) -> None:
    yaw = cv2.Rodrigues(np.array([0, 0.4, 0.0]))[0]
    world.rotation = world.rotation @ np.asarray(yaw)
    light = gain(audience, spot(world, 0.05, -0.08))
    rows, columns = np.nonzero(light > 40)
    expected = seen_at(audience, world, 0.05, -0.08)
    assert (columns.mean(), rows.mean()) == pytest.approx(tuple(expected), abs=1.5)


def test_light_that_misses_falls_dimly_on_what_is_behind(audience: Audience, world: World) -> None:
    on_mask = gain(audience, spot(world, 0.0, 0.08)).max()
    picture = spot(world, 0.0, 0.08)
    world.aside = np.array([-0.4, 0.0, 0.0])
    missed = gain(audience, picture).max()
    assert 3 < missed < on_mask / 3


def test_the_mask_throws_its_shadow_on_the_curtain(audience: Audience, world: World) -> None:
    light = gain(audience, np.full_like(BLACK, 255))
    column, row = seen_at(audience, world, 0.0, 0.08).astype(int)
    assert light[row, column] > 120

    def on_curtain(x: float, y: float) -> float:
        """Light where a ray past the mask's point (x, y) meets the curtain."""
        lamp = -world.projector.t
        way = world.surface(x, y) - lamp
        there = lamp + way * ((world.rest[2] + CURTAIN_BEHIND_M) / way[2])
        column, row = np.round(in_view(audience, there)).astype(int)
        return float(light[row, column])

    assert on_curtain(0.05, 0.02) <= 1
    assert on_curtain(0.09, -0.02) <= 1
    assert on_curtain(0.16, 0.02) > 5


def test_the_white_mask_is_seen_without_light_but_dimly(audience: Audience, world: World) -> None:
    view = audience.render(BLACK, 0.0)
    column, row = seen_at(audience, world, 0.0, 0.08).astype(int)
    forehead = view[row, column].max()
    assert 30 < forehead < 110
    assert view[-20, column].max() < forehead / 2  # dark clothes
    assert view.shape == (720, 960, 3) and view.dtype == np.uint8


def test_the_mask_fills_a_good_part_of_the_view(audience: Audience, world: World) -> None:
    top, bottom = seen_at(audience, world, 0, 0.135), seen_at(audience, world, 0, -0.135)
    assert 0.4 < (bottom[1] - top[1]) / 720 < 0.7
    left, right = seen_at(audience, world, -0.098, 0), seen_at(audience, world, 0.098, 0)
    assert 100 < left[0] < right[0] < 860


def test_old_light_does_not_stay_in_the_picture(audience: Audience, world: World) -> None:
    before = audience.render(BLACK, 0.0)
    audience.render(np.full_like(BLACK, 255), 0.0)
    audience.render(spot(world, 0.05, 0.08), 0.0)
    np.testing.assert_array_equal(audience.render(BLACK, 0.0), before)


def test_the_same_moment_gives_the_same_view(audience: Audience, world: World) -> None:
    picture = spot(world, 0.0, -0.017, (255, 120, 30))
    first = audience.render(picture, 0.0)
    np.testing.assert_array_equal(audience.render(picture, 0.0), first)


def test_a_mask_turned_away_or_out_of_the_beam_is_drawn(audience: Audience, world: World) -> None:
    world.rotation = world.rotation @ np.diag([-1.0, 1.0, -1.0])
    assert audience.render(np.full_like(BLACK, 255), 0.0).any()
    world.aside = np.array([0.0, 0.0, -1.75])
    assert audience.render(np.full_like(BLACK, 255), 0.0).any()


def test_lit_window() -> None:
    picture = BLACK.copy()
    assert lit_window(picture) is None
    picture[100:110, 200:240, 1] = 50
    assert lit_window(picture) == (200, 100, 240, 110)
