"""Scans of a key matrix to presses and releases: debounced, and without ghosts."""

from __future__ import annotations

import itertools
from collections import deque

from hypermask_drivers.keypad import KeyEvent

Scan = tuple[int, ...]
"""A bit mask of closed columns for each row."""


def is_ambiguous(scan: Scan) -> bool:
    """Three keys at the corners of a rectangle close the fourth: two rows share two columns."""
    return any((a & b).bit_count() > 1 for a, b in itertools.combinations(scan, 2))


class Matrix:
    """A change counts once it was the same in every scan for `debounce_s`."""

    def __init__(self, layout: tuple[tuple[str, ...], ...], debounce_s: float) -> None:
        self._layout, self._debounce_s = layout, debounce_s
        self._settled: Scan = (0,) * len(layout)
        self._candidate = self._settled
        self._since_s = 0.0
        self.events: deque[KeyEvent] = deque()

    def take(self, scan: Scan, now_s: float) -> None:
        """One scan of all rows at clock time `now_s`."""
        if is_ambiguous(scan):
            self._candidate = self._settled
            return
        if scan != self._candidate:
            self._candidate, self._since_s = scan, now_s
        if self._candidate != self._settled and now_s - self._since_s >= self._debounce_s:
            self._settle(scan, now_s)

    def _settle(self, scan: Scan, now_s: float) -> None:
        before, self._settled = self._settled, scan
        for pressed in (False, True):
            for row, keys in enumerate(self._layout):
                changed = (scan[row] & ~before[row]) if pressed else (before[row] & ~scan[row])
                for column, key in enumerate(keys):
                    if key and changed >> column & 1:
                        self.events.append(KeyEvent(key, pressed, now_s))
