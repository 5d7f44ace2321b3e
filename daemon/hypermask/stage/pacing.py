"""When to latch: as late before the flip as drawing safely allows, learnt from every flip.

The later the pose is latched, the shorter the prediction; but a frame that is not ready at its
flip costs a whole period. The budget between latch and flip is a high quantile of what latching,
waking up and drawing lately took, plus a margin that rises with every missed flip and falls
slowly while all goes well (a stochastic quantile estimate, Robbins and Monro 1951). What is to be
drawn is known before: two faces of a cross-fade have costs of their own, so that already the first
of its frames is begun early enough.

Pure logic on times: nothing here sleeps or reads a clock.
"""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PacingSettings:
    """window_frames: how many of the latest frames count; quantile: of their cost;
    target_misses: fraction of flips that the margin may end up missing;
    start_budget_s: before anything is known; margin_*_s: bounds and step of the margin.
    """

    window_frames: int = 180
    quantile: float = 0.98
    target_misses: float = 0.001
    start_budget_s: float = 0.012
    margin_start_s: float = 0.004
    margin_floor_s: float = 0.0015
    margin_step_s: float = 0.0015


@dataclass
class FlipCount:
    flips: int = 0
    missed: int = 0

    @property
    def on_time(self) -> float:
        """Fraction of the display's flips that brought a new picture; 1 before the first."""
        total = self.flips + self.missed
        return self.flips / total if total else 1.0


class Pacer:
    """One frame: `latch_s(flip)`, then draw, then `drawn`, then `flipped`."""

    def __init__(self, period_s: float, settings: PacingSettings | None = None) -> None:
        self._period_s = period_s
        self._settings = settings or PacingSettings()
        self._costs: dict[int, deque[float]] = defaultdict(
            lambda: deque(maxlen=self._settings.window_frames)
        )
        self._margin_s = self._settings.margin_start_s
        self.count = FlipCount()

    def budget_s(self, load: int = 1) -> float:
        """Time from latch to flip: what frames cost plus the margin, at most one period.

        load: how many characters are to be drawn.
        """
        return min(self._cost(load) + self._margin_s, self._period_s)

    def latch_s(self, next_flip_s: float, load: int = 1) -> float:
        """When to take the pose for the flip at `next_flip_s`; in the past means: at once."""
        return next_flip_s - self.budget_s(load)

    def drawn(self, latch_s: float, done_s: float, load: int = 1) -> None:
        """The frame planned to be latched at `latch_s` was finished by the GPU at `done_s`."""
        if np.isfinite(done_s - latch_s):
            self._costs[load].append(max(done_s - latch_s, 0.0))

    def flipped(self, planned_s: float, flip_s: float) -> int:
        """The frame meant for `planned_s` was shown at `flip_s`; returns the flips missed."""
        missed = max(round((flip_s - planned_s) / self._period_s), 0)
        self.count.flips += 1
        self.count.missed += missed
        step, target = self._settings.margin_step_s, self._settings.target_misses
        self._margin_s += step if missed else -step * target / (1 - target)
        self._margin_s = float(
            np.clip(self._margin_s, self._settings.margin_floor_s, self._period_s)
        )
        return missed

    def _cost(self, load: int) -> float:
        seen = self._costs[load]
        if len(seen) < 10:
            return max([self._settings.start_budget_s, *seen])
        costs = sorted(seen)
        return costs[min(int(self._settings.quantile * len(costs)), len(costs) - 1)]
