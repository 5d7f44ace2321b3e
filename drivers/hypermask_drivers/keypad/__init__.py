"""Keypad interface: key presses of a numeric pad."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from hypermask_drivers.device import Device

KEYS = (
    *"0123456789", "dot", "enter", "plus", "minus", "star", "slash", "backspace", "numlock",
)  # fmt: skip
"""The keys of a USB numeric keypad (HID usage page 7, 0x53 to 0x63) and its backspace."""


@dataclass(frozen=True)
class KeyEvent:
    """A key of `KEYS`, pressed or released, at clock time `time_s`."""

    key: str
    pressed: bool
    time_s: float


class Keypad(Device):
    @abstractmethod
    def read(self, timeout_s: float) -> KeyEvent | None:
        """The oldest event not yet read, or None within `timeout_s` (0 never waits).

        Raises `DeviceLost` when the keypad was unplugged.
        """
