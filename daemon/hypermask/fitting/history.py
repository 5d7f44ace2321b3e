"""Undo and redo: what each step changed, before and after; the oldest go when memory is full."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LIMIT_BYTES = 16_000_000
"""More than 50,000 drags."""
_OVERHEAD = 300


@dataclass(frozen=True)
class Change:
    """rows of a level's values, what they were and what they became, (len(rows), 2) each."""

    level: str
    rows: NDArray[np.intp]
    before: Array
    after: Array

    @property
    def size(self) -> int:
        return _OVERHEAD + self.rows.nbytes + self.before.nbytes + self.after.nbytes


Step = tuple[Change, ...]


class History:
    def __init__(self, limit_bytes: int = LIMIT_BYTES) -> None:
        self._limit = limit_bytes
        self._done: deque[Step] = deque()
        self._undone: list[Step] = []
        self._size = 0

    @property
    def counts(self) -> tuple[int, int]:
        """How many steps can be undone, and redone."""
        return len(self._done), len(self._undone)

    def push(self, step: Step) -> None:
        """A new step; what had been undone can no longer be redone."""
        self._size -= sum(_size(undone) for undone in self._undone)
        self._undone.clear()
        self._done.append(step)
        self._size += _size(step)
        while self._size > self._limit and len(self._done) > 1:
            self._size -= _size(self._done.popleft())

    def undo(self) -> Step | None:
        """The step to take back, or None."""
        if not self._done:
            return None
        self._undone.append(self._done.pop())
        return self._undone[-1]

    def redo(self) -> Step | None:
        """The step to do again, or None."""
        if not self._undone:
            return None
        self._done.append(self._undone.pop())
        return self._done[-1]


def _size(step: Step) -> int:
    return sum(change.size for change in step)
