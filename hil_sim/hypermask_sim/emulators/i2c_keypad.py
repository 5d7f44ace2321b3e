"""Matrix keypads on I2C: a PCF8574 (SCPS068) with keys at its pins, and a TCA8418 (SCPS215)."""

from __future__ import annotations

from collections import deque

from hypermask_sim.emulators.i2c import Chip
from hypermask_sim.emulators.keypad import Fingers

Layout = tuple[tuple[str, ...], ...]


def _place(layout: Layout, key: str) -> tuple[int, int]:
    for row, keys in enumerate(layout):
        if key in keys:
            return row, keys.index(key)
    raise KeyError(key)


class Pcf8574Matrix(Chip):
    """Pins that are written 1 are weak; a closed key joins a row's pin and a column's."""

    def __init__(self, fingers: Fingers, layout: Layout) -> None:
        super().__init__()
        self._fingers, self._layout = fingers, layout
        self.closed: set[tuple[int, int]] = set()
        self.latch = 0xFF

    def power_cycle(self) -> None:
        self.latch = 0xFF

    def write_byte(self, value: int) -> None:
        self.latch = value

    def read_byte(self) -> int:
        for key, pressed in self._fingers.take():
            place = _place(self._layout, key)
            if pressed:
                self.closed.add(place)
            else:
                self.closed.discard(place)
        level = self.latch
        for _ in range(8):  # low spreads through closed keys: that is where ghosts come from
            for row, column in self.closed:
                pins = 0x10 << row | 1 << column
                if level & pins != pins:
                    level &= ~pins
        return level


class Tca8418Chip(Chip):
    """Ten events; a register for each pin says whether it belongs to the keypad."""

    def __init__(self, fingers: Fingers, layout: Layout) -> None:
        super().__init__()
        self._fingers, self._layout = fingers, layout
        self._memory: deque[int] = deque()

    def power_cycle(self) -> None:
        self.words = [0] * 256
        self._memory.clear()

    def _play(self) -> None:
        for key, pressed in self._fingers.take():
            row, column = _place(self._layout, key)
            if not (self.words[0x1D] >> row & 1 and self.words[0x1E] >> column & 1):
                continue
            self._memory.append((0x80 if pressed else 0) | 10 * row + column + 1)
            self.words[0x02] |= 0x01
            if len(self._memory) > 10:
                self.words[0x02] |= 0x08
                self._memory.popleft() if self.words[0x01] & 0x20 else self._memory.pop()

    def read_byte_data(self, register: int) -> int:
        self._play()
        if register == 0x03:
            return len(self._memory)
        if register == 0x04:
            return self._memory.popleft() if self._memory else 0
        return self.words[register] & 0xFF

    def write_byte_data(self, register: int, value: int) -> None:
        self._play()
        if register == 0x02:
            self.words[0x02] &= ~value
        else:
            self.words[register] = value
