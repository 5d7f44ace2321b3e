"""A device that vanishes is told once, asked for every second, and told once when it is back."""

from __future__ import annotations

from hypermask.workers.retry import Kept
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.device import Device, DeviceState
from hypermask_drivers.errors import DeviceAbsent, DeviceLost


class Flaky(Device):
    """There when `present`; counts how often it was asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.present = True
        self.opened = 0

    def open(self) -> None:
        self.opened += 1
        if not self.present:
            raise DeviceAbsent("FLK-ABSENT", "it is not there", "Plug it in.")
        self._state = DeviceState.READY

    def close(self) -> None:
        self._state = DeviceState.ABSENT

    def work(self) -> int:
        if not self.present:
            self._state = DeviceState.LOST
            raise DeviceLost("FLK-LOST", "it vanished", "Plug it in.")
        return 7


def kept() -> tuple[Kept[Flaky], VirtualClock, list[str]]:
    clock, told = VirtualClock(), list[str]()
    return Kept(Flaky(), "flaky", clock, lambda time_s, code, text: told.append(code)), clock, told


def test_a_device_that_is_there_is_opened_once_and_used() -> None:
    device, _, told = kept()
    assert [device.use(Flaky.work) for _ in range(3)] == [7, 7, 7]
    assert device.device.opened == 1 and told == []


def test_a_loss_is_told_once_and_the_return_once() -> None:
    device, clock, told = kept()
    device.use(Flaky.work)
    device.device.present = False
    for _ in range(50):
        assert device.use(Flaky.work) is None
        clock.sleep_until(clock.now() + 0.1)
    assert told == ["FLK-LOST"]
    device.device.present = True
    clock.sleep_until(clock.now() + 1.0)
    assert device.use(Flaky.work) == 7
    assert told == ["FLK-LOST", "FLAKY-BACK"]


def test_it_is_asked_for_once_a_second() -> None:
    device, clock, _ = kept()
    device.device.present = False
    for _ in range(40):
        device.use(Flaky.work)
        clock.sleep_until(clock.now() + 0.1)
    assert device.device.opened == 4


def test_a_device_that_was_never_there_is_told_once() -> None:
    device, clock, told = kept()
    device.device.present = False
    for _ in range(30):
        device.use(Flaky.work)
        clock.sleep_until(clock.now() + 0.1)
    assert told == ["FLK-ABSENT"]
