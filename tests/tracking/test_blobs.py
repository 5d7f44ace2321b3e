"""LEDs are found to a few hundredths of a pixel, whatever else is bright."""

from __future__ import annotations

import numpy as np
import pytest
from led_frames import draw

from hypermask.tracking.blobs import BlobSettings, find_blobs, find_blobs_in

MANY = BlobSettings(max_blobs=200)
GRID = np.stack(np.meshgrid(np.arange(80, 1240, 90), np.arange(80, 760, 90)), -1).reshape(-1, 2)


def scattered(seed: int) -> np.ndarray:
    return GRID + np.random.default_rng(seed).uniform(-0.5, 0.5, GRID.shape)


def nearest(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Offset (n, 2) of the found point nearest to each wanted one."""
    away = np.linalg.norm(found[:, None] - wanted, axis=2)
    return found[away.argmin(axis=0)] - wanted


def windows(points: np.ndarray, half: int = 9) -> np.ndarray:
    corner = np.rint(points).astype(np.int64)
    return np.concatenate([corner - half, corner + half + 1], axis=1)


def look(image: np.ndarray, points: np.ndarray, peak: float, width: float = 1.4):
    count = len(points)
    return find_blobs_in(image, windows(points), np.full(count, peak), np.full(count, width), MANY)


@pytest.mark.parametrize("peak", [40.0, 80.0, 160.0, 230.0])
@pytest.mark.parametrize("width", [1.0, 1.4, 2.0])
def test_centroids_are_good_to_a_twentieth_of_a_pixel(peak: float, width: float) -> None:
    points = scattered(1)
    image = draw(points, peak, width, rng=np.random.default_rng(2))
    for found in (find_blobs(image, MANY), look(image, points, peak, width)[0]):
        error = nearest(found.points, points)
        assert len(found.points) == len(points)
        assert np.sqrt((error**2).mean()) < 0.05


def test_the_stated_uncertainty_covers_the_error() -> None:
    points = scattered(3)
    for peak in (30.0, 60.0, 150.0):
        image = draw(points, peak, rng=np.random.default_rng(4))
        found, _ = look(image, points, peak)
        error = nearest(found.points, points)
        assert np.sqrt((error**2).mean()) < 1.3 * np.median(found.sigmas) < 0.12


def test_a_saturated_led_keeps_its_centre() -> None:
    points = scattered(5)
    image = draw(points, 700.0, rng=np.random.default_rng(6))
    error = nearest(look(image, points, 240.0)[0].points, points)
    assert np.sqrt((error**2).mean()) < 0.05


def test_a_brighter_neighbour_does_not_pull_an_led() -> None:
    points = scattered(7)
    angle = np.random.default_rng(8).uniform(0, 2 * np.pi, len(points))
    others = points + 7.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    peaks = np.repeat([140.0, 220.0], len(points))
    image = draw(np.concatenate([points, others]), peaks, rng=np.random.default_rng(9))
    error = np.linalg.norm(nearest(look(image, points, 140.0)[0].points, points), axis=1)
    assert np.percentile(error, 90) < 0.1


def test_a_blob_that_two_leds_make_together_is_trusted_less() -> None:
    points = scattered(10)
    peaks = np.repeat([150.0, 150.0], len(points))
    image = draw(
        np.concatenate([points, points + np.array([3.0, 0.0])]),
        peaks,
        rng=np.random.default_rng(11),
    )
    alone = look(draw(points, 150.0, rng=np.random.default_rng(11)), points, 150.0)[0]
    merged = look(image, points, 150.0)[0]
    assert np.median(merged.sigmas) > 5 * np.median(alone.sigmas)


def test_a_dim_led_is_seen_beside_a_bright_reflection_in_its_window() -> None:
    points = np.array([[600.3, 400.2]])
    image = draw(
        np.array([[600.3, 400.2], [608.0, 405.0]]), [35.0, 240.0], rng=np.random.default_rng(12)
    )
    found, owners = look(image, points, 35.0)
    assert set(owners.tolist()) == {0}
    assert np.linalg.norm(found.points - points, axis=1).min() < 0.3


def test_windows_do_not_report_what_lies_outside_them() -> None:
    image = draw(np.array([[300.0, 300.0], [700.0, 500.0]]), rng=np.random.default_rng(13))
    found, owners = look(image, np.array([[300.0, 300.0], [500.0, 500.0]]), 160.0)
    assert owners.tolist() == [0]
    assert np.allclose(found.points, [[300.0, 300.0]], atol=0.1)


def test_an_led_cut_by_the_edge_of_the_frame_is_not_reported() -> None:
    image = draw(np.array([[0.5, 300.0], [1279.0, 400.0], [640.0, 0.0], [640.0, 400.0]]))
    found = find_blobs(image, MANY)
    assert np.allclose(found.points, [[640.0, 400.0]], atol=0.05)


LEDS = np.array([[600.2, 300.7], [680.4, 300.1], [680.9, 410.3], [600.6, 410.8], [640.5, 366.2]])
ROWS, COLUMNS = np.mgrid[:800, :1280].astype(np.float32)
LIGHT = {
    "flash over the whole frame": np.full((800, 1280), 110.0, np.float32),
    "sun from one side": 10 + 140 * COLUMNS / 1280,
    "lamp in the picture": 10 + 245 * (np.hypot(COLUMNS - 1000, ROWS - 200) < 100),
    "sun through blinds": 10 + 120 * ((COLUMNS // 90) % 2),
}


@pytest.mark.parametrize("name", list(LIGHT))
def test_leds_are_found_in_bad_light(name: str) -> None:
    image = draw(LEDS, 140.0, rng=np.random.default_rng(14), into=LIGHT[name].astype(np.float32))
    error = np.linalg.norm(nearest(find_blobs(image, BlobSettings()).points, LEDS), axis=1)
    assert error.max() < 0.1


def test_hot_pixels_do_not_crowd_out_the_leds() -> None:
    rng = np.random.default_rng(16)
    scene = np.full((800, 1280), 10, np.float32)
    scene[rng.integers(430, 800, 1500), rng.integers(0, 1280, 1500)] = 255
    image = draw(LEDS, 140.0, rng=rng, into=scene)
    found = find_blobs(image, BlobSettings(max_blobs=200)).points
    assert np.linalg.norm(nearest(found, LEDS), axis=1).max() < 0.1


def test_glare_and_dirt_give_few_blobs_or_none() -> None:
    """A bad threshold must not eat the CPU: what costs is the number of blobs."""
    rng = np.random.default_rng(15)
    spots = rng.uniform([0, 0], [1280, 800], (3000, 2))
    noise = np.clip(10 + 60 * rng.standard_normal((800, 1280)), 0, 255).astype(np.uint8)
    white = np.full((800, 1280), 255, np.uint8)
    for image in (draw(spots, rng=rng), noise, white, np.zeros((800, 1280), np.uint8)):
        assert len(find_blobs(image, BlobSettings()).points) <= BlobSettings().max_blobs
