"""When a display takes its next picture, and what came too late for it."""

from __future__ import annotations

import math

from hypermask_drivers.clock import Clock


class FlipGrid:
    """The times at which a display can flip, from the kernel's time stamps.

    missed: flips since the signal's begin that came without a new picture.
    paced: whether the driver waits for a vertical blanking. One that does not would flip at once,
    and is kept at the mode's rate by waiting for `next_s`.
    """

    def __init__(self, clock: Clock, rate_hz: float, vblank_s: float | None) -> None:
        """vblank_s: time of the latest vertical blanking; None where the driver knows of none."""
        self._clock = clock
        self._period_s = 1 / rate_hz
        self._on_grid_s = clock.now() if vblank_s is None else vblank_s
        self._flipped_s: float | None = None
        self.paced = vblank_s is not None
        self.missed = 0

    def next_s(self) -> float:
        """When the next picture can be shown, on the clock's time."""
        ahead = math.floor((self._clock.now() - self._on_grid_s) / self._period_s) + 1
        least = 0 if self._flipped_s is None else 1
        return self._on_grid_s + max(least, ahead) * self._period_s

    def flipped(self, time_s: float, due_s: float) -> None:
        """A flip was made at time_s, due at due_s."""
        if self._flipped_s is not None:
            periods = round((time_s - self._flipped_s) / self._period_s)
            self.missed += max(0, periods - 1)
        self._flipped_s = time_s
        late = time_s - due_s > self._period_s / 2
        self._on_grid_s = time_s if self.paced or late else due_s

    def begin_anew(self) -> None:
        """The signal was off in between: that is no missed flip."""
        self._flipped_s = None
        self._on_grid_s = self._clock.now()
