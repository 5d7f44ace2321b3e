"""Moves the camera's phase so that a frame is ready just before the projector's latch.

Free-running, a frame waits half a camera period on average (4.2 ms at 120 Hz) before the stage
takes it. That wait is pure latency; a few longer or shorter blankings of the sensor take it away.
"""

from __future__ import annotations

from dataclasses import dataclass

MULTIPLE_TOLERANCE = 0.002


@dataclass(frozen=True)
class AlignmentSettings:
    """margin_s: how long before the latch a frame should be ready; covers the tracker's jitter."""

    margin_s: float = 0.0004
    dead_band_s: float = 0.0002
    settle_frames: int = 60
    enabled: bool = True


class PhaseAligner:
    """Says by how much the camera should be delayed; pure logic on times."""

    def __init__(self, settings: AlignmentSettings | None = None) -> None:
        self._settings = settings or AlignmentSettings()
        self._wait_frames = 0

    def delay(
        self, ready_s: float, frame_period_s: float, latch_s: float, flip_period_s: float
    ) -> float:
        """Seconds by which to delay the camera, 0 for none.

        ready_s: when the newest frame's pose was ready; latch_s: any latch moment of the stage;
        both by the same clock. Where the projector's period is no multiple of the camera's there
        is no phase to keep, and the answer is always 0.
        """
        settings = self._settings
        if not settings.enabled or frame_period_s <= 0 or flip_period_s <= 0:
            return 0.0
        if self._wait_frames > 0:
            self._wait_frames -= 1
            return 0.0
        ratio = flip_period_s / frame_period_s
        if abs(ratio - round(ratio)) > MULTIPLE_TOLERANCE * ratio or round(ratio) < 1:
            return 0.0
        slack = (latch_s - ready_s) % frame_period_s
        delay = slack - settings.margin_s
        if delay > frame_period_s / 2:
            delay -= frame_period_s
        if abs(delay) < settings.dead_band_s:
            return 0.0
        self._wait_frames = settings.settle_frames
        return delay
