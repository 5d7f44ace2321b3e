"""Time in seconds of CLOCK_MONOTONIC, or of a virtual clock in lock-step runs."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Where every part of the program takes its time from."""

    def now(self) -> float:
        """Seconds since an arbitrary fixed origin; never goes back."""
        ...

    def sleep_until(self, time_s: float) -> None:
        """Return when `now() >= time_s`."""
        ...


class RealClock:
    """CLOCK_MONOTONIC, the clock of V4L2 buffers and DRM page flips; all processes share it."""

    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, time_s: float) -> None:
        remaining = time_s - time.monotonic()
        if remaining > 0:
            time.sleep(remaining)


class VirtualClock:
    """A clock that moves only when told to; lock-step runs give the same numbers anywhere."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now = start_s

    def now(self) -> float:
        return self._now

    def sleep_until(self, time_s: float) -> None:
        self._now = max(self._now, time_s)
