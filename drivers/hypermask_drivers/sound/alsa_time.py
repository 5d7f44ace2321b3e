"""When each sample of a sound card sounded: a delay-locked loop over the card's time stamps.

The card counts frames by its own quartz, the program lives by CLOCK_MONOTONIC, and the moments at
which both are read together jitter. The loop gives times that neither jitter nor creep (Adriaensen,
"Using a DLL to filter time", Linux Audio Conference 2005); its gains follow the time that has
really passed, because reads do not come evenly.
"""

from __future__ import annotations

import math

_FIRST_S = 2.0
_BANDWIDTH_HZ = 0.05
_FIRST_BANDWIDTH_HZ = 0.5
_SETTLING_S = 8.0
_LIMIT = 0.002  # no quartz is 2000 ppm off; a sum of jitter may look like one
_JUMP_S = 0.020
_JUMP_AFTER_S = 0.25


class SampleClock:
    """Times of the frames of one stream, which are counted from its start.

    `drift_ppm` and `jitter_s` are for the status: how fast the card's quartz is against the
    nominal rate, and how far single readings lie off.
    """

    def __init__(self, rate_hz: float) -> None:
        self._nominal_s = self._frame_s = 1.0 / rate_hz
        self.jitter_s = 0.0
        self.jumps = 0
        self.restart()

    def restart(self) -> None:
        """The stream begins anew at frame 0; what is known of the quartz stays."""
        self._frame, self._time_s = 0.0, -math.inf
        self._age_s, self._readings, self._off_s = 0.0, 0, 0.0

    @property
    def drift_ppm(self) -> float:
        return (self._nominal_s / self._frame_s - 1) * 1e6

    def time_of(self, frame: float) -> float:
        """When that frame sounded, by all that is known."""
        return self._time_s + (frame - self._frame) * self._frame_s

    def update(self, frame: float, time_s: float) -> float:
        """`frame` frames had been taken in at `time_s`. Returns how many seconds of sound are
        missing there (a jump ahead in time), nearly always 0.
        """
        if self._readings == 0:
            self._frame, self._time_s, self._readings = frame, time_s, 1
            return 0.0
        frames = frame - self._frame
        if frames <= 0:
            return 0.0
        step_s = frames * self._frame_s
        expected_s = self._time_s + step_s
        error_s = time_s - expected_s
        self._off_s = self._off_s + step_s if abs(error_s) > _JUMP_S else 0.0
        if self._off_s > _JUMP_AFTER_S:
            self.jumps += 1
            self._frame, self._time_s, self._readings = frame, time_s, 1
            self._age_s = self._off_s = 0.0
            return max(error_s, 0.0)
        if self._off_s > 0:  # believed only when it lasts
            self._frame, self._time_s = frame, expected_s
            return 0.0
        self._follow(frame, expected_s, step_s, frames, error_s)
        return 0.0

    def _follow(
        self, frame: float, expected_s: float, step_s: float, frames: float, error_s: float
    ) -> None:
        self._age_s += step_s
        self._readings += 1
        # A reader that was held up reads late: one such reading has no say worth the name.
        spread_s = max(5 * self.jitter_s, 0.001)
        bounded_s = min(max(error_s, -spread_s), spread_s)
        self.jitter_s += (abs(error_s) - self.jitter_s) * min(step_s / 2.0, 0.2)
        omega = 2 * math.pi * self._bandwidth_hz() * step_s
        # The first readings are averaged: the start is known no better than any of them.
        gain = max(min(math.sqrt(2) * omega, 1.0), 1.0 / self._readings)
        if gain > 0.5 or self._age_s < 0.1:
            bounded_s = error_s
        self._frame, self._time_s = frame, expected_s + gain * bounded_s
        if self._age_s > _FIRST_S:
            self._frame_s += min(omega, 0.5) ** 2 * bounded_s / frames
            slowest, fastest = self._nominal_s * (1 + _LIMIT), self._nominal_s * (1 - _LIMIT)
            self._frame_s = min(max(self._frame_s, fastest), slowest)

    def _bandwidth_hz(self) -> float:
        """Wide at first, to find the quartz soon, then narrow, to be steady."""
        share = math.exp(-self._age_s / _SETTLING_S)
        return _BANDWIDTH_HZ + (_FIRST_BANDWIDTH_HZ - _BANDWIDTH_HZ) * share
