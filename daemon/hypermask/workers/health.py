"""How each worker is: a record of its own on the blackboard, written about twice a second.

It stays when the worker dies, with the moment of its last work, so that whoever looks at the
board from outside sees which worker hangs, died or came back.
"""

from __future__ import annotations

import os
from collections import deque
from pathlib import Path

import numpy as np

from hypermask.blackboard import ReadTopic, Record, SharedTopic
from hypermask.errors import HypermaskError
from hypermask_drivers.clock import Clock

HEALTH = np.dtype(
    [
        ("pid", "<i8"),
        ("started_s", "<f8"),  # CLOCK_MONOTONIC, as all times
        ("time_s", "<f8"),  # when this was written
        ("work_s", "<f8"),  # the last time that work was done
        ("first_s", "<f8"),  # the first one; of the stage: the first flip with a face
        ("steps", "<i8"),  # pieces of work: frames, flips, blocks of sound, keys
        ("p50_ms", "<f8"),  # of the worker's own latency, over its latest steps
        ("p99_ms", "<f8"),
        ("max_ms", "<f8"),
        ("missed", "<i8"),  # flips missed, frames dropped, blocks lost
        ("losses", "<i8"),  # how often the device vanished
        ("ready", "?"),  # whether the device is there
        ("restarts", "<i8"),  # how often this worker began anew on this blackboard
        ("state", "S16"),  # starting, working, waiting, idle, stopped
        ("granted", "S64"),  # what the operating system allowed
        ("fault", "S48"),  # code of the last thing that went wrong
    ]
)
PREFIX = "health-"
EVERY_S = 0.5
KEPT = 512
"""So many of the latest latencies make the figures."""


def topic(folder: Path, name: str) -> SharedTopic:
    """Raises `HypermaskError` BOARD-LAYOUT."""
    return SharedTopic(folder / f"{PREFIX}{name}", HEALTH)


class Health:
    """One worker's own record; `folder` None keeps it in memory alone."""

    def __init__(self, folder: Path | None, name: str, clock: Clock) -> None:
        self._clock = clock
        self._topic = None if folder is None else topic(folder, name)
        self._latencies_s: deque[float] = deque(maxlen=KEPT)
        self._most_s = 0.0
        self._next_s = -np.inf
        self.record: Record = np.zeros((), HEALTH)
        before = None if self._topic is None else self._topic.latest()
        if before is not None:
            self.record["restarts"] = int(before["restarts"]) + 1
        self.record["pid"], self.record["started_s"] = os.getpid(), clock.now()
        self.record["state"] = b"starting"

    @property
    def kept(self) -> bool:
        """Whether the record is on a blackboard."""
        return self._topic is not None

    def worked(
        self,
        latency_s: float | None = None,
        missed: int = 0,
        steps: int = 1,
        first: bool = True,
    ) -> None:
        """Work was done; latency_s: how long it took, or how late it was; first: whether it may
        count as the first of its kind."""
        record, now_s = self.record, self._clock.now()
        if first and not record["first_s"]:
            record["first_s"] = now_s
        record["work_s"] = now_s
        record["steps"] += steps
        record["missed"] += missed
        if latency_s is not None:
            self._latencies_s.append(latency_s)
            self._most_s = max(self._most_s, latency_s)

    def device(self, ready: bool) -> None:
        """Whether the worker's device is there now."""
        record = self.record
        if record["ready"] and not ready:
            record["losses"] += 1
        record["ready"] = ready

    def fault(self, code: str) -> None:
        self.record["fault"] = code.encode()[:48]

    def say(self, state: str) -> None:
        self.record["state"] = state.encode()

    def publish(self, now: bool = False) -> None:
        """Write the record when half a second has passed since the last time, or `now`."""
        time_s = self._clock.now()
        if self._topic is None or (time_s < self._next_s and not now):
            return
        self._next_s = time_s + EVERY_S
        record = self.record
        record["time_s"] = time_s
        if self._latencies_s:
            p50, p99 = np.percentile(self._latencies_s, (50, 99))
            record["p50_ms"], record["p99_ms"] = p50 * 1e3, p99 * 1e3
            record["max_ms"] = self._most_s * 1e3
        self._topic.publish(record)


class Healths:
    """All workers' records as somebody outside sees them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._topics: dict[str, ReadTopic] = {}

    def all(self) -> dict[str, Record]:
        """By the worker's name, of those that ever began on this blackboard."""
        for path in self._folder.glob(f"{PREFIX}*"):
            name = path.name.removeprefix(PREFIX)
            if name not in self._topics:
                try:
                    self._topics[name] = ReadTopic(path, HEALTH)
                except HypermaskError:
                    continue  # another version's: whoever owns it makes it anew
        found = {name: one.latest() for name, one in sorted(self._topics.items())}
        return {name: record for name, record in found.items() if record is not None}
