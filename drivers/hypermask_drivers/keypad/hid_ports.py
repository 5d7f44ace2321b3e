"""Finding the keypad among the HID interfaces of hidapi's libusb back end.

That back end names interfaces as sysfs does (`1-1.2:1.0`: bus, ports, configuration, interface),
and need not know what they are for; sysfs does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_HID, _BOOT, _KEYBOARD = "03", "01", "01"
_PAD_WORDS = ("keypad", "numpad", "numeric", "number pad")


@dataclass(frozen=True)
class Port:
    """usb: the place in the tree of ports, `1-1.2`, which stays when devices are renumbered."""

    path: bytes
    usb: str
    vendor: int
    product: int
    words: str
    usage: tuple[int, int]

    @property
    def is_pad(self) -> bool:
        return self.usage == (1, 7) or any(word in self.words.lower() for word in _PAD_WORDS)


def keyboards(found: Sequence[dict[str, Any]], sysfs: Path) -> list[Port]:
    """The interfaces that can be read as keyboards, of all that `hid.enumerate()` found."""
    return [_port(entry) for entry in found if _is_keyboard(entry, sysfs)]


def _port(entry: dict[str, Any]) -> Port:
    path = bytes(entry["path"])
    words = f"{entry.get('manufacturer_string') or ''} {entry.get('product_string') or ''}"
    return Port(
        path,
        path.decode("ascii", "replace").split(":")[0],
        int(entry["vendor_id"]),
        int(entry["product_id"]),
        words.strip(),
        (int(entry.get("usage_page") or 0), int(entry.get("usage") or 0)),
    )


def _is_keyboard(entry: dict[str, Any], sysfs: Path) -> bool:
    usage = (entry.get("usage_page") or 0, entry.get("usage") or 0)
    if usage[0]:
        return usage in ((1, 6), (1, 7))
    folder = sysfs / "bus/usb/devices" / bytes(entry["path"]).decode("ascii", "replace")
    try:
        kind = [
            (folder / f"bInterface{name}").read_text().strip()
            for name in ("Class", "SubClass", "Protocol")
        ]
    except OSError:
        return False
    return kind == [_HID, _BOOT, _KEYBOARD]
