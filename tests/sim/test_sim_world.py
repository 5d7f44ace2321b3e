"""The truth: frames of reference, geometry, time."""

import numpy as np
import pytest

from hypermask_drivers.errors import ConfigError
from hypermask_sim.scenario import Attitude, Scenario
from hypermask_sim.world import FACING, World, rotation_of


def world_of(*changes: str, origin_s: float = 0.0) -> World:
    return World(Scenario().with_changes(list(changes)), origin_s)


def test_at_rest_the_mask_faces_the_camera_upright() -> None:
    rotation, position = world_of().camera_from_mask(0.0)
    assert rotation == pytest.approx(FACING)
    assert position[2] == pytest.approx(1.8)
    points, _ = world_of().led_points(0.0)
    upper_left, upper_right, lower_right, lower_left, label = points
    assert upper_left[0] < upper_right[0] and upper_left[1] < lower_left[1]
    assert lower_left[0] < label[0] < lower_right[0]


@pytest.mark.parametrize("distance", [1.2, 1.8, 2.4])
def test_rest_is_in_the_middle_of_the_projectors_picture(distance: float) -> None:
    world = world_of(f"performer.distance_m={distance}")
    assert world.projector.project(world.rest) == pytest.approx([639.5, 359.5])
    assert world.rest[2] == pytest.approx(distance)


def test_a_rest_position_can_be_given() -> None:
    assert world_of("performer.position_m=[0.1, -0.2, 2.0]").rest.tolist() == [0.1, -0.2, 2.0]


def test_attitude_signs() -> None:
    """Yaw turns the nose to the audience's right, pitch down, roll lifts the right side."""
    nose, right = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    assert (rotation_of(Attitude(yaw=30)) @ nose)[0] > 0.4
    assert (rotation_of(Attitude(pitch=30)) @ nose)[1] < -0.4
    assert (rotation_of(Attitude(roll=30)) @ right)[1] > 0.4


def test_motion_moves_in_the_audiences_axes() -> None:
    """x to the audience's right is the camera's right, y up is its -y, z nearer is its -z."""
    world = world_of("performer.motion=dance")
    _, moved = world.motion.at(np.array([0.7]))
    _, position = world.camera_from_mask(0.7)
    assert position - world.rest == pytest.approx(moved[0] * [1, -1, -1])


def test_the_clock_may_start_anywhere() -> None:
    here = world_of("performer.motion=dance")
    there = world_of("performer.motion=dance", origin_s=5000.0)
    for ours, theirs in zip(
        here.camera_from_mask(2.0), there.camera_from_mask(5002.0), strict=True
    ):
        assert ours == pytest.approx(theirs, abs=1e-9)


def test_the_projector_ray_goes_through_its_pixel() -> None:
    world = world_of("projector.attitude_deg={roll=1, pitch=-2, yaw=3}")
    origin, direction = world.projector.ray([200.0, 500.0])
    assert world.projector.project(origin + 2.1 * direction) == pytest.approx([200, 500])


def test_a_mask_that_would_come_through_the_lens_is_refused() -> None:
    with pytest.raises(ConfigError, match="MOTION-RANGE"):
        world_of("performer.distance_m=0.5", "performer.position_m=[0, 0, 0.32]",
                 "performer.motion=dance")  # fmt: skip


def test_an_unknown_mask_is_refused() -> None:
    with pytest.raises(ConfigError, match="MASK-ABSENT"):
        world_of("mask=unheard-of")
