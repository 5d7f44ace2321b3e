"""One thread that does what may take long, one thing at a time, so that the worker never waits.

A transfer on a bus whose wires are broken, or the restart of a USB device, can take a second.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Protocol

Action = Callable[[], None]


class Background(Protocol):
    @property
    def busy(self) -> bool: ...
    def start(self, action: Action) -> None:
        """Do it, some time; only when not busy. `action` must not raise."""


class OnTheSpot:
    """Does it at once: for tests and on virtual clocks."""

    busy = False

    def start(self, action: Action) -> None:
        action()


class OneThread:
    """A daemon thread that lives from the first action on; it never keeps the process from
    ending."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[Action] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._idle = threading.Event()
        self._idle.set()

    @property
    def busy(self) -> bool:
        return not self._idle.is_set()

    def start(self, action: Action) -> None:
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="devices", daemon=True)
            self._thread.start()
        self._idle.clear()
        self._waiting.put(action)

    def _work(self) -> None:
        while True:
            action = self._waiting.get()
            try:
                action()
            finally:
                self._idle.set()
