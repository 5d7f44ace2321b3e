"""Watches the picture of a virtual cart from outside, against the guest's own clock.

The clock is the ACPI power management timer, read through QEMU's monitor: it counts guest time at
3.579545 MHz in 24 bits (ACPI 6.5, 4.8.3.3), however fast or slow the host lets the guest run.
"""

from __future__ import annotations

import contextlib
import hashlib
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.errors import HypermaskError
from hypermask_sim.appliance.monitor import Monitor

TIMER_HZ = 3579545
_TIMER_BITS = 24
_TIMER_PORT = 0x608
DARK = 10
"""Grey level below which a pixel counts as dark."""


class GuestClock:
    """Seconds of guest time since it was made. Must be read at least every four guest seconds."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._last = self._count()
        self._ticks = 0

    def _count(self) -> int:
        told = self._monitor.human(f"i /w {_TIMER_PORT:#x}")
        return int(told.split("=")[1], 16) & ((1 << _TIMER_BITS) - 1)

    def now(self) -> float:
        count = self._count()
        self._ticks += (count - self._last) % (1 << _TIMER_BITS)
        self._last = count
        return self._ticks / TIMER_HZ


@dataclass(frozen=True)
class Glance:
    """One look at the screen: guest time before and after it, a number of the picture's bytes, the
    share of its pixels that are lit, and its height (480 is QEMU's own, before there is a mode)."""

    before_s: float
    after_s: float
    picture: str
    lit: float
    height: int


@dataclass
class Watcher:
    """Looks as often as it can until it is stopped.

    first_light: the first picture of each height that was not dark.
    """

    monitor: Monitor
    glances: list[Glance] = field(default_factory=list)
    first_light: dict[int, NDArray[np.uint8]] = field(default_factory=dict)
    pause_s: float = 0.4

    def __post_init__(self) -> None:
        self.clock = GuestClock(self.monitor)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._now_s = 0.0

    @property
    def now_s(self) -> float:
        """Guest time of the latest look."""
        return self._now_s

    def start(self) -> None:
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        with contextlib.suppress(OSError, HypermaskError):  # the machine was switched off
            while not self._stop.is_set():
                try:
                    self.look()
                except HypermaskError as error:
                    if error.code == "APL-GONE":
                        raise
                    self._now_s = self.clock.now()  # there is no picture at this moment
                time.sleep(self.pause_s)

    def look(self) -> NDArray[np.uint8]:
        before_s = self.clock.now()
        picture = self.monitor.screenshot()
        self._now_s = self.clock.now()
        lit = float((picture.max(axis=2) >= DARK).mean())
        if lit:
            self.first_light.setdefault(picture.shape[0], picture)
        number = hashlib.blake2b(picture.tobytes(), digest_size=8).hexdigest()
        self.glances.append(Glance(before_s, self._now_s, number, lit, picture.shape[0]))
        return picture

    def between(self, start_s: float, end_s: float) -> list[Glance]:
        return [each for each in self.glances if start_s <= each.before_s <= end_s]


def longest_freeze_s(
    glances: Sequence[Glance], least_lit: float = 0.005, furthest_s: float = 0.5
) -> float:
    """The longest guest time for which the same lit picture certainly stood: from the end of the
    first look that saw it until the begin of the last one. Darkness is no freeze.

    furthest_s: looks that are further apart mean that the host let QEMU stand still, which answers
    whatever its guest does; no more than this is counted of the time between them.
    """
    longest = stood_s = from_s = 0.0
    last: Glance | None = None
    for glance in glances:
        if last is None or glance.picture != last.picture:
            stood_s, from_s = 0.0, glance.after_s
        else:
            stood_s += min(glance.before_s - from_s, furthest_s)
            from_s = glance.before_s
            longest = max(longest, stood_s)
        last = glance if glance.lit >= least_lit else None
    return longest


def dark_moments(glances: Sequence[Glance], least_lit: float = 0.005) -> list[str]:
    """What a reader wants to know of each look without light: when, and how long after the one
    before it."""
    return [
        f"at {glance.before_s:.2f} s, {glance.before_s - before.after_s:.2f} s after the last look"
        for before, glance in pairwise(glances)
        if glance.lit < least_lit
    ]
