"""The voice worker: sound in, the mouth's 13 parameters out."""

from __future__ import annotations

import time
from collections import deque

import numpy as np

from hypermask.voice.follower import MouthFollower, MouthFrame, VoiceSettings
from hypermask.voice.speaker import Speaker
from hypermask.workers.board import KEPT, MOUTH, Board
from hypermask.workers.retry import Kept, Report
from hypermask_drivers.clock import Clock
from hypermask_drivers.sound import SoundIn

SILENT_AFTER_S = 0.1


class VoiceWorker:
    """Owns the microphone; writes `Board.mouth` for every analysed frame."""

    def __init__(
        self,
        sound: SoundIn,
        board: Board,
        clock: Clock,
        report: Report,
        settings: VoiceSettings | None = None,
        speaker: Speaker | None = None,
    ) -> None:
        """speaker: what calibration learnt of the actor, see `hypermask.voice.speaker`."""
        self._settings = settings or VoiceSettings()
        self._speaker = speaker
        self.sound = Kept(sound, "sound", clock, report)
        self._board = board
        self._clock = clock
        self._follower: MouthFollower | None = None
        self._rate_hz = self._heard_s = 0.0
        self.compute_s: deque[float] = deque(maxlen=KEPT)
        self.history: deque[MouthFrame] = deque(maxlen=KEPT)

    def step(self, timeout_s: float = 0.0) -> bool:
        """Take one block of sound if there is one; False when there was none."""
        block = self.sound.use(lambda sound: sound.read(timeout_s))
        if block is None:
            self._close_mouth()
            return False
        self._heard_s = self._clock.now()
        began = time.perf_counter()
        if self._follower is None or self._rate_hz != block.rate_hz:
            self._follower, self._rate_hz = (
                MouthFollower(block.rate_hz, self._settings, self._speaker),
                block.rate_hz,
            )
        for frame in self._follower.feed(block.samples, block.time_s):
            self._publish(frame)
        self.compute_s.append(time.perf_counter() - began)
        return True

    def _close_mouth(self) -> None:
        """A microphone that gives nothing is silence: the mouth must not stay open."""
        now_s = self._clock.now()
        if self._follower is not None and now_s - self._heard_s > SILENT_AFTER_S:
            self._publish(self._follower.idle(now_s))

    def _publish(self, frame: MouthFrame) -> None:
        record = np.zeros((), MOUTH)
        record["time_s"], record["level_db"] = frame.time_s, frame.level_db
        record["parameters"], record["arousal"] = frame.parameters, frame.arousal
        self._board.mouth.publish(record)
        self.history.append(frame)
