"""Recorded heads as truth, and the poses a camera would have measured of them.

Clips are CSV files `t_s, x_m, y_m, z_m, qw, qx, qy, qz` in axes x to the audience's right, y up,
z towards the camera, relative to a resting place at some working distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hypermask.errors import DataError
from hypermask.geometry import FACING, Array, Pose, rotation_from_vector

COLUMNS = ("t_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
DISTANCE_M = 1.8
LEDS = np.array(
    [[-0.08, 0.11, 0], [0.08, 0.11, 0], [0.08, -0.11, 0], [-0.08, -0.11, 0], [0, -0.022, 0.04]]
)
FOCAL_PX = 900.0
CENTROID_NOISE_PX = 0.04  # FACTS: 0.03 to 0.05 px


@dataclass(frozen=True)
class Clip:
    """A head's motion in the camera frame: positions (n, 3) metres, quaternions (n, 4) w first."""

    name: str
    times: Array
    positions: Array
    quaternions: Array

    @property
    def duration_s(self) -> float:
        return float(self.times[-1])

    def poses(self, times_s: Array) -> tuple[Array, Array]:
        """Rotations (k, 3, 3) and translations (k, 3), camera_from_mask, at times (k,)."""
        quaternions = _cubic(self.times, self.quaternions, times_s)
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        rotations = FACING @ _rotations(quaternions)
        return rotations, _cubic(self.times, self.positions, times_s)


@dataclass(frozen=True)
class Measured:
    """Poses measured at `times` (n,): rotations (n, 3, 3), translations, covariances (n, 6, 6)."""

    times: Array
    rotations: Array
    translations: Array
    covariances: Array

    def pose(self, index: int) -> Pose:
        return Pose(self.rotations[index], self.translations[index])


def read_clip(path: Path, distance_m: float = DISTANCE_M) -> Clip:
    """Raises `DataError` MOTION-CLIP if the file is no motion clip."""
    try:
        header, *lines = path.read_text("utf-8").splitlines() or [""]
        if tuple(header.strip().split(",")) != COLUMNS or len(lines) < 4:
            raise ValueError("its columns are not a motion clip's")
        rows = np.loadtxt(lines, delimiter=",", ndmin=2)
        if rows.shape[1] != len(COLUMNS):
            raise ValueError("its rows are not a motion clip's")
    except (OSError, ValueError) as error:
        raise _unusable(path, str(error)) from error
    if not np.isfinite(rows).all() or np.any(np.diff(rows[:, 0]) <= 0):
        raise _unusable(path, "its times do not rise or a value is missing")
    quaternions = rows[:, 4:].copy()
    turns = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    quaternions[1:][np.cumsum(turns) % 2 == 1] *= -1  # q and -q are one rotation: no sign jumps
    rest = np.array([0.0, 0.0, distance_m])
    return Clip(path.stem, rows[:, 0] - rows[0, 0], rest + rows[:, 1:4] @ FACING, quaternions)


def _unusable(path: Path, why: str) -> DataError:
    return DataError("MOTION-CLIP", f"cannot use {path}: {why}", f"Give {', '.join(COLUMNS)}.")


def read_clips(folder: Path, distance_m: float = DISTANCE_M) -> list[Clip]:
    """All clips of a folder by name. Raises `DataError` MOTION-CLIP, also if there is none."""
    paths = sorted(folder.glob("*.csv"))
    if not paths:
        raise _unusable(folder, "it holds no CSV file")
    return [read_clip(path, distance_m) for path in paths]


def measurement_covariance(
    pose: Pose, visible: tuple[int, ...] = (0, 1, 2, 3, 4), noise_px: float = CENTROID_NOISE_PX
) -> Array:
    """(6, 6) covariance of a pose solved from the visible LEDs: (J^T J / noise^2)^-1."""
    lever = LEDS[list(visible)] @ pose.rotation.T
    x, y, z = (lever + pose.translation).T
    image = np.zeros((len(lever), 2, 3))
    image[:, 0, 0] = image[:, 1, 1] = FOCAL_PX / z
    image[:, 0, 2], image[:, 1, 2] = -FOCAL_PX * x / z**2, -FOCAL_PX * y / z**2
    turned = np.stack([np.cross(axis, lever) for axis in np.eye(3)], axis=-1)
    jacobian = np.concatenate([image @ turned, image], axis=2).reshape(-1, 6)
    return np.asarray(np.linalg.inv(jacobian.T @ jacobian / noise_px**2), float)


def measure(clip: Clip, times_s: Array, rng: np.random.Generator) -> Measured:
    """What the tracker reports of a clip at `times_s`: truth with noise of its own covariance."""
    rotations, translations = clip.poses(times_s)
    covariances = np.empty((len(times_s), 6, 6))
    for i, (rotation, translation) in enumerate(zip(rotations, translations, strict=True)):
        covariances[i] = measurement_covariance(Pose(rotation, translation))
        error = np.linalg.cholesky(covariances[i]) @ rng.standard_normal(6)
        rotations[i] = rotation_from_vector(error[:3]) @ rotation
        translations[i] = translation + error[3:]
    return Measured(times_s, rotations, translations, covariances)


def frame_times(clip: Clip, rate_hz: float) -> Array:
    return np.arange(0.0, clip.duration_s, 1 / rate_hz)


def _cubic(times: Array, values: Array, at: Array) -> Array:
    """Cubic Hermite interpolation (k, d) of `values` (n, d), slopes from central differences."""
    slopes = np.gradient(values, times, axis=0)
    at = np.clip(at, times[0], times[-1])
    i = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    span = (times[i + 1] - times[i])[:, None]
    u = (at - times[i])[:, None] / span
    start = (1 + 2 * u) * values[i] + u * span * slopes[i]
    end = (3 - 2 * u) * values[i + 1] - (1 - u) * span * slopes[i + 1]
    return np.asarray((1 - u) ** 2 * start + u**2 * end, float)


def _rotations(quaternions: Array) -> Array:
    w, x, y, z = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
