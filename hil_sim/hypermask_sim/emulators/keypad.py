"""A USB keypad at report level: stands in for the module `hid` (hidapi, libusb back end)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hypermask_drivers.clock import Clock

USAGES = {
    "numlock": 0x53, "slash": 0x54, "star": 0x55, "minus": 0x56, "plus": 0x57, "enter": 0x58,
    **{str(digit): 0x58 + digit for digit in range(1, 10)},
    "0": 0x62, "dot": 0x63, "backspace": 0x2A,
}  # fmt: skip
"""HID Usage Tables, page 7, keypad."""
_MOST = 6


class Fingers:
    """Which keys are down when, by clock time."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self._changes: list[tuple[float, str, bool]] = []

    def press(self, key: str, time_s: float, held_s: float = 0.08) -> None:
        self._changes += [(time_s, key, True), (time_s + held_s, key, False)]
        self._changes.sort(key=lambda change: change[0])

    def take(self) -> list[tuple[str, bool]]:
        """Changes that are due and were not taken yet."""
        now = self.clock.now()
        due = [(key, pressed) for time_s, key, pressed in self._changes if time_s <= now]
        self._changes = self._changes[len(due) :]
        return due


@dataclass
class EmulatedPad:
    """path: as sysfs names the interface. usage: (0, 0) where the back end cannot tell."""

    fingers: Fingers
    path: str = "1-1:1.0"
    vendor: int = 0x0627
    product: int = 0x0001
    name: str = "QEMU USB Keyboard"
    usage: tuple[int, int] = (1, 6)
    boot_keyboard: bool = True
    plugged: bool = True
    busy: bool = False
    plugs: int = 0
    down: list[str] = field(default_factory=list)
    reports: deque[list[int]] = field(default_factory=deque)

    def play(self) -> None:
        """Reports of what the fingers have done by now; lost while unplugged."""
        for key, pressed in self.fingers.take():
            if pressed:
                self.down.append(key)
            elif key in self.down:
                self.down.remove(key)
            self.say()

    def say(self) -> None:
        """Boot report: modifiers, reserved, six usages; all ErrorRollOver when there are more."""
        usages = [USAGES[key] for key in self.down]
        if len(usages) > _MOST:
            usages = [0x01] * _MOST
        if self.plugged:
            self.reports.append([0, 0, *usages, *[0] * (_MOST - len(usages))])

    def unplug(self) -> None:
        self.play()
        self.plugged = False
        self.reports.clear()
        self.down.clear()

    def plug(self) -> None:
        self.play()
        self.down.clear()
        self.plugged = True
        self.plugs += 1

    def write_sysfs(self, root: Path) -> None:
        """The interface's class as the kernel shows it."""
        folder = root / "bus/usb/devices" / self.path
        folder.mkdir(parents=True)
        protocol = "01" if self.boot_keyboard else "00"
        for name, value in (("Class", "03"), ("SubClass", protocol), ("Protocol", protocol)):
            (folder / f"bInterface{name}").write_text(f"{value}\n")


class EmulatedHid:
    """`hid` with `enumerate` and `device`; `detached` are the interfaces that the kernel lost."""

    def __init__(self, *pads: EmulatedPad) -> None:
        self.pads = list(pads)
        self.detached: set[str] = set()

    def enumerate(self, vendor_id: int = 0, product_id: int = 0) -> list[dict[str, Any]]:
        return [
            {
                "path": pad.path.encode(),
                "vendor_id": pad.vendor,
                "product_id": pad.product,
                "manufacturer_string": None,
                "product_string": pad.name,
                "usage_page": pad.usage[0],
                "usage": pad.usage[1],
                "interface_number": int(pad.path[-1]),
            }
            for pad in self.pads
            if pad.plugged and vendor_id in (0, pad.vendor) and product_id in (0, pad.product)
        ]

    def device(self) -> EmulatedHidDevice:
        return EmulatedHidDevice(self)


class EmulatedHidDevice:
    def __init__(self, hid: EmulatedHid) -> None:
        self._hid = hid
        self._pad: EmulatedPad | None = None
        self._plug = 0

    def open_path(self, path: bytes) -> None:
        for pad in self._hid.pads:
            if pad.plugged and not pad.busy and pad.path.encode() == path:
                pad.play()
                self._pad, self._plug = pad, pad.plugs
                self._hid.detached.add(pad.path)
                return
        raise OSError("open failed")

    def set_nonblocking(self, flag: int) -> int:
        return 0

    def read(self, length: int, timeout_ms: int = 0) -> list[int]:
        pad = self._pad
        if pad is None:
            raise ValueError("not open")
        if not pad.plugged or pad.plugs != self._plug:
            raise OSError("read error")
        pad.play()
        return pad.reports.popleft()[:length] if pad.reports else []

    def close(self) -> None:
        if self._pad is not None:
            self._hid.detached.discard(self._pad.path)
        self._pad = None
