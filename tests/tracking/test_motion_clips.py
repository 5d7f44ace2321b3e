"""Recorded heads: reading them, and the noise a camera would add."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.geometry import FACING, Pinhole, Pose, rotation_from_vector
from hypermask.tracking.motion_clips import (
    CENTROID_NOISE_PX,
    COLUMNS,
    FOCAL_PX,
    LEDS,
    frame_times,
    measure,
    measurement_covariance,
    read_clip,
    read_clips,
)


def write_clip(path: Path, rows: np.ndarray) -> Path:
    np.savetxt(path, rows, delimiter=",", header=",".join(COLUMNS), comments="")
    return path


def moving(count: int = 60) -> np.ndarray:
    """A head that goes right, up and towards the camera while it turns to the audience's right."""
    t = np.arange(count) / 120
    half = 0.5 * t
    rows = np.column_stack([t, 0.3 * t, 0.2 * t, 0.1 * t, np.cos(half), 0 * t, np.sin(half), 0 * t])
    rows[count // 2 :, 4:] *= -1  # the same rotations
    return rows


def test_axes_are_turned_into_the_camera_frame(tmp_path: Path) -> None:
    clip = read_clip(write_clip(tmp_path / "a.csv", moving()), distance_m=2.0)
    rotations, translations = clip.poses(np.array([0.0, 0.2]))
    np.testing.assert_allclose(rotations[0], FACING, atol=1e-9)
    np.testing.assert_allclose(translations[1], [0.06, -0.04, 2.0 - 0.02], atol=1e-9)
    np.testing.assert_allclose(rotations[1], FACING @ rotation_from_vector([0, 0.2, 0]), atol=1e-6)


def test_interpolation_is_smooth_between_samples_and_over_a_sign_change(tmp_path: Path) -> None:
    clip = read_clip(write_clip(tmp_path / "a.csv", moving()))
    at = np.arange(0.05, 0.4, 0.0007)
    rotations, _ = clip.poses(at)
    expected = [FACING @ rotation_from_vector([0, t, 0]) for t in at]
    np.testing.assert_allclose(rotations, expected, atol=1e-5)


def test_the_covariance_is_that_of_poses_solved_from_noisy_points() -> None:
    pose = Pose(FACING @ rotation_from_vector([0.1, 0.3, 0.5]), np.array([0.2, -0.1, 1.8]))
    camera = Pinhole.from_focal(FOCAL_PX, (0, 0), (1, 1))

    def seen(change: np.ndarray) -> np.ndarray:
        turned = rotation_from_vector(change[:3]) @ pose.rotation
        moved = Pose(turned, pose.translation + change[3:])
        return camera.project(moved.apply(LEDS)).ravel()

    step = 1e-6
    jacobian = np.column_stack(
        [(seen(step * unit) - seen(-step * unit)) / (2 * step) for unit in np.eye(6)]
    )
    expected = np.linalg.inv(jacobian.T @ jacobian) * CENTROID_NOISE_PX**2
    np.testing.assert_allclose(measurement_covariance(pose), expected, rtol=1e-3, atol=1e-12)


def test_measured_poses_scatter_as_their_covariance_says(tmp_path: Path) -> None:
    clip = read_clip(write_clip(tmp_path / "a.csv", moving(600)))
    times = frame_times(clip, 240)
    measured = measure(clip, times, np.random.default_rng(0))
    _, translations = clip.poses(times)
    deviations = np.sqrt(np.diagonal(measured.covariances, axis1=1, axis2=2)[:, 3:])
    scatter = np.std((measured.translations - translations) / deviations, axis=0)
    np.testing.assert_allclose(scatter, 1, atol=0.1)


@pytest.mark.parametrize(
    "damage",
    [
        lambda rows: rows[:2],
        lambda rows: rows[:, :5],
        lambda rows: rows[::-1],
        lambda rows: np.where(rows == rows[5, 1], np.nan, rows),
    ],
    ids=["two rows", "five columns", "time runs back", "a value missing"],
)
def test_an_unusable_clip_is_one_clear_error(tmp_path: Path, damage: object) -> None:
    assert callable(damage)
    with pytest.raises(DataError, match=r"MOTION-CLIP.*a\.csv"):
        read_clip(write_clip(tmp_path / "a.csv", damage(moving())))


def test_no_clips_are_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="MOTION-CLIP"):
        read_clips(tmp_path)
    (tmp_path / "a.csv").write_text("not a clip\n")
    with pytest.raises(DataError, match="MOTION-CLIP"):
        read_clips(tmp_path)
