"""The camera's pictures against the truth they are made from."""

import numpy as np
import pytest
from numpy.typing import NDArray

from hypermask_drivers.mask import LED_NAMES
from hypermask_sim.optics import (
    Horizon,
    Sensor,
    Spots,
    angular_fall_off,
    exposure_moments,
    patches_of,
)
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World

Array = NDArray[np.float64]


def one_spot(x: float, y: float, peak: float = 150.0, size: float = 1.2) -> Spots:
    return Spots(np.array([[[x, y]]]), np.ones(1), np.array([peak]), np.array([size]))


def centroid(image: NDArray[np.uint8], x: float, y: float, level: float, reach: int = 7) -> Array:
    """Intensity centroid (x, y) over the background `level` in a window about (x, y)."""
    left, top = round(x) - reach, round(y) - reach
    window = image[top : top + 2 * reach + 1, left : left + 2 * reach + 1].astype(float) - level
    rows, columns = np.mgrid[: window.shape[0], : window.shape[1]]
    moments = np.array([(window * columns).sum(), (window * rows).sum()])
    place: Array = moments / window.sum() + [left, top]
    return place


def test_a_spot_is_where_it_was_put_to_a_hundredth_of_a_pixel() -> None:
    """Over all sub-pixel places, noise-free; the rest is the rounding to whole grey levels."""
    sensor = Sensor((64, 64), ambient=0, noise=0, seed=1)
    errors = []
    for index, (x, y) in enumerate(np.random.default_rng(3).uniform(20, 44, (200, 2))):
        image = sensor.expose(one_spot(x, y), 0.0, index)
        errors.append(centroid(image, x, y, image[:8].mean()) - [x, y])
    assert np.abs(np.mean(errors, axis=0)).max() < 0.003
    assert np.std(errors, axis=0).max() < 0.02


def test_led_centroids_are_unbiased_in_the_reference_picture() -> None:
    """Mean over many noisy frames and places: under 0.02 px from the true projection."""
    settings = ["performer.attitude_deg.yaw=20", "performer.attitude_deg.roll=35"]
    world = World(Scenario().with_changes(settings))
    camera = world.scenario.camera
    sensor = Sensor(world.camera.size, camera.ambient, camera.read_noise, 1)
    points, visible = world.led_points(0.0)
    assert visible.all()
    spots = world.spots(0.0, 1e-3)
    errors = []
    for sequence in range(150):
        image = sensor.expose(spots, 0.0, sequence)
        errors.append([centroid(image, x, y, camera.ambient, 4) - (x, y) for x, y in points])
    assert np.abs(np.mean(errors, axis=0)).max() < 0.02


def test_a_moving_led_is_smeared_about_its_place_at_mid_exposure() -> None:
    settings = ["performer.motion=sway", "performer.speed=4", "camera.exposure_ms=4"]
    world = World(Scenario().with_changes(settings))
    points, _ = world.led_points(0.05)
    still = World(Scenario()).spots(0.05, 4e-3)
    moving = world.spots(0.05, 4e-3)
    assert moving is not None and still is not None
    assert np.ptp(moving.points[0, :, 0]) > 3
    middle = np.einsum("nmk,m->nk", moving.points, moving.weights)
    assert middle == pytest.approx(points, abs=0.02)
    assert patches_of(moving)[0].max() < 0.9 * patches_of(still)[0].max()


def test_the_light_of_a_spot_does_not_depend_on_its_smear() -> None:
    offsets, weights = exposure_moments(5e-3)
    line = np.stack([30 + 1000 * offsets, 30 + 0 * offsets], axis=1)[None]
    smeared = Spots(line, weights, np.array([100.0]), np.array([1.2]))
    total = patches_of(one_spot(30, 30, 100.0))[0].sum()
    assert patches_of(smeared)[0].sum() == pytest.approx(total, rel=1e-3)


def test_bright_light_saturates_and_does_not_wrap_round() -> None:
    sensor = Sensor((64, 64), ambient=20, noise=2, seed=1)
    image = sensor.expose(one_spot(30, 30, 2000.0), 0.0, 0)
    assert image[30, 30] == 255 and image[29:32, 28:33].min() == 255


def test_spots_at_the_rim_are_cut_off() -> None:
    sensor = Sensor((64, 48), ambient=0, noise=0, seed=1)
    for x, y in [(0, 0), (63, 47), (-3, 20), (30, 50), (500, 20), (-1e9, 1e9)]:
        image = sensor.expose(one_spot(x, y), 0.0, 0)
        assert image.shape == (48, 64)
    assert image.max() <= 1
    assert sensor.expose(one_spot(0, 0), 0.0, 0)[0, 0] > 100


