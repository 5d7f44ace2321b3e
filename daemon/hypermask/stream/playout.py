"""From datagrams that come unevenly, or not, to an even performance a little later."""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from hypermask.geometry import Pose
from hypermask.stream.face_code import UNITS, between
from hypermask.stream.mouth_code import MOUTHS, PARAMETERS
from hypermask.stream.packet import BLOCK_S, MOUTH_S, Block

Array = NDArray[np.float64]
State = Literal["absent", "playing", "lost"]
T = TypeVar("T")

LOST_S = 0.3
"""Without a datagram for so long the stream is lost: mouth closed, face neutral, head unknown."""
_CLOSING_S = 0.1
_BRIDGED = 16
"""Mouths (20 ms) that are bridged between two that came."""
_HELD_S, _SHUT_S = 0.06, 0.16
_KEPT_S = 1.5
_SLEW = 0.005
_STRAY_S = 1.0
_REMEMBERED_S = 16


@dataclass(frozen=True)
class Performance:
    """What is to be seen now. mouth: (13,); units: (88,); head: camera_from_mask or None."""

    state: State
    mouth: Array
    units: Array
    head: Pose | None
    level_db: float


class Playout:
    """A jitter buffer of `buffer_s` between the performance and its play.

    The sender's time is its block numbers; how it lies to this clock is told by the datagrams that
    came fastest, so both quartzes may differ. Memory is bounded whatever comes.
    """

    def __init__(self, buffer_s: float) -> None:
        self._buffer_s = buffer_s
        self._session: int | None = None
        self._arrived_s = -math.inf
        self._reset(-1)

    def _reset(self, session: int) -> None:
        self._session = session if session >= 0 else None
        self._mouths: dict[int, tuple[Array, bool]] = {}
        self._units: _Track[Array] = _Track()
        self._heads: _Track[Pose] = _Track()
        self._level_db = -100.0
        self._offset_s = math.nan
        self._updated_s = 0.0
        self._fastest: deque[tuple[int, float]] = deque()

    def state(self, now_s: float) -> State:
        if self._session is None:
            return "absent"
        return "lost" if now_s - self._arrived_s > LOST_S else "playing"

    def add(self, block: Block, arrival_s: float) -> bool:
        """Take a block that arrived then; False when it comes from the wrong time."""
        if block.session != self._session:
            self._reset(block.session)
        sent_s = (block.number + 1) * BLOCK_S - MOUTH_S
        lag_s = arrival_s - sent_s
        if abs(lag_s - self._offset_s) > _STRAY_S:
            if self.state(arrival_s) == "playing":
                return False
            self._reset(block.session)
        self._synchronise(lag_s, arrival_s)
        self._arrived_s = arrival_s
        self._keep(block)
        self._forget(arrival_s)
        return True

    def at(self, now_s: float) -> Performance:
        """What is to be seen at `now_s`."""
        state = self.state(now_s)
        if state != "playing":
            return Performance(state, np.zeros(PARAMETERS), np.zeros(UNITS), None, -100.0)
        play_s = now_s - self._slewed(now_s) - self._buffer_s
        silent_s = now_s - self._arrived_s
        share = 1.0 - _smooth((silent_s - (LOST_S - _CLOSING_S)) / _CLOSING_S)
        units = self._units.at(play_s, lambda a, b, x: a + x * (b - a))
        return Performance(
            state,
            self._mouth(play_s / MOUTH_S) * share,
            np.zeros(UNITS) if units is None else units * share,
            self._heads.at(play_s, between),
            self._level_db,
        )

    def _synchronise(self, lag_s: float, now_s: float) -> None:
        """The smallest lag of the last seconds is the network's own; the rest is waiting."""
        second = math.floor(now_s)
        if self._fastest and self._fastest[-1][0] == second:
            self._fastest[-1] = (second, min(self._fastest[-1][1], lag_s))
        else:
            self._fastest.append((second, lag_s))
        while self._fastest[0][0] < second - _REMEMBERED_S:
            self._fastest.popleft()
        if math.isnan(self._offset_s):
            self._offset_s, self._updated_s = lag_s, now_s

    def _slewed(self, now_s: float) -> float:
        """Moves to the newest knowledge so slowly that nobody sees it."""
        wanted_s = min(lag for _, lag in self._fastest)
        off_s = wanted_s - self._offset_s
        step_s = (_SLEW + 0.2 * abs(off_s)) * max(now_s - self._updated_s, 0.0)
        self._updated_s = max(now_s, self._updated_s)
        if abs(off_s) > 0.5 * self._buffer_s:
            step_s = abs(off_s)
        self._offset_s += min(max(off_s, -step_s), step_s)
        return self._offset_s

    def _keep(self, block: Block) -> None:
        first = block.number * MOUTHS
        for index in range(MOUTHS):
            self._mouths[first + index] = (block.mouths[index], True)
            if block.before is not None:
                place = first - MOUTHS + index
                if not self._mouths.get(place, (None, False))[1]:
                    self._mouths[place] = (block.before[index], False)
        time_s = (block.number + 1) * BLOCK_S - MOUTH_S
        if block.units is not None:
            self._units.add(time_s, block.units)
        if block.head is not None:
            self._heads.add(time_s, block.head)
        self._level_db = block.level_db

    def _forget(self, now_s: float) -> None:
        oldest_s = now_s - self._offset_s - self._buffer_s - _KEPT_S
        oldest = math.floor(oldest_s / MOUTH_S)
        for place in [place for place in self._mouths if place < oldest]:
            del self._mouths[place]
        self._units.forget(oldest_s)
        self._heads.forget(oldest_s)

    def _mouth(self, place: float) -> Array:
        """(13,) at that many mouths since the session's start."""
        below = self._next(math.floor(place), -1)
        if below is None:
            return np.zeros(PARAMETERS)
        above = self._next(math.floor(place) + 1, 1)
        first = self._mouths[below][0]
        if above is not None and above - below <= _BRIDGED:
            share = (place - below) / (above - below)
            return np.asarray(first + share * (self._mouths[above][0] - first))
        age_s = (place - below) * MOUTH_S
        return np.asarray(first * (1.0 - _smooth((age_s - _HELD_S) / (_SHUT_S - _HELD_S))))

    def _next(self, place: int, step: int) -> int | None:
        for candidate in range(place, place + step * (_BRIDGED + 1), step):
            if candidate in self._mouths:
                return candidate
        return None


class _Track(Generic[T]):
    """Values at times, a few."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._values: list[T] = []

    def add(self, time_s: float, value: T) -> None:
        place = bisect.bisect_left(self._times, time_s)
        if place == len(self._times) or self._times[place] != time_s:
            self._times.insert(place, time_s)
            self._values.insert(place, value)

    def forget(self, before_s: float) -> None:
        """The last one before stays: it still holds."""
        place = max(bisect.bisect_left(self._times, before_s) - 1, 0)
        del self._times[:place], self._values[:place]

    def at(self, time_s: float, mix: Callable[[T, T, float], T]) -> T | None:
        """Between the two around `time_s`; the last one holds; None before the first."""
        place = bisect.bisect_right(self._times, time_s)
        if place == 0:
            return None
        if place == len(self._times):
            return self._values[-1]
        first_s, second_s = self._times[place - 1 : place + 1]
        share = (time_s - first_s) / (second_s - first_s)
        return mix(self._values[place - 1], self._values[place], share)


def _smooth(x: float) -> float:
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)
