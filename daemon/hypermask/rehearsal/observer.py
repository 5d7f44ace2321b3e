"""Compares what the tracker found with the truth: found at all, right labels, how soon again."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hypermask.tracking.tracker import TrackResult
from hypermask_drivers.camera import Frame
from hypermask_sim.world import World

WRONG_LABEL_PX = 3.0
"""A labelled point that lies further than this from its own LED is another light."""
NEEDED_LEDS = 3


@dataclass
class TrackingObserver:
    """Fed every frame and its result; `summary` gives the figures of the report."""

    world: World
    frames: int = 0
    trackable: int = 0
    tracked: int = 0
    wrong_labels: int = 0
    wrong_locks: int = 0
    returns_ms: list[float] = field(default_factory=list)
    acquire_ms: float | None = None
    _trackable_since: float | None = None
    _lost: bool = True

    def __call__(self, frame: Frame, result: TrackResult) -> None:
        points, visible = self.world.led_points(frame.time_s)
        trackable = int(np.count_nonzero(visible)) >= NEEDED_LEDS
        tracked = result.estimate is not None
        self.frames += 1
        self._follow_returns(frame.time_s, trackable, tracked)
        if self.acquire_ms is None:
            return
        # Counted from the first lock on: how long that took is a figure of its own.
        self.trackable += trackable
        self.tracked += trackable and tracked
        if tracked:
            self._check(points, visible, result)

    def _check(self, points: np.ndarray, visible: np.ndarray, result: TrackResult) -> None:
        offset = np.linalg.norm(result.points - points, axis=1)
        wrong = np.isfinite(offset) & ((offset > WRONG_LABEL_PX) | ~visible)
        self.wrong_labels += int(np.count_nonzero(wrong))
        estimate = result.estimate
        assert estimate is not None
        leds = estimate.pose.apply(self.world.mask.leds)
        landed = self.world.camera.project(leds)
        self.wrong_locks += bool(np.sqrt(np.mean((landed - points) ** 2)) > 4 * WRONG_LABEL_PX)

    def _follow_returns(self, time_s: float, trackable: bool, tracked: bool) -> None:
        if not trackable:
            self._trackable_since = None
            self._lost = True
            return
        if self._trackable_since is None:
            self._trackable_since = time_s
        if tracked and self._lost:
            took_ms = (time_s - self._trackable_since) * 1e3
            if self.acquire_ms is None:
                self.acquire_ms = took_ms
            else:
                self.returns_ms.append(took_ms)
        elif not tracked and not self._lost:
            self._trackable_since = time_s
        self._lost = not tracked

    def summary(self) -> dict[str, Any]:
        fraction = self.tracked / self.trackable if self.trackable else None
        return {
            "frames": self.frames,
            "visible_fraction": fraction,
            "wrong_labels": self.wrong_labels,
            "wrong_locks": self.wrong_locks,
            "acquire_ms": self.acquire_ms,
            "reacquire_ms": max(self.returns_ms) if self.returns_ms else None,
            "reacquired": len(self.returns_ms),
        }