def test_read_noise_and_ambient_are_as_stated_and_new_in_each_frame() -> None:
    sensor = Sensor((640, 480), ambient=12, noise=2.0, seed=5)
    first = sensor.expose(None, 0.0, 1).astype(float)
    second = sensor.expose(None, 0.0, 2).astype(float)
    assert first.mean() == pytest.approx(12, abs=0.05)
    assert first.std() == pytest.approx(2.0, abs=0.1)
    assert (first - second).std() == pytest.approx(2.0 * 2**0.5, abs=0.1)


def test_the_same_frame_comes_out_the_same() -> None:
    spots = World(Scenario()).spots(0.0, 1e-3)
    one, other = (Sensor((1280, 800), 8, 2, 7) for _ in range(2))
    other.expose(None, 0.0, 3)
    assert np.array_equal(one.expose(spots, 0.0, 9), other.expose(spots, 0.0, 9))


def test_a_flash_brightens_the_whole_frame() -> None:
    sensor = Sensor((64, 48), ambient=8, noise=1, seed=1)
    assert sensor.expose(None, 255.0, 0).min() == 255
    assert sensor.expose(None, 50.0, 0).mean() == pytest.approx(58, abs=1)


def test_leds_get_dimmer_with_angle() -> None:
    cosines = np.cos(np.radians([0.0, 30.0, 60.0, 90.0, 120.0]))
    fall = angular_fall_off(cosines, 60.0)
    assert fall[0] == 1.0 and fall[2] == pytest.approx(0.5)
    assert fall[3:] == pytest.approx(0, abs=1e-12)
    assert np.all(np.diff(fall) <= 0)


def test_leds_get_dimmer_with_distance() -> None:
    peaks = {}
    for distance in (1.2, 1.8, 2.4):
        world = World(Scenario().still(distance))
        spots = world.spots(0.0, 1e-3)
        assert spots is not None
        peaks[distance] = float((spots.peaks * spots.sizes**2).max())
    assert peaks[1.8] / peaks[2.4] == pytest.approx((2.4 / 1.8) ** 2, rel=0.02)
    assert peaks[1.2] / peaks[1.8] == pytest.approx((1.8 / 1.2) ** 2, rel=0.02)


def test_longer_exposure_is_brighter() -> None:
    world = World(Scenario())
    short, long = world.spots(0.0, 0.5e-3), world.spots(0.0, 1e-3)
    assert short is not None and long is not None
    assert long.peaks == pytest.approx(2 * short.peaks, rel=1e-6)


@pytest.mark.parametrize("roll", range(0, 360, 45))
@pytest.mark.parametrize(("pitch", "yaw"), [(20, 30), (-20, -30), (20, -30), (-20, 30)])
@pytest.mark.parametrize("distance", [1.2, 2.4])
def test_all_leds_are_seen_over_the_working_range(
    roll: float, pitch: float, yaw: float, distance: float
) -> None:
    attitude = f"performer.attitude_deg={{roll={roll}, pitch={pitch}, yaw={yaw}}}"
    changes = [attitude, f"performer.distance_m={distance}"]
    _, visible = World(Scenario().with_changes(changes)).led_points(0.0)
    assert visible.all()


def test_the_nose_hides_a_led_seen_low_across_it() -> None:
    """From the lower left LED the nose tip, 32 mm high and 119 mm away, stands 15 degrees high."""
    mask = World(Scenario()).mask
    horizon = Horizon(mask)
    lower_left = LED_NAMES.index("lower_left")
    across = np.array([0.0, -0.022]) - mask.leds[lower_left, :2]

    def clear(elevation_deg: float) -> bool:
        rise = np.hypot(*across) * np.tan(np.radians(elevation_deg))
        return bool(horizon.clear(np.tile([*across, rise], (5, 1)))[lower_left])

    assert not clear(10) and clear(20)


def test_a_mask_turned_far_away_shows_the_near_leds_only() -> None:
    world = World(Scenario().with_changes(["performer.attitude_deg.yaw=85"]))
    visible = dict(zip(LED_NAMES, world.led_points(0.0)[1].tolist(), strict=True))
    assert visible["upper_left"] and visible["lower_left"]
    assert not visible["upper_right"] and not visible["lower_right"]


def test_a_mask_seen_from_behind_shows_nothing() -> None:
    changes = ["performer.attitude_deg.yaw=90", "performer.position_m=[1.2, 0, 1.8]"]
    assert not World(Scenario().with_changes(changes)).led_points(0.0)[1].any()


def test_the_mask_hides_reflections_behind_it_only() -> None:
    def count(position: list[float]) -> int:
        reflection = {"position_m": position}
        scenario = Scenario.model_validate({"reflections": [reflection]})
        spots = World(scenario).spots(0.0, 1e-3)
        assert spots is not None
        return len(spots.points) - 5

    rest = World(Scenario()).rest
    assert count((rest * 1.5).tolist()) == 0
    assert count((rest * 0.8).tolist()) == 1
    assert count((rest * 1.5 + [0.5, 0, 0]).tolist()) == 1
