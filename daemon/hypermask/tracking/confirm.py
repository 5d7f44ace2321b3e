"""A new lock is believed only when several frames in a row show one head that moves like a head."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from hypermask.config import Settings
from hypermask.geometry import Array, vector_from_rotation
from hypermask.tracking.pose import PoseEstimate


class ConfirmSettings(Settings):
    """Frames, seconds, metres, radians. The limits are beyond any head on a stage."""

    frames: int = Field(3, ge=1)
    frames_with_four_leds: int = Field(6, ge=1)
    max_gap_s: float = Field(0.05, gt=0)
    max_speed: float = Field(5.0, gt=0)
    max_turn_rate: float = Field(30.0, gt=0)
    max_acceleration: float = Field(150.0, gt=0)
    max_turn_acceleration: float = Field(1500.0, gt=0)


class Candidate:
    """The sightings so far of what may be the mask: times (s) and estimates."""

    def __init__(self, settings: ConfirmSettings) -> None:
        self.settings = settings
        self.times: list[float] = []
        self.estimates: list[PoseEstimate] = []
        self._complete = False  # all LEDs were seen in one of the frames

    def believed(self, time_s: float, estimate: PoseEstimate, complete: bool) -> bool:
        """Take a sighting; True when those in a row are enough. One that does not continue the
        motion of the others begins anew."""
        if self.times and not self._continues(time_s, estimate):
            self.times, self.estimates, self._complete = [], [], False
        self._complete |= complete
        self.times.append(time_s)
        self.estimates.append(estimate)
        s = self.settings
        return len(self.times) >= (s.frames if self._complete else s.frames_with_four_leds)

    def _continues(self, time_s: float, estimate: PoseEstimate) -> bool:
        s = self.settings
        if time_s - self.times[-1] > s.max_gap_s:
            return False
        velocity, noise = _velocity(self.estimates[-1], estimate, time_s - self.times[-1])
        limit = np.repeat([s.max_turn_rate, s.max_speed], 3)
        if (np.abs(velocity) > limit + 4 * noise).any():
            return False
        if len(self.times) < 2:
            return True
        step = self.times[-1] - self.times[-2]
        before, noise_before = _velocity(self.estimates[-2], self.estimates[-1], step)
        span = (time_s - self.times[-2]) / 2
        limit = np.repeat([s.max_turn_acceleration, s.max_acceleration], 3) * span
        return bool((np.abs(velocity - before) <= limit + 4 * (noise + noise_before)).all())


def _velocity(first: PoseEstimate, second: PoseEstimate, step_s: float) -> tuple[Array, Array]:
    """(6,) velocity between two sightings and its standard deviation."""
    turn = vector_from_rotation(second.pose.rotation @ first.pose.rotation.T)
    move = second.pose.translation - first.pose.translation
    noise = np.sqrt(np.diag(first.covariance) + np.diag(second.covariance))
    return np.concatenate([turn, move]) / step_s, noise / step_s
