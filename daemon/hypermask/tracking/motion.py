"""Where the mask is at any time: a filter over measured poses, and its prediction.

The record (`MOTION`) is all the state that prediction needs, in a fixed layout, so that one process
measures and another predicts, as late as it can.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hypermask.config import Settings
from hypermask.geometry import Array, Pose
from hypermask.tracking.motion_estimate import (
    advance,
    begin,
    correct,
    estimate_dtype,
    extrapolate,
)
from hypermask.tracking.motion_model import (
    DEFAULT_STATES,
    KALMAN_STATES,
    MotionParameters,
    parameters,
)

MODES = ("default", "kalman", "off")

MOTION = np.dtype(
    [
        ("samples", np.int64),  # measurements since the track began; 0: nothing to predict from
        ("time_s", np.float64),  # of the latest measurement
        ("interval_s", np.float64),  # between the latest two
        ("rotation", np.float64, (3, 3)),  # latest measured pose
        ("translation", np.float64, (3,)),
        ("measured_covariance", np.float64, (6, 6)),
        ("log_drive", np.float64, (6,)),  # how strongly the performer moves now, 0 = as the model
        ("log_drive_variance", np.float64, (6,)),
        ("default", estimate_dtype(DEFAULT_STATES)),
        ("kalman", estimate_dtype(KALMAN_STATES)),
    ]
)


class MotionSettings(Settings):
    """How the filter follows a performer who moves more or less than the recorded ones."""

    drive_spread: float = Field(default=2.0, gt=0)  # of ln(drive), a ratio of variances
    drive_time_s: float = Field(default=1.2, gt=0)  # in which the drive changes
    sensitivity: float = Field(default=0.4, gt=0, le=1)
    largest_surprise: float = Field(default=30.0, gt=1)  # in variances; bounds one outlier's say
    restart_after_s: float = Field(default=1.0, gt=0)


@dataclass(frozen=True)
class PredictedPose:
    """pose: camera_from_mask; covariance: (6, 6), small rotation vector (camera frame), metres."""

    pose: Pose
    covariance: Array


class MotionFilter:
    """Takes measured poses in the order of time and predicts to any later time."""

    def __init__(
        self, settings: MotionSettings | None = None, models: MotionParameters | None = None
    ) -> None:
        self.settings = settings or MotionSettings()
        self._models = models or parameters()
        self._record = np.zeros((), MOTION)

    def reset(self) -> None:
        """Forget everything; the next measurement begins a new track."""
        self._record = np.zeros((), MOTION)

    def update(self, time_s: float, pose: Pose, covariance: Array) -> None:
        """Take camera_from_mask `pose` measured at `time_s` with its (6, 6) covariance.

        Gaps are allowed. A measurement that is not later than the latest one is ignored.
        """
        record = self._record
        step = time_s - float(record["time_s"])
        if record["samples"] and step <= 0:
            return
        if not record["samples"] or step > self.settings.restart_after_s:
            self._begin(pose, covariance)
        else:
            self._follow(step, pose, covariance)
        record["samples"] += 1
        record["time_s"] = time_s
        record["rotation"], record["translation"] = pose.rotation, pose.translation
        record["measured_covariance"] = covariance

    def _begin(self, pose: Pose, covariance: Array) -> None:
        record = self._record
        record["samples"], record["interval_s"] = 0, 0
        record["log_drive"], record["log_drive_variance"] = 0, self.settings.drive_spread**2
        begin(record["default"], self._models.default, pose, covariance)
        begin(record["kalman"], self._models.kalman, pose, covariance)

    def _follow(self, step: float, pose: Pose, covariance: Array) -> None:
        record, models = self._record, self._models
        advance(record["default"], models.default, step, np.exp(record["log_drive"]))
        innovation, predicted = correct(record["default"], pose, covariance)
        self._judge_drive(step, innovation, predicted, np.diagonal(covariance))
        advance(record["kalman"], models.kalman, step, _ONES)
        correct(record["kalman"], pose, covariance)
        record["interval_s"] = step

    def _judge_drive(self, step: float, innovation: Array, predicted: Array, noise: Array) -> None:
        """Track the logarithm of the drive by the likelihood of the innovations.

        It is a process that reverts to 0 (the model's own drive); each innovation of variance S
        adds the score and the Fisher information of the log-likelihood, with
        d ln(S - noise) / d ln(drive) = `sensitivity`.
        """
        record, settings = self._record, self.settings
        kept = float(np.exp(-step / settings.drive_time_s))
        variance = record["log_drive_variance"] * kept**2
        variance += (1 - kept**2) * settings.drive_spread**2
        expected = predicted + noise
        slope = 0.5 * settings.sensitivity * predicted / expected
        surprise = np.minimum(innovation**2 / expected, settings.largest_surprise)
        variance /= 1 + variance * 2 * slope**2
        log_drive = record["log_drive"] * kept + variance * slope * (surprise - 1)
        record["log_drive"] = np.clip(log_drive, _WEAKEST, _STRONGEST)
        record["log_drive_variance"] = variance

    def predict(self, time_s: float, mode: str = "default") -> PredictedPose:
        """The pose at `time_s`, as `predict` has it from the record."""
        return predict(self._record, time_s, mode, self._models)

    def record(self) -> NDArray[np.void]:
        """A copy of the state, a scalar array of dtype `MOTION`."""
        return self._record.copy()


def predict(
    record: NDArray[np.void],
    time_s: float,
    mode: str = "default",
    models: MotionParameters | None = None,
) -> PredictedPose:
    """The pose at `time_s` from a record alone.

    mode: "default", "kalman" (constant velocity), or "off" (the latest measured pose held).
    A time before the latest measurement is reached back to over one interval, 10 ms at most,
    and one long after it ahead over half a second.
    Raises `ValueError` for a record without a measurement or an unknown mode.
    """
    if not record["samples"]:
        raise ValueError("the record holds no measurement")
    if mode not in MODES:
        raise ValueError(f"unknown prediction mode {mode!r}")
    if mode == "off":
        pose = Pose(record["rotation"].copy(), record["translation"].copy())
        return PredictedPose(pose, record["measured_covariance"].copy())
    models = models or parameters()
    model = models.default if mode == "default" else models.kalman
    drive = np.exp(record["log_drive"]) if mode == "default" else _ONES
    back = min(float(record["interval_s"]), _BACK_S)
    step = min(max(time_s - float(record["time_s"]), -back), _AHEAD_S)
    pose, covariance = extrapolate(record[mode], model, step, drive)
    return PredictedPose(pose, covariance)


_ONES = np.ones(6)
_BACK_S = 0.01
_AHEAD_S = 0.5
_WEAKEST, _STRONGEST = np.log(1e-3), np.log(100.0)
