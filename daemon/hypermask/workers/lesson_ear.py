"""The voice worker's half of a lesson: it records the takes and hands them to the teacher."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hypermask.blackboard import Record
from hypermask.voice.lpc import RATE_HZ
from hypermask.voice.resample import Resampler
from hypermask.voice.speaker import Speaker
from hypermask.voice.takes import ASKED, TAKE_S
from hypermask.workers.board import Board
from hypermask.workers.lesson_record import (
    BEAT_S,
    DEAD_S,
    END,
    LEARN,
    LESSON_RESULT,
    LessonState,
    cut,
    text_of,
)
from hypermask.workers.lesson_teacher import (
    Checked,
    InlineTeacher,
    Learnt,
    Refused,
    Reply,
    Started,
    Teacher,
    TeacherProcess,
)
from hypermask.workers.retry import Report
from hypermask_drivers.clock import Clock, VirtualClock

_Samples = NDArray[np.float64]

_GAP_S = 0.02
_LATE_S = 1.0
_ANSWER_S = 30.0
_NO_SOUND = "Sound was missing in it: the microphone gave none. Look at the microphone."


@dataclass
class Recording:
    """`TAKE_S` of sound at 16 kHz from clock time `from_s` on."""

    asked: str
    from_s: float
    _parts: list[_Samples] = field(default_factory=list)
    _count: int = 0
    _resampler: Resampler | None = None
    _rate_hz: float = 0.0
    _next_s: float = 0.0
    broken: bool = False

    @property
    def progress(self) -> float:
        return min(self._count / (TAKE_S * RATE_HZ), 1.0)

    def hear(self, samples: _Samples, rate_hz: float, time_s: float) -> None:
        """A block, `time_s` of its first sample."""
        skip = min(max(round((self.from_s - time_s) * rate_hz), 0), len(samples))
        if skip == len(samples) or self.progress == 1.0:
            return
        if self._resampler is None:
            self._resampler, self._rate_hz = Resampler(rate_hz), rate_hz
            self._next_s = time_s
        if rate_hz != self._rate_hz or abs(time_s - self._next_s) > _GAP_S:
            self.broken = True
            return
        self._next_s = time_s + len(samples) / rate_hz
        part = self._resampler.process(samples[skip:])
        self._parts.append(part)
        self._count += len(part)

    def samples(self) -> NDArray[np.float32]:
        sound = np.concatenate(self._parts) if self._parts else np.zeros(0)
        return sound[: round(TAKE_S * RATE_HZ)].astype(np.float32)


class LessonEar:
    """Follows `Board.lesson`; writes `Board.lesson_result`. Idle while nobody is taught."""

    def __init__(
        self,
        board: Board,
        clock: Clock,
        report: Report,
        in_use: Speaker | None,
        teacher: Callable[[Speaker | None], Teacher] | None = None,
    ) -> None:
        """teacher: by default a process, where time is virtual the worker itself."""
        inline = isinstance(clock, VirtualClock)
        self._make = teacher or (InlineTeacher if inline else TeacherProcess)
        self._board, self._clock, self._report = board, clock, report
        self._in_use = in_use
        self._teacher: Teacher | None = None
        self._recording: Recording | None = None
        self._number = self._order = 0
        self._who = ""
        self._level_db = -100.0
        self._asked_s = self._told_s = -float("inf")
        self._told = np.zeros((), LESSON_RESULT)

    def hear(self, samples: _Samples, rate_hz: float, time_s: float) -> None:
        """What the microphone gives."""
        if self._teacher is None:
            return
        self._level_db = 10 * float(np.log10(np.mean(np.square(samples)) + 1e-10))
        if self._recording is not None:
            self._recording.hear(samples, rate_hz, time_s)

    def step(self) -> Speaker | None:
        """Goes on with the lesson, if there is one; a speaker who was learnt just now."""
        lesson, now_s = self._board.lesson.latest(), self._clock.now()
        if lesson is None:
            return None
        alive = now_s - float(lesson["beat_s"]) < DEAD_S
        if not alive or text_of(lesson, "asked") == END:
            self._end()
            return None
        if int(lesson["number"]) != self._number:
            self._begin(lesson)
        if self._teacher is None:
            return None  # it failed, or ended, and the other side has not seen that yet
        learnt = self._listen(now_s)
        if int(lesson["order"]) != self._order:
            self._obey(lesson, now_s)
        if now_s - self._told_s >= BEAT_S:
            self._tell()
        return learnt

    def close(self) -> None:
        self._end()

    def _begin(self, lesson: Record) -> None:
        self._end()
        self._number, self._order = int(lesson["number"]), 0
        self._who = text_of(lesson, "who")
        self._told = np.zeros((), LESSON_RESULT)
        try:
            self._teacher = self._make(self._in_use)
        except OSError as error:  # no memory, no process
            self._fail("VOICE-TEACHER", f"the learning process cannot be started ({error}).")
            return
        self._asked_s = self._clock.now()
        self._tell(LessonState.PREPARING)

    def _end(self) -> None:
        if self._teacher is None:
            return
        self._teacher.close()
        self._teacher = self._recording = None
        if self._told["state"] not in (LessonState.FINISHED, LessonState.FAILED):
            self._tell(LessonState.IDLE)

    def _fail(self, code: str, text: str) -> None:
        self._tell(LessonState.FAILED, code, text)
        self._report(self._clock.now(), code, f"{code}: {text}")
        if self._teacher is not None:
            self._teacher.close()
        self._teacher = self._recording = None

    def _obey(self, lesson: Record, now_s: float) -> None:
        """What is asked for next."""
        if self._told["state"] in (LessonState.PREPARING, LessonState.CHECKING):
            return  # in a moment
        self._order, asked = int(lesson["order"]), text_of(lesson, "asked")
        if asked in ASKED:
            self._recording = Recording(asked, float(lesson["listen_s"]))
            self._tell(LessonState.LISTENING)
        elif asked == LEARN:
            self._recording = None
            self._ask(LessonState.LEARNING, "learn", self._who)

    def _ask(self, state: LessonState, *question: object) -> None:
        assert self._teacher is not None
        self._teacher.ask(*question)
        self._asked_s = self._clock.now()
        self._tell(state)

    def _listen(self, now_s: float) -> Speaker | None:
        """The take that is recorded, and the teacher's answers."""
        assert self._teacher is not None
        recording = self._recording
        if recording is not None:
            late = now_s > recording.from_s + TAKE_S + _LATE_S
            if recording.broken or (late and recording.progress < 1):
                self._recording = None
                self._tell(LessonState.REJECTED, "VOICE-GAP", _NO_SOUND)
            elif recording.progress == 1:
                self._recording = None
                self._ask(LessonState.CHECKING, "take", recording.asked, recording.samples())
        learnt = None
        while self._teacher is not None and (reply := self._teacher.reply()) is not None:
            learnt = self._take_in(reply) or learnt
        waits = self._told["state"] in (
            LessonState.PREPARING, LessonState.CHECKING, LessonState.LEARNING
        )  # fmt: skip
        if waits and now_s - self._asked_s > _ANSWER_S:
            self._fail("VOICE-TEACHER", "the learning process does not answer. Begin again.")
        return learnt

    def _take_in(self, reply: Reply) -> Speaker | None:
        match reply:
            case Started():
                self._tell(LessonState.READY)
            case Checked(problem=None):
                self._tell(LessonState.ACCEPTED)
            case Checked(problem=(code, text)):
                self._tell(LessonState.REJECTED, code, text)
            case Refused(code, text):
                self._fail(code, text)
            case Learnt(result, kept):
                told = self._told
                told["before"], told["after"], told["kept"] = result.before, result.after, kept
                told["adapted"] = result.adapted
                told["paper_net"] = (result.speaker.paper_net or "").encode()
                self._tell(LessonState.FINISHED)
                if kept:
                    self._in_use = result.speaker
                    self._report(
                        self._clock.now(), "VOICE-LEARNT", f"The voice of {self._who} is used now."
                    )
                    return result.speaker
        return None

    def _tell(self, state: LessonState | None = None, code: str = "", text: str = "") -> None:
        told = self._told
        if state is not None:
            told["state"], told["code"], told["text"] = state, cut(code, 24), cut(text, 240)
        told["number"], told["order"] = self._number, self._order
        told["progress"] = self._recording.progress if self._recording is not None else 0.0
        told["level_db"], told["beat_s"] = self._level_db, self._clock.now()
        self._told_s = self._clock.now()
        self._board.lesson_result.publish(told)
