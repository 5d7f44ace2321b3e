"""The mask while it stands still: the average of its tracked poses, and whether it moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hypermask.geometry import Array, Pinhole, Pose, rotation_from_vector, vector_from_rotation

SYSTEMATIC = 0.1
"""The part of a frame's variance that averaging cannot remove: on a still mask each LED lies on
the same pixels in every frame, so its centroid keeps the same small error."""


@dataclass(frozen=True)
class Sighting:
    """One tracked frame: time (s), `camera_from_mask`, its (6, 6) covariance (small left
    rotation first, then translation) and the LEDs' image points (5, 2), NaN where unseen."""

    time_s: float
    pose: Pose
    covariance: Array
    points: Array


@dataclass(frozen=True)
class StillPose:
    """The average over `frames` sightings; `covariance` is that of the average."""

    pose: Pose
    covariance: Array
    points: Array
    frames: int


def average(sightings: Sequence[Sighting]) -> StillPose:
    """The mean pose and image points of a mask that did not move; at least one sighting."""
    first = sightings[0].pose.rotation
    turns = [vector_from_rotation(s.pose.rotation @ first.T) for s in sightings]
    rotation = rotation_from_vector(np.mean(turns, axis=0)) @ first
    translation = np.mean([s.pose.translation for s in sightings], axis=0)
    covariance = np.mean([s.covariance for s in sightings], axis=0)
    points = np.array([s.points for s in sightings])
    return StillPose(
        Pose(rotation, translation),
        covariance * (1 / len(sightings) + SYSTEMATIC),
        _mean_seen(points),
        len(sightings),
    )


def _mean_seen(points: Array) -> Array:
    """Mean over frames (n, 5, 2) of those that saw the LED; NaN where none did."""
    seen = np.isfinite(points)
    total = np.where(seen, points, 0.0).sum(axis=0)
    count = seen.sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


@dataclass
class Stillness:
    """Collects sightings until the mask moves.

    Movement is judged across the line of sight: it is what displaces a click, and depth is far
    noisier. It counts after `patience` frames in a row, so that one bad frame is only left out.
    """

    leds: Array
    camera: Pinhole
    tolerance_m: float = 0.002
    patience: int = 5
    window: int = 600
    sightings: list[Sighting] = field(default_factory=list)
    moved_m: float = 0.0
    _strays: list[Sighting] = field(default_factory=list)
    _anchor: Array | None = None

    def add(self, sighting: Sighting) -> bool:
        """True when the mask moved; `sightings` then still holds the time before."""
        where = self.camera.project(sighting.pose.apply(self.leds))
        shift = self._shift(where, float(sighting.pose.translation[2]))
        if shift > self.tolerance_m:
            self._strays.append(sighting)
            self.moved_m = shift
            return len(self._strays) >= self.patience
        self._strays.clear()
        if len(self.sightings) < self.window:
            self.sightings.append(sighting)
            count = len(self.sightings)
            before = where if self._anchor is None else self._anchor
            self._anchor = before + (where - before) / count
        return False

    def restart(self) -> None:
        """Forget the time before; go on from the frames since the movement."""
        recent = self._strays[-1:]
        self.sightings, self._strays, self._anchor = [], [], None
        for sighting in recent:
            self.add(sighting)

    def _shift(self, where: Array, distance_m: float) -> float:
        """Largest displacement of an LED across the line of sight, metres."""
        if self._anchor is None:
            return 0.0
        pixels = float(np.max(np.linalg.norm(where - self._anchor, axis=1)))
        return pixels * distance_m / float(self.camera.matrix[0, 0])
