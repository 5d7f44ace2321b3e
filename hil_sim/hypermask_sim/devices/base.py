"""What the simulated devices share: being absent, lost and back by the scenario's faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, TypeVar

from hypermask_drivers.clock import Clock, VirtualClock
from hypermask_drivers.device import Device, DeviceState
from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost
from hypermask_sim.world import World

Item = TypeVar("Item")


class SimDevice(Device):
    """kind: as in `faults.LOSSES`; code: first part of its error codes; noun: for messages.

    Under a virtual clock nothing sleeps: a read with a timeout returns what is there.
    """

    kind: ClassVar[str]
    code: ClassVar[str]
    noun: ClassVar[str]

    def __init__(self, world: World, clock: Clock) -> None:
        super().__init__()
        self.world = world
        self.clock = clock
        self._checked_s = 0.0

    def now(self) -> float:
        """Scenario time in seconds."""
        return self.clock.now() - self.world.origin_s

    def open(self) -> None:
        now = self.now()
        if self.world.faults.lost(self.kind, now, now):
            raise DeviceAbsent(
                f"{self.code}-ABSENT",
                f"there is no {self.noun}",
                "Check the cable; it is retried every second.",
            )
        self._checked_s = now
        self._opened(now)
        self._state = DeviceState.READY

    def close(self) -> None:
        self._state = DeviceState.ABSENT

    def _opened(self, now_s: float) -> None:
        """What a device does when it is opened at scenario time `now_s`."""

    def _check(self) -> float:
        """Scenario time now. Raises `DeviceError` when not open, `DeviceLost` when vanished."""
        now = self.now()
        if self._state is DeviceState.ABSENT:
            raise DeviceError(
                f"{self.code}-CLOSED", f"the {self.noun} is not open", "Open it first."
            )
        if self._state is DeviceState.LOST or self.world.faults.lost(
            self.kind, self._checked_s, now
        ):
            self._state = DeviceState.LOST
            raise DeviceLost(
                f"{self.code}-LOST",
                f"the {self.noun} vanished",
                "Check the cable; it is retried every second.",
            )
        self._checked_s = now
        return now

    def _wait_for(
        self, take: Callable[[float], Item | None], next_s: Callable[[], float], timeout_s: float
    ) -> Item | None:
        """What `take` gives at scenario time now or, on a real clock, within `timeout_s`.

        next_s: clock time at which the next item is due.
        """
        deadline = self.clock.now() + timeout_s
        while True:
            item = take(self._check())
            if item is not None or isinstance(self.clock, VirtualClock):
                return item
            if self.clock.now() >= deadline:
                return None
            self.clock.sleep_until(min(deadline, next_s()))
