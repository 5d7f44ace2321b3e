"""The tracker worker: camera frames in, the mask's motion out."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

import numpy as np

from hypermask.tracking.motion import MotionFilter
from hypermask.tracking.paper import PointKalman
from hypermask.tracking.tracker import Tracker, TrackResult
from hypermask.workers.alignment import PhaseAligner
from hypermask.workers.board import KEPT, TRACK, Board
from hypermask.workers.retry import Kept, Report
from hypermask_drivers.camera import Camera, Frame
from hypermask_drivers.clock import Clock

Observer = Callable[[Frame, TrackResult], None]


class TrackerWorker:
    """Owns the camera; writes `Board.track` after every frame.

    charge_s: what the tracking is charged for on a virtual clock, where no real time passes.
    """

    def __init__(
        self,
        camera: Camera,
        tracker: Tracker,
        motion: MotionFilter,
        board: Board,
        clock: Clock,
        report: Report,
        aligner: PhaseAligner | None = None,
        charge_s: float = 0.0,
        observer: Observer | None = None,
    ) -> None:
        self.camera = Kept(camera, "camera", clock, report)
        self.tracker, self._motion, self._points = tracker, motion, PointKalman()
        self._board, self._clock, self._report = board, clock, report
        self._aligner = aligner or PhaseAligner()
        self._charge_s = charge_s
        self._observer = observer
        self._record = np.zeros((), TRACK)
        self._record["seen_s"] = -np.inf
        self._sequence: int | None = None
        self.compute_s: deque[float] = deque(maxlen=KEPT)
        self.latency_s: deque[float] = deque(
            maxlen=KEPT
        )  # from the frame's mid-exposure to the blackboard

    @property
    def dropped(self) -> int:
        """Frames that never came, by the gaps in their numbers."""
        return int(self._record["dropped"])

    @property
    def locked(self) -> bool:
        """Whether the mask was seen in the last frame."""
        return bool(self._record["locked"])

    def step(self, timeout_s: float = 0.0) -> bool:
        """Take one frame if there is one; False when there was none."""
        frame = self.camera.use(lambda camera: camera.read(timeout_s))
        self._record["camera_ready"] = self.camera.ready()
        if frame is None:
            return False
        began = time.perf_counter()
        result = self.tracker.process(frame.image, frame.time_s, frame.sequence)
        self.compute_s.append(time.perf_counter() - began)
        self._publish(frame, result)
        self.latency_s.append(self._clock.now() - frame.time_s)
        self._align()
        if self._observer is not None:
            self._observer(frame, result)
        return True

    def _publish(self, frame: Frame, result: TrackResult) -> None:
        record = self._record
        record["frames"] += 1
        if self._sequence is not None:
            record["dropped"] += max(frame.sequence - self._sequence - 1, 0)
        self._sequence = frame.sequence
        if result.locked != bool(record["locked"]):
            word = (
                ("LOST", "The mask is lost.")
                if record["locked"]
                else ("FOUND", "The mask is seen.")
            )
            self._report(frame.time_s, f"MASK-{word[0]}", word[1])
        record["time_s"], record["locked"] = frame.time_s, result.locked
        if result.estimate is not None:
            record["seen_s"] = frame.time_s
            self._points.update(frame.time_s, result.points)
            record["points"] = self._points.record()
            record["motion"] = self._motion.record()
        elif not result.locked:
            self._points.reset()
        self._board.track.publish(record)

    def _align(self) -> None:
        pace = self._board.pace.latest()
        if pace is None:
            return
        camera = self.camera.device
        latch_s = float(pace["flip_s"] - pace["latch_lead_s"])
        delay = self._aligner.delay(
            self._clock.now() + self._charge_s,
            1.0 / camera.mode.rate_hz,
            latch_s,
            float(pace["period_s"]),
        )
        if delay:
            self.camera.use(lambda device: device.shift_phase(delay))
