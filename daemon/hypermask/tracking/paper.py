"""The paper's prediction: a Kalman filter for each LED's image point (HYPERMASK, section on
tracking; A2 of the two papers' description). Kept as the reference beside the filter over poses.

Each coordinate of each point has constant velocity disturbed by white acceleration; x and y share
one 2x2 covariance, since both see the same times and noises.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hypermask.config import Settings
from hypermask.geometry import Array

POINTS = 5

POINT_MOTION = np.dtype(
    [
        ("samples", np.int64),  # frames taken since the track began; 0: nothing to predict from
        ("time_s", np.float64),  # of the state
        ("measured", np.float64, (POINTS, 2)),  # latest centroid of each point, px
        ("seen_s", np.float64, (POINTS,)),  # when; -inf: never
        ("position", np.float64, (POINTS, 2)),  # filtered, px
        ("velocity", np.float64, (POINTS, 2)),  # px/s
        ("covariance", np.float64, (POINTS, 2, 2)),  # of position and velocity, per axis
        ("lifetime_s", np.float64),
    ]
)


class PaperSettings(Settings):
    """Noise of the model and of the centroids; pixels and seconds."""

    acceleration_density: float = Field(default=3e6, gt=0)  # (px/s^2)^2/Hz
    measurement_sigma_px: float = Field(default=0.1, gt=0)
    initial_speed: float = Field(default=400.0, gt=0)  # px/s, one sigma
    # A point unseen for longer is not predicted any more.
    lifetime_s: float = Field(default=0.15, gt=0)


class PointKalman:
    """Takes the LEDs' image points in the order of time and predicts each on its own."""

    def __init__(self, settings: PaperSettings | None = None) -> None:
        self.settings = settings or PaperSettings()
        self.reset()

    def reset(self) -> None:
        """Forget everything; the next frame begins a new track."""
        self._record = np.zeros((), POINT_MOTION)
        self._record["seen_s"] = -math.inf
        self._record["lifetime_s"] = self.settings.lifetime_s

    def update(self, time_s: float, points: Array) -> None:
        """Take points (5, 2) px seen at `time_s`, NaN where hidden.

        A frame that is not later than the latest one is ignored.
        """
        record, settings = self._record, self.settings
        step = time_s - float(record["time_s"])
        if record["samples"] and step <= 0:
            return
        seen = ~np.isnan(points[:, 0])
        fresh = seen & ~(time_s - record["seen_s"] <= settings.lifetime_s)
        if record["samples"]:
            self._advance(step)
        self._correct(points, seen & ~fresh)
        self._begin(points, fresh)
        record["measured"][seen] = points[seen]
        record["seen_s"][seen] = time_s
        record["time_s"] = time_s
        record["samples"] += 1

    def predict(self, time_s: float) -> Array:
        """Points (5, 2) px at `time_s`, NaN where unseen for too long."""
        return predict_points(self._record, time_s)

    def record(self) -> NDArray[np.void]:
        """A copy of the state, a scalar array of dtype `POINT_MOTION`."""
        return self._record.copy()

    def _advance(self, step: float) -> None:
        record = self._record
        record["position"] += step * record["velocity"]
        transition = np.array([[1.0, step], [0.0, 1.0]])
        noise = self.settings.acceleration_density * np.array(
            [[step**3 / 3, step**2 / 2], [step**2 / 2, step]]
        )
        record["covariance"] = transition @ record["covariance"] @ transition.T + noise

    def _correct(self, points: Array, which: NDArray[np.bool_]) -> None:
        record = self._record
        covariance = record["covariance"][which]
        variance = covariance[:, 0, 0] + self.settings.measurement_sigma_px**2
        gain = covariance[:, :, 0] / variance[:, None]
        residual = points[which] - record["position"][which]
        record["position"][which] += gain[:, :1] * residual
        record["velocity"][which] += gain[:, 1:] * residual
        record["covariance"][which] -= gain[:, :, None] * covariance[:, :1, :]

    def _begin(self, points: Array, which: NDArray[np.bool_]) -> None:
        record, settings = self._record, self.settings
        record["position"][which] = points[which]
        record["velocity"][which] = 0.0
        record["covariance"][which] = np.diag(
            [settings.measurement_sigma_px**2, settings.initial_speed**2]
        )


def predict_points(record: NDArray[np.void], time_s: float, mode: str = "default") -> Array:
    """Points (5, 2) px at `time_s` from a record alone, NaN where unseen for too long.

    mode: "default" and "kalman" are the paper's filter; "off" holds the latest centroids.
    Raises `ValueError` for a record without a frame or an unknown mode.
    """
    if not record["samples"]:
        raise ValueError("the record holds no points")
    if mode == "off":
        points = record["measured"].copy()
    elif mode in ("default", "kalman"):
        points = record["position"] + (time_s - record["time_s"]) * record["velocity"]
    else:
        raise ValueError(f"unknown prediction mode {mode!r}")
    points[~(record["time_s"] - record["seen_s"] <= record["lifetime_s"])] = np.nan
    return np.asarray(points, float)
