"""The voice worker: sound in, the mouth's 13 parameters out."""

from __future__ import annotations

import time
from collections import deque

import numpy as np

from hypermask.voice import speaker as speakers
from hypermask.voice.follower import MouthFollower, MouthFrame
from hypermask.voice.settings import VoiceSettings
from hypermask.voice.speaker import Speaker
from hypermask.workers.board import KEPT, MOUTH, Board
from hypermask.workers.lesson_ear import LessonEar
from hypermask.workers.microphone import SoundCheck
from hypermask.workers.retry import Kept, Report
from hypermask_drivers.clock import Clock
from hypermask_drivers.sound import SoundBlock, SoundIn

SILENT_AFTER_S = 0.1
_USUAL_HZ = 16_000.0
_SHUT = 0.02
"""Of the half width of the mouth: less is shut."""
_SWAP_WITHIN_S = 10.0


def speaker_in_use(report: Report, now_s: float | None = None) -> Speaker | None:
    """Whose voice a show on this machine expects, for `VoiceWorker`; a calibration that cannot be
    used is reported (VOICE-SPEAKER). now_s: CLOCK_MONOTONIC without it.

    Rehearsals take nobody's, so that they stay the same on every machine.
    """
    speaker, warning = speakers.load_current()
    if warning is not None:
        report(time.monotonic() if now_s is None else now_s, "VOICE-SPEAKER", warning)
    return speaker


class VoiceWorker:
    """Owns the microphone; writes `Board.mouth` for every analysed frame, and answers lessons
    (`Board.lesson`)."""

    def __init__(
        self,
        sound: SoundIn,
        board: Board,
        clock: Clock,
        report: Report,
        settings: VoiceSettings | None = None,
        speaker: Speaker | None = None,
        kept: int = KEPT,
    ) -> None:
        """speaker: what calibration learnt of the actor, see `speaker_in_use`; kept: how many
        frames `history` holds."""
        self._check = SoundCheck(report)
        self.sound = Kept(sound, "sound", clock, self._check.device_news)
        self._board = board
        self._clock = clock
        self._settings = settings or VoiceSettings()
        self._speaker = speaker
        # Made now, because reading the network takes longer than a block of sound.
        self._rate_hz = _USUAL_HZ
        self._follower = MouthFollower(_USUAL_HZ, self._settings, speaker)
        self._lesson = LessonEar(board, clock, report, speaker)
        self._pupil: Speaker | None = None
        self._pupil_s = 0.0
        self._followed_s = clock.now()
        self._shut = True
        self.compute_s: deque[float] = deque(maxlen=kept)
        self.history: deque[MouthFrame] = deque(maxlen=kept)

    def step(self, timeout_s: float = 0.0) -> bool:
        """Take one block of sound if there is one; False when there was none."""
        block = self.sound.use(lambda sound: sound.read(timeout_s))
        heard = block is not None and self._hear(block)
        self._rest()
        self._learn()
        return heard

    def close(self) -> None:
        """A lesson that goes on is given up."""
        self._lesson.close()

    def _hear(self, block: SoundBlock) -> bool:
        """False for a block of no use."""
        now_s, began = self._clock.now(), time.perf_counter()
        samples = self._check.samples(block, now_s)
        if not len(samples):
            return False
        if self._rate_hz != block.rate_hz:
            self._rate_hz = block.rate_hz
            self._follower = MouthFollower(block.rate_hz, self._settings, self._speaker)
        time_s = self._check.time_of(block, now_s)
        for frame in self._follower.feed(samples, time_s):
            self._publish(frame)
            self._followed_s = now_s
        self.compute_s.append(time.perf_counter() - began)
        self._lesson.hear(samples, block.rate_hz, time_s)
        return True

    def _rest(self) -> None:
        """A microphone that gives nothing is silence: the mouth must not stay open."""
        now_s = self._clock.now()
        if now_s - self._followed_s > SILENT_AFTER_S:
            self._publish(self._follower.idle(now_s))

    def _learn(self) -> None:
        """The lesson goes on; what it learnt is used from a moment of silence on."""
        learnt = self._lesson.step()
        if learnt is not None:
            self._pupil, self._pupil_s = learnt, self._clock.now()
        if self._pupil is None:
            return
        if self._shut or self._clock.now() - self._pupil_s > _SWAP_WITHIN_S:
            self._speaker, self._pupil = self._pupil, None
            self._follower.use(self._speaker)

    def _publish(self, frame: MouthFrame) -> None:
        record = np.zeros((), MOUTH)
        record["time_s"], record["level_db"] = frame.time_s, frame.level_db
        record["parameters"], record["arousal"] = frame.parameters, frame.arousal
        self._board.mouth.publish(record)
        self.history.append(frame)
        self._shut = bool(np.abs(frame.parameters).max() < _SHUT)
