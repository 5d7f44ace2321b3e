"""Which blob is which LED, under any roll and among reflections."""

from __future__ import annotations

import numpy as np
import pytest
from led_frames import CAMERA, LEDS, camera_from_mask

from hypermask.geometry import Pose, rotation_from_vector
from hypermask.tracking.labels import LabelSettings, label_blobs, weak_perspective

SETTINGS = LabelSettings()


def random_view(rng, distance=(1.2, 2.4), pitch=20.0, yaw=30.0) -> tuple[Pose, np.ndarray]:
    """A pose with all LEDs in the picture, and their points."""
    while True:
        z = rng.uniform(*distance)
        pose = camera_from_mask(
            rng.uniform(-0.45, 0.45) * z,
            rng.uniform(-0.25, 0.25) * z,
            z,
            rng.uniform(0, 360),
            rng.uniform(-pitch, pitch),
            rng.uniform(-yaw, yaw),
        )
        points = CAMERA.project(pose.apply(LEDS))
        facing = -pose.rotation[:, 2] @ pose.translation / np.linalg.norm(pose.translation)
        if points.min() > 5 and (points.max(0) < [1274, 794]).all() and facing > np.cos(1.13):
            return pose, points + rng.normal(0, 0.05, points.shape)


def shuffled(rng, points: np.ndarray, extra: int) -> tuple[np.ndarray, np.ndarray]:
    """The points among `extra` others, a third of them close by; and where each LED went."""
    clutter = rng.uniform([0, 0], [1280, 800], (extra, 2))
    clutter[: extra // 3] = points.mean(0) + rng.uniform(-150, 150, (extra // 3, 2))
    everything = np.concatenate([points, clutter])
    order = rng.permutation(len(everything))
    return everything[order], np.argsort(order)[: len(points)]


@pytest.mark.parametrize("extra", [0, 6, 16, 25])
def test_every_view_of_the_working_range_is_labelled_right(extra: int) -> None:
    rng = np.random.default_rng(extra)
    for _ in range(150):
        _, points = random_view(rng)
        blobs, truth = shuffled(rng, points, extra)
        found = label_blobs(blobs, LEDS, CAMERA, SETTINGS)
        assert found is not None
        assert found.blobs.tolist() == truth.tolist()


def test_beyond_the_working_range_labels_are_right_too() -> None:
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(200):
        _, points = random_view(rng, distance=(0.8, 3.5), pitch=35.0, yaw=45.0)
        blobs, truth = shuffled(rng, points, 6)
        labelling = label_blobs(blobs, LEDS, CAMERA, SETTINGS)
        found += labelling is not None
        assert labelling is None or labelling.blobs.tolist() == truth.tolist()
    assert found >= 196


def test_the_pose_of_a_labelling_is_the_masks() -> None:
    pose, points = random_view(np.random.default_rng(6))
    found = label_blobs(points, LEDS, CAMERA, SETTINGS)
    assert found is not None
    assert np.allclose(found.pose.translation, pose.translation, atol=0.005)
    assert np.allclose(found.pose.rotation, pose.rotation, atol=0.02)


@pytest.mark.parametrize("hidden", [0, 1, 2, 3])
def test_with_one_corner_hidden_the_other_four_are_enough(hidden: int) -> None:
    """Now and then they can be read in two ways: then the tracker waits for another frame."""
    rng = np.random.default_rng(20 + hidden)
    labelled = 0
    for _ in range(50):
        _, points = random_view(rng)
        found = label_blobs(np.delete(points, hidden, axis=0), LEDS, CAMERA, SETTINGS)
        labelled += found is not None
        truth = np.insert(np.arange(4), hidden, -1)
        assert found is None or found.blobs.tolist() == truth.tolist()
    assert labelled >= 47


def test_four_corners_alone_are_the_mask_only_after_a_recent_pose() -> None:
    rng = np.random.default_rng(30)
    labelled = 0
    for _ in range(40):
        pose, points = random_view(rng)
        recent = Pose(
            rotation_from_vector(rng.normal(0, 0.1, 3)) @ pose.rotation,
            pose.translation + rng.normal(0, 0.05, 3),
        )
        assert label_blobs(points[:4], LEDS, CAMERA, SETTINGS) is None
        found = label_blobs(points[:4], LEDS, CAMERA, SETTINGS, recent)
        labelled += found is not None
        assert found is None or found.blobs.tolist() == [0, 1, 2, 3, -1]
    assert labelled >= 36


@pytest.mark.parametrize("count", [0, 3, 5, 8, 16, 30])
def test_reflections_alone_are_not_a_mask(count: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(100):
        blobs = rng.uniform([100, 100], [1180, 700], (count, 2))
        assert label_blobs(blobs, LEDS, CAMERA, SETTINGS) is None


def test_one_of_the_two_weak_perspective_poses_is_close_to_the_true_one() -> None:
    rng = np.random.default_rng(40)
    for _ in range(50):
        pose, points = random_view(rng, distance=(2.0, 2.4))
        rotation, translation = weak_perspective(points[None, :4], LEDS, CAMERA)
        turn = np.linalg.norm(rotation - pose.rotation, axis=(1, 2))
        assert turn.min() < 0.25
        assert np.linalg.norm(translation - pose.translation, axis=1).min() < 0.15
