"""The simulated numeric keypad: the scenario's keys, and those an operator presses."""

from __future__ import annotations

import heapq

from hypermask_drivers.clock import Clock
from hypermask_drivers.errors import UsageError
from hypermask_drivers.keypad import KEYS, KeyEvent, Keypad
from hypermask_sim.devices.base import SimDevice
from hypermask_sim.world import World

HELD_S = 0.08


class SimKeypad(SimDevice, Keypad):
    """Presses come at `performer.keys`; what is pressed while unplugged is lost."""

    kind, code, noun = "keypad", "KEY", "keypad"

    def __init__(self, world: World, clock: Clock) -> None:
        super().__init__(world, clock)
        self._events: list[tuple[float, int, str, bool]] = []  # scenario time, order, key, pressed
        self._order = 0
        for time_s, key in world.scenario.performer.keys:
            self._add(time_s, key)

    def _add(self, time_s: float, key: str, held_s: float = HELD_S) -> None:
        for time, pressed in ((time_s, True), (time_s + held_s, False)):
            heapq.heappush(self._events, (time, self._order, key, pressed))
            self._order += 1

    def press(self, key: str, time_s: float | None = None, held_s: float = HELD_S) -> None:
        """Press and release a key at clock time `time_s` (now without it), as a finger would.

        Raises `UsageError` KEY-NAME for a key that no keypad has.
        """
        if key not in KEYS:
            raise UsageError("KEY-NAME", f"there is no key '{key}'", f"Keys: {', '.join(KEYS)}.")
        self._add(self.now() if time_s is None else time_s - self.world.origin_s, key, held_s)

    def _opened(self, now_s: float) -> None:
        while self._events and self._events[0][0] < now_s:
            heapq.heappop(self._events)

    def next_event_s(self) -> float:
        """Clock time of the next event; infinite when none is left."""
        return self._events[0][0] + self.world.origin_s if self._events else float("inf")

    def read(self, timeout_s: float) -> KeyEvent | None:
        return self._wait_for(self._take, self.next_event_s, timeout_s)

    def _take(self, now_s: float) -> KeyEvent | None:
        if not self._events or self._events[0][0] > now_s + 1e-9:
            return None
        time_s, _, key, pressed = heapq.heappop(self._events)
        return KeyEvent(key, pressed, time_s + self.world.origin_s)
