"""What the show side and the voice worker tell each other while an actor's voice is learnt.

The side that has keys and eyes (`workers/lesson.py`) asks by `LESSON`; the side that has the
microphone (`workers/lesson_ear.py`) answers by `LESSON_RESULT`. Both beat, so that neither waits
for one that died.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from hypermask.blackboard import Record

BEAT_S = 0.2
DEAD_S = 3.0
"""Who has not written for so long is gone."""

LEARN, END = "learn", "end"
"""Asked for instead of a take: learn from all that were accepted; the lesson is over."""

LESSON = np.dtype(
    [
        ("number", "<i8"),  # of the lesson; another one is another lesson, 0 is none
        ("order", "<i8"),  # counts what is asked for, so that a repetition is something new
        ("asked", "S8"),  # one of calibrate.ASKED, LEARN, END, or nothing yet
        ("listen_s", "<f8"),  # clock time at which the take begins
        ("who", "S64"),
        ("beat_s", "<f8"),
    ]
)
LESSON_RESULT = np.dtype(
    [
        ("number", "<i8"),
        ("order", "<i8"),  # the one that is answered
        ("state", "u1"),  # LessonState
        ("progress", "<f8"),  # of the take, 0 to 1
        ("level_db", "<f8"),  # of what was heard last
        ("code", "S24"),  # why a take was rejected, or the lesson failed
        ("text", "S240"),
        ("before", "<f8"),  # parts of the held-out frames that were heard rightly
        ("after", "<f8"),
        ("kept", "?"),
        ("adapted", "?"),
        ("paper_net", "S16"),
        ("beat_s", "<f8"),
    ]
)


class LessonState(IntEnum):
    IDLE = 0
    PREPARING = 1
    READY = 2
    LISTENING = 3
    CHECKING = 4
    ACCEPTED = 5
    REJECTED = 6
    LEARNING = 7
    FINISHED = 8
    FAILED = 9


def cut(text: str, size: int) -> bytes:
    """UTF-8 that fits a field of a record, never half a letter."""
    return text.encode()[:size].decode("utf-8", "ignore").encode()


def text_of(record: Record, field: str) -> str:
    return str(record[field].item().decode("utf-8", "replace"))
