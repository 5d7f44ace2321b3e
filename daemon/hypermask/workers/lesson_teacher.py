"""Who checks the takes of a lesson and learns from them: a second of computing, in a process of
its own that gives way to all others, because in the voice worker it would stop the mouth.
In lock-step the same is done at once in the worker (`InlineTeacher`).
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
from collections import Counter, deque
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import HypermaskError
from hypermask.voice import recurrent, speaker
from hypermask.voice.calibrate import Calibration, Take, calibrate, check
from hypermask.voice.speaker import Speaker
from hypermask.workers.realtime import die_with_parent

NICE = 10
_BELIEVED_AFTER = 2  # takes that seemed to be another vowel
# The parent may run in real time, and even reading in the modules must not.
_PROGRAM = f"""import os, sys
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
os.nice({NICE})
from {__name__} import serve
serve(int(sys.argv[1]))"""
_Samples = NDArray[np.float32]


@dataclass(frozen=True)
class Started:
    """The teacher can be asked."""


@dataclass(frozen=True)
class Checked:
    """problem: None, or a code and what to do."""

    asked: str
    problem: tuple[str, str] | None


@dataclass(frozen=True)
class Learnt:
    """kept: whether the result is in use from now on (and on disk)."""

    result: Calibration
    kept: bool


@dataclass(frozen=True)
class Refused:
    code: str
    text: str


Reply = Started | Checked | Learnt | Refused


class Lecture:
    """The takes of one actor, and what is learnt of them."""

    def __init__(self, in_use: Speaker | None) -> None:
        self._network = recurrent.shipped()
        self._in_use = in_use
        self._takes: dict[str, Take] = {}
        self._wrong: Counter[str] = Counter()

    def take(self, asked: str, samples: _Samples) -> Reply:
        """samples: at 16 kHz."""
        take = check(asked, samples, self._network, self._wrong[asked] >= _BELIEVED_AFTER)
        if take.problem is None:
            self._takes[asked] = take
        elif take.problem[0] == "VOICE-WRONG":
            self._wrong[asked] += 1
        return Checked(asked, take.problem)

    def learn(self, who: str) -> Reply:
        result = calibrate(who, self._takes, self._network, self._in_use)
        if result.better:
            speaker.save(result.speaker)
        return Learnt(result, result.better)

    def answer(self, question: tuple[Any, ...]) -> Reply:
        """("take", asked, samples) or ("learn", who)."""
        try:
            return self.take(*question[1:]) if question[0] == "take" else self.learn(question[1])
        except HypermaskError as error:
            return Refused(error.code, f"{error.what}. {error.remedy}")


class Teacher(Protocol):
    """Answers come in the order of the questions."""

    def ask(self, *question: Any) -> None: ...

    def reply(self) -> Reply | None:
        """An answer that is there; never waits."""

    def close(self) -> None: ...


class InlineTeacher:
    """Computes at once, where no time passes."""

    def __init__(self, in_use: Speaker | None) -> None:
        self._lecture = Lecture(in_use)
        self._replies: deque[Reply] = deque([Started()])

    def ask(self, *question: Any) -> None:
        self._replies.append(self._lecture.answer(question))

    def reply(self) -> Reply | None:
        return self._replies.popleft() if self._replies else None

    def close(self) -> None:
        return


class TeacherProcess:
    """The process. It ends when it is closed, or with its parent."""

    def __init__(self, in_use: Speaker | None) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            os.set_inheritable(theirs.fileno(), True)
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        self._line = Connection(ours.detach())
        self._in_use = in_use
        self._greeted = False

    def ask(self, *question: Any) -> None:
        with contextlib.suppress(OSError):  # `reply` will tell
            self._line.send(question)

    def reply(self) -> Reply | None:
        try:
            if not self._line.poll():
                return None
            reply: Reply = self._line.recv()
        except (EOFError, OSError):
            return Refused("VOICE-TEACHER", "the learning process ended. Begin the lesson again.")
        if not self._greeted:
            self._greeted = True
            self.ask(self._in_use)
        return reply

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._line.close()
        self._process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(0.05)


def serve(descriptor: int) -> None:
    """The process's work: questions in, answers out, until the other end closes."""
    die_with_parent()
    line = Connection(descriptor)
    with contextlib.suppress(EOFError, OSError, KeyboardInterrupt):
        line.send(Started())
        (in_use,) = line.recv()
        lecture = Lecture(in_use)
        while True:
            line.send(lecture.answer(line.recv()))
