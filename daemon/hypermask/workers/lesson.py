"""Teaching the show an actor's voice, over the blackboard of the show that runs.

Six takes of a second and a half, each asked for in words, checked, and asked for again when it
cannot be used. The lesson is a mode of the keypad (any key: ready, go on; backspace: once more;
minus or numlock: stop), or goes through by itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from hypermask.blackboard import Record
from hypermask.errors import DataError, HypermaskError
from hypermask.voice.takes import ASKED, PROMPTS, TAKE_S
from hypermask.workers.board import Board
from hypermask.workers.lesson_record import (
    BEAT_S,
    DEAD_S,
    END,
    LEARN,
    LESSON,
    LessonState,
    cut,
    text_of,
)

LEAD_S = 1.2
"""From the words that ask for a sound until it is listened for."""
GOOD_S, BAD_S, OVER_S = 0.5, 3.0, 6.0
MOST_TRIES = 5
STOP = ("minus", "numlock")
AGAIN = "backspace"


class _Stage(Enum):
    WELCOME = "welcome"
    PROMPT = "prompt"
    LISTEN = "listen"
    CHECK = "check"
    GOOD = "good"
    BAD = "bad"
    STUCK = "stuck"
    LEARN = "learn"
    OVER = "over"
    ENDED = "ended"


@dataclass(frozen=True)
class Try:
    """problem: None, or the code of what was wrong with this take."""

    asked: str
    problem: str | None


class VoiceLesson:
    """A mode of the show: `begin`, `press` and `step` with clock times, `words` for the operator.

    When it is over `result` says what was learnt, or `failure` why nothing was.
    """

    name = "lesson"

    def __init__(
        self,
        board: Board,
        who: str = "actor",
        say: Callable[[str], None] = lambda text: None,
        by_keys: bool = True,
    ) -> None:
        """say: gets each new text of `words`; by_keys: nothing begins before a key is pressed, and
        a sound that goes wrong again and again waits for one; else it ends the lesson."""
        self._board, self._who, self._say, self._by_keys = board, who, say, by_keys
        self._reset()

    def _reset(self) -> None:
        self._stage, self._since_s = _Stage.ENDED, 0.0
        self._text = ""
        self._at = self._tries_now = 0  # in ASKED; how often that went wrong
        self._beat_s = self._heard_s = -float("inf")
        self._order = np.zeros((), LESSON)
        self._pressed = False
        self.tries: list[Try] = []
        self.result: dict[str, Any] | None = None
        self.failure: HypermaskError | None = None

    def begin(self, now_s: float) -> None:
        self._reset()
        other = self._board.lesson.latest()
        goes_on = other is not None and text_of(other, "asked") != END
        if other is not None and goes_on and 0 <= now_s - float(other["beat_s"]) < DEAD_S:
            what, remedy = "another voice is being learnt", "Wait until that is over."
            self._fail(now_s, "VOICE-LESSON", what, remedy)
            return
        self._order["number"] = time.time_ns()
        self._order["who"] = cut(self._who, 64)
        self._heard_s = now_s
        self._enter(_Stage.WELCOME, now_s, _WELCOME + (_READY if self._by_keys else ""))
        self._publish(now_s)

    def press(self, key: str, now_s: float) -> None:
        """A key of the keypad."""
        if self._stage is _Stage.ENDED:
            return
        if self._stage is _Stage.OVER:
            self._enter(_Stage.ENDED, now_s, "")
        elif key in STOP:
            self._fail(now_s, "VOICE-STOPPED", "the voice was not learnt", "Nothing was changed.")
        elif key == AGAIN:
            self._repeat(now_s)
        else:
            self._pressed = True

    def step(self, now_s: float) -> bool:
        """False when it is over."""
        if self._stage is _Stage.ENDED:
            return False
        if self._stage is not _Stage.OVER:
            self._follow(now_s)
        elif now_s - self._since_s > OVER_S or not self._by_keys:
            self._enter(_Stage.ENDED, now_s, "")
        if now_s - self._beat_s >= BEAT_S:
            self._publish(now_s)
        return True

    def end(self, now_s: float) -> None:
        """Left before it was over, or after it: the voice worker no longer listens for it."""
        if self._stage not in (_Stage.OVER, _Stage.ENDED):
            self._fail(now_s, "VOICE-STOPPED", "the voice was not learnt", "Nothing was changed.")
        if self._stage is _Stage.OVER:
            self._enter(_Stage.ENDED, now_s, "")

    def words(self) -> str:
        """What to tell the operator now, one or two lines."""
        return self._text

    # What happens ----------------------------------------------------------------------------

    def _follow(self, now_s: float) -> None:
        answer = self._answer(now_s)
        if answer is None:
            return
        pressed, self._pressed = self._pressed, False
        age_s, stage = now_s - self._since_s, self._stage
        state = LessonState(int(answer["state"]))
        mine = int(answer["order"]) == int(self._order["order"])
        if state is LessonState.FAILED:
            self._refused(answer, now_s)
        elif stage is _Stage.WELCOME:
            self._pressed = pressed  # a key that came early counts
            if state is LessonState.READY and (pressed or not self._by_keys):
                self._ask(0, now_s)
        elif stage is _Stage.PROMPT and now_s >= float(self._order["listen_s"]):
            self._enter(_Stage.LISTEN, now_s, f"NOW: {self._prompt()}")
        elif stage in (_Stage.LISTEN, _Stage.CHECK) and mine:
            self._judge(state, answer, now_s)
        elif stage is _Stage.GOOD and (pressed or age_s > GOOD_S):
            self._next(now_s)
        elif (stage is _Stage.BAD and (pressed or age_s > BAD_S)) or (
            stage is _Stage.STUCK and pressed
        ):
            self._ask(self._at, now_s)
        elif stage is _Stage.LEARN and mine and state is LessonState.FINISHED:
            self._finish(answer, now_s)

    def _answer(self, now_s: float) -> Record | None:
        """What the voice worker says of this lesson; ends it where that is gone."""
        answer = self._board.lesson_result.latest()
        if answer is not None and int(answer["number"]) == int(self._order["number"]):
            self._heard_s = max(self._heard_s, float(answer["beat_s"]))
        else:
            answer = None
        if now_s - self._heard_s > DEAD_S:
            self._fail(
                now_s,
                "VOICE-DEAF",
                "the voice worker does not answer",
                "See whether the show and its voice run (hypermask status).",
            )
            return None
        return answer

    def _judge(self, state: LessonState, answer: Record, now_s: float) -> None:
        asked = ASKED[self._at]
        if state is LessonState.CHECKING and self._stage is _Stage.LISTEN:
            self._enter(_Stage.CHECK, now_s, "Thank you.")
        elif state is LessonState.ACCEPTED:
            self.tries.append(Try(asked, None))
            self._tries_now = 0
            self._enter(_Stage.GOOD, now_s, "Good.")
        elif state is LessonState.REJECTED:
            code, text = text_of(answer, "code"), text_of(answer, "text")
            self.tries.append(Try(asked, code))
            self._tries_now += 1
            self._bad(code, text, now_s)

    def _bad(self, code: str, text: str, now_s: float) -> None:
        if self._tries_now < MOST_TRIES:
            self._enter(_Stage.BAD, now_s, f"{code}: {text}\nIt is asked for again.")
        elif self._by_keys:
            self._tries_now = 0
            self._enter(_Stage.STUCK, now_s, f"{code}: {text}\nA key: again. Minus: stop.")
        else:
            self._fail(now_s, code, f"'{ASKED[self._at]}' could not be learnt", text)

    def _next(self, now_s: float) -> None:
        if self._at + 1 < len(ASKED):
            self._ask(self._at + 1, now_s)
            return
        self._put(LEARN, now_s, now_s)
        self._enter(_Stage.LEARN, now_s, "That was all. The voice is being learnt ...")

    def _repeat(self, now_s: float) -> None:
        """The take that goes on, or the one just accepted, once more."""
        if self._stage in (_Stage.WELCOME, _Stage.LEARN):
            return
        done = self._stage is _Stage.PROMPT and self._at > 0 and self._tries_now == 0
        self._ask(self._at - 1 if done else self._at, now_s)

    def _ask(self, at: int, now_s: float) -> None:
        self._at = at
        self._put(ASKED[at], now_s + LEAD_S, now_s)
        text = f"{at + 1} of {len(ASKED)}: {self._prompt()}\nBegin at NOW, for {TAKE_S:g} seconds."
        self._enter(_Stage.PROMPT, now_s, text)

    def _prompt(self) -> str:
        return PROMPTS[ASKED[self._at]]

    def _finish(self, answer: Record, now_s: float) -> None:
        before, after = float(answer["before"]), float(answer["after"])
        kept, adapted = bool(answer["kept"]), bool(answer["adapted"])
        self.result = {
            "name": self._who,
            "adapted": adapted,
            "held_out_before": round(before, 4),
            "held_out_after": round(after, 4),
            "paper_net": text_of(answer, "paper_net") or None,
            "kept": kept,
        }
        if not kept:
            text = f"The voice is understood as it is ({before:.1%}). Nothing was changed."
        elif adapted:
            text = f"The voice was learnt: {before:.1%} was heard rightly before, {after:.1%} now."
        else:
            text = f"The voice is understood without a correction ({after:.1%})."
        self._put(END, now_s, now_s)
        self._enter(_Stage.OVER, now_s, text)

    def _refused(self, answer: Record, now_s: float) -> None:
        text = text_of(answer, "text")
        self._fail(now_s, text_of(answer, "code"), "the voice could not be learnt", text)

    def _fail(self, now_s: float, code: str, what: str, remedy: str) -> None:
        self.failure = DataError(code, what, remedy)
        if int(self._order["number"]):
            self._put(END, now_s, now_s)
        self._enter(_Stage.OVER, now_s, str(self.failure))

    # To the blackboard and to the actor ------------------------------------------------------

    def _put(self, asked: str, listen_s: float, now_s: float) -> None:
        self._order["asked"], self._order["listen_s"] = asked.encode(), listen_s
        self._order["order"] += 1
        self._publish(now_s)

    def _publish(self, now_s: float) -> None:
        if not int(self._order["number"]):
            return  # another lesson's place
        self._order["beat_s"] = self._beat_s = now_s
        self._board.lesson.publish(self._order)

    def _enter(self, stage: _Stage, now_s: float, text: str) -> None:
        self._stage, self._since_s, self._pressed = stage, now_s, False
        if text and text != self._text:
            self._say(text)
        self._text = text


_WELCOME = "The voice: five vowels and a silence are asked for, a second and a half each."
_READY = "\nA key: begin. Backspace: once more. Minus: stop."
