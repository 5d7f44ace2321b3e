"""Which usage of a USB keyboard is which of our keys: HID Usage Tables 1.12, page 7 (keyboard)."""

from __future__ import annotations

_PAD = ["numlock", "slash", "star", "minus", "plus", "enter", *"123456789", "0", "dot"]

USAGES: dict[int, str] = {
    **{0x53 + index: key for index, key in enumerate(_PAD)},
    # A whole keyboard's digits and its keys of the same names do as well.
    **{0x1E + index: key for index, key in enumerate("1234567890")},
    0x28: "enter",
    0x2A: "backspace",
    0x2D: "minus",
    0x37: "dot",
    0x38: "slash",
}
"""Usage -> a key of `KEYS`. What NumLock is set to matters only to who turns usages into text."""

ROLLOVER = 0x01
"""ErrorRollOver: too many keys are down for the keyboard to tell which."""

MATRIX_4X4: tuple[tuple[str, ...], ...] = (
    ("7", "8", "9", "slash"),
    ("4", "5", "6", "star"),
    ("1", "2", "3", "minus"),
    ("0", "dot", "enter", "plus"),
)
