"""Keeping a device open: one message when it is lost, one when it is back, a try every second."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from hypermask_drivers.clock import Clock
from hypermask_drivers.device import Device, DeviceState
from hypermask_drivers.errors import DeviceError

D = TypeVar("D", bound=Device)
T = TypeVar("T")

RETRY_S = 1.0

Report = Callable[[float, str, str], None]
"""Called with clock time, a stable code and a sentence."""


class Kept(Generic[D]):
    """A device that is opened again and again until it works."""

    def __init__(self, device: D, kind: str, clock: Clock, report: Report) -> None:
        self.device = device
        self._kind = kind
        self._clock = clock
        self._report = report
        self._next_try_s = -float("inf")
        self._complained = False
        self.tries = 0
        """How often opening was tried: whoever keeps trying is not hung."""

    @property
    def is_ready(self) -> bool:
        """Whether the device is open, without trying."""
        return self.device.state is DeviceState.READY

    def ready(self) -> bool:
        """True when the device is open; tries to open it when the last try is a second ago."""
        if self.device.state is DeviceState.READY:
            return True
        if self._clock.now() < self._next_try_s:
            return False
        self._next_try_s = self._clock.now() + RETRY_S
        self.tries += 1
        try:
            self.device.open()
        except DeviceError as error:
            self._complain(error)
            return False
        if self._complained:
            self._report(
                self._clock.now(), f"{self._kind.upper()}-BACK", f"The {self._kind} is back."
            )
        self._complained = False
        return True

    def use(self, action: Callable[[D], T]) -> T | None:
        """`action(device)`, or None while the device is absent."""
        if not self.ready():
            return None
        try:
            return action(self.device)
        except DeviceError as error:
            self._complain(error)
            self._next_try_s = self._clock.now() + RETRY_S
            return None

    def _complain(self, error: DeviceError) -> None:
        if not self._complained:
            self._report(self._clock.now(), error.code, str(error))
        self._complained = True
