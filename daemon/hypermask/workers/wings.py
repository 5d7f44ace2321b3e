"""The wings: where characters that come while the show runs wait until they are dressed.

The stage's side of a live swap. The dresser's process has made the costume; here it goes to the
GPU in slices of 0.1 ms, in the time that is left between two frames.
"""

from __future__ import annotations

import time
from collections.abc import Generator

import numpy as np

from hypermask.errors import HypermaskError
from hypermask.stage.costume import read_costume
from hypermask.workers.board import CURTAIN, Board
from hypermask.workers.cast import Cast
from hypermask.workers.retry import Report

_STEP_S = 0.0006
"""Time that a slice may take, with a reserve: it is not begun later than this before the end."""
_MOST_GUESTS = 8


class Wings:
    """Follows `Board.wardrobe`; writes `Board.curtain`: what can be drawn by now."""

    def __init__(self, cast: Cast, board: Board, report: Report) -> None:
        self._cast, self._board, self._report = cast, board, report
        self._started = 0
        self._ready = 0
        self._steps: Generator[None, None, None] | None = None
        self._guests: list[str] = []

    def abandon(self) -> None:
        """Whoever is being dressed stays away; before the context goes."""
        if self._steps is not None:
            self._steps.close()
            self._steps = None

    def work(self, now_s: float, spare_s: float) -> None:
        """Dress who waits for at most `spare_s`; what is not done goes on next time.

        One step is done even without spare time: nobody waits for ever before a stage that is busy.
        now_s: clock time, for messages.
        """
        end_s = time.perf_counter() + spare_s
        while self._steps is not None or self._begin():
            self._step(now_s)
            if time.perf_counter() + _STEP_S > end_s:
                return

    def _begin(self) -> bool:
        record = self._board.wardrobe.latest()
        if record is None or int(record["latest"]) <= self._started:
            return False
        waiting = sorted(
            (int(entry["version"]), entry["name"].decode(), entry["file"].decode())
            for entry in record["costumes"]
            if int(entry["version"]) > self._started
        )
        self._started, name, file = waiting[0]
        self._steps = self._dress(name, file)
        return True

    def _dress(self, name: str, file: str) -> Generator[None, None, None]:
        assert self._board.folder is not None
        costume = read_costume(self._board.folder / file)
        yield
        is_guest = name in self._guests or name not in self._cast.names
        yield from self._cast.join(name, costume)
        if not is_guest:
            return
        self._guests = [*(guest for guest in self._guests if guest != name), name]
        if len(self._guests) > _MOST_GUESTS:
            self._cast.leave(self._guests.pop(0))

    def _step(self, now_s: float) -> None:
        assert self._steps is not None
        try:
            next(self._steps)
            return
        except StopIteration:
            pass
        except HypermaskError as error:
            self._report(now_s, error.code, str(error))
        self._steps = None
        self._ready = self._started
        record = np.zeros((), CURTAIN)
        record["dressed"] = self._ready
        self._board.curtain.publish(record)
