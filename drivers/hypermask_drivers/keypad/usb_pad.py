"""USB numeric keypads by hidapi: boot keyboard reports (USB HID 1.11, appendix B.1) to our keys.

Debian's python3-hid uses hidapi's libusb back end, which takes the interface away from the
kernel's keyboard driver: keys never reach a login prompt.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import Field

from hypermask_drivers.clock import Clock, RealClock, VirtualClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.hardware import Hardware, needed, plain
from hypermask_drivers.keypad import KeyEvent, Keypad
from hypermask_drivers.keypad.hid_ports import Port, keyboards
from hypermask_drivers.keypad.layout import ROLLOVER, USAGES
from hypermask_drivers.settings import Settings

_REPORT = 8
_BACKLOG = 64


class UsbPadSettings(Settings):
    """vendor, product: USB numbers, both or neither. port: the USB port, such as "1-1.2".

    Without any of them: the only numeric pad there is, or else the only keyboard.
    """

    vendor: int | None = Field(None, ge=0, le=0xFFFF)
    product: int | None = Field(None, ge=0, le=0xFFFF)
    port: str | None = None


class UsbPad(Hardware, Keypad):
    code, noun, place = "KEY", "keypad", "USB"

    def __init__(
        self,
        settings: UsbPadSettings | None = None,
        clock: Clock | None = None,
        hid: Any = None,
        sysfs: Path = Path("/sys"),
    ) -> None:
        super().__init__()
        self.settings = settings or UsbPadSettings()
        self._clock = clock or RealClock()
        self._hid, self._sysfs = hid, sysfs
        self._device: Any = None
        self._down: tuple[str, ...] = ()
        self._events: deque[KeyEvent] = deque()

    def open(self) -> None:
        """Raises `DeviceAbsent` KEY-ABSENT, KEY-CHOICE, KEY-RIGHTS, KEY-LEAK or DRV-MODULE."""
        if self._state is DeviceState.READY:
            return
        self._state = DeviceState.ABSENT
        hid = self._hid or needed("hid", "python3-hid")
        port = self._choose(keyboards(hid.enumerate(), self._sysfs))
        if port.path.startswith(b"/dev/hidraw"):
            self._absent(
                "LEAK",
                f"the keypad's keys would reach the login prompt too ({port.path.decode()})",
                "Install python3-hid with its libusb back end.",
            )
        self.place = f"USB port {port.usb}"
        device = hid.device()
        try:
            device.open_path(port.path)
            device.set_nonblocking(1)
        except OSError:
            self._absent(
                "RIGHTS",
                f"the keypad at {self.place} cannot be opened",
                "Install the udev rules and join the group hypermask; stop what uses it.",
            )
        self._device = device
        self._down, self._events = (), deque()
        self._state = DeviceState.READY
        self._forget_backlog()

    def _choose(self, ports: Sequence[Port]) -> Port:
        settings = self.settings
        fitting = [
            port
            for port in ports
            if settings.port in (None, port.usb)
            and settings.vendor in (None, port.vendor)
            and settings.product in (None, port.product)
        ]
        named = settings.port is not None or settings.vendor is not None
        fitting = [port for port in fitting if port.is_pad] or fitting
        places = {port.usb for port in fitting}
        if not fitting:
            self._absent("ABSENT", "there is no USB keypad", "Plug it in.")
        if len(places) > 1 and not named:
            self._absent(
                "CHOICE",
                f"there are {len(places)} keyboards, at the USB ports {', '.join(sorted(places))}",
                "Name the keypad's port, or its vendor and product.",
            )
        return fitting[0]

    def _forget_backlog(self) -> None:
        """What was pressed before now is nobody's business."""
        for _ in range(_BACKLOG):
            if not self._report(0):
                break

    def _release(self) -> None:
        device, self._device = self._device, None
        if device is not None:
            with contextlib.suppress(Exception):
                device.close()

    def _report(self, timeout_ms: int) -> list[int]:
        try:
            if timeout_ms > 0:
                found: list[int] = self._device.read(64, timeout_ms)
            else:
                found = self._device.read(64)
        except (OSError, ValueError) as error:
            self._vanished(plain(error))
        return found

    def read(self, timeout_s: float) -> KeyEvent | None:
        self._check()
        deadline = self._clock.now() + timeout_s
        while not self._events:
            left_s = deadline - self._clock.now()
            waits = left_s > 0 and not isinstance(self._clock, VirtualClock)
            report = self._report(max(1, round(left_s * 1000)) if waits else 0)
            if report:
                self._take(report)
            elif not waits:
                return None
        return self._events.popleft()

    def _take(self, report: list[int]) -> None:
        """Releases, then presses, of one report against the one before."""
        down = pressed_keys(report)
        if down is None:
            return
        now = self._clock.now()
        released = [key for key in self._down if key not in down]
        pressed = [key for key in down if key not in self._down]
        self._events.extend(KeyEvent(key, False, now) for key in released)
        self._events.extend(KeyEvent(key, True, now) for key in pressed)
        self._down = down


def pressed_keys(report: list[int]) -> tuple[str, ...] | None:
    """The keys that are down by a boot report: modifiers, a reserved byte, six usages.

    None for a report that says nothing: rollover (more keys than it can tell), or another kind.
    A report of nine bytes has its number in front.
    """
    if len(report) == _REPORT + 1:
        report = report[1:]
    if len(report) != _REPORT or ROLLOVER in report[2:]:
        return None
    return tuple(dict.fromkeys(USAGES[usage] for usage in report[2:] if usage in USAGES))
