"""An I2C bus of emulated chips, with the transfers of smbus2 and the kernel's i2c-stub."""

from __future__ import annotations

import errno
from collections.abc import Callable


class Chip:
    """A bank of 256 registers of 16 bits, exactly as the kernel's i2c-stub module keeps them.

    A plain read takes the register under a pointer and moves it on; a plain write sets it.
    """

    def __init__(self) -> None:
        self.words = [0] * 256
        self.pointer = 0

    def read_byte(self) -> int:
        value = self.words[self.pointer] & 0xFF
        self.pointer = (self.pointer + 1) % 256
        return value

    def write_byte(self, value: int) -> None:
        self.pointer = value

    def read_byte_data(self, register: int) -> int:
        return self.words[register] & 0xFF

    def write_byte_data(self, register: int, value: int) -> None:
        self.words[register] = self.words[register] & 0xFF00 | value

    def read_word_data(self, register: int) -> int:
        return self.words[register]

    def write_word_data(self, register: int, value: int) -> None:
        self.words[register] = value

    def read_block(self, register: int, length: int) -> list[int]:
        return [self.words[register + index] & 0xFF for index in range(length)]

    def write_block(self, register: int, data: list[int]) -> None:
        for index, value in enumerate(data):
            self.words[register + index] = self.words[register + index] & 0xFF00 | value


class Wires:
    """What is wired to a bus; `connect` gives what `smbus2.SMBus` would."""

    def __init__(self, chips: dict[int, Chip] | None = None, device: str = "/dev/i2c-1") -> None:
        self.device = device
        self.chips: dict[int, Chip] = chips or {}
        self.present = True
        self.transfers = 0

    def connect(self, device: str) -> EmulatedBus:
        if device != self.device:
            raise FileNotFoundError(errno.ENOENT, "No such file or directory")
        return EmulatedBus(self)

    def chip(self, address: int) -> Chip:
        """Raises `OSError` EREMOTEIO, as the kernel does when nobody acknowledges."""
        self.transfers += 1
        if not self.present or address not in self.chips:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        return self.chips[address]


class EmulatedBus:
    def __init__(self, wires: Wires) -> None:
        self._wires = wires

    def read_byte(self, address: int) -> int:
        return self._wires.chip(address).read_byte()

    def write_byte(self, address: int, value: int) -> None:
        self._wires.chip(address).write_byte(value)

    def read_byte_data(self, address: int, register: int) -> int:
        return self._wires.chip(address).read_byte_data(register)

    def write_byte_data(self, address: int, register: int, value: int) -> None:
        self._wires.chip(address).write_byte_data(register, value)

    def read_word_data(self, address: int, register: int) -> int:
        return self._wires.chip(address).read_word_data(register)

    def write_word_data(self, address: int, register: int, value: int) -> None:
        self._wires.chip(address).write_word_data(register, value)

    def read_i2c_block_data(self, address: int, register: int, length: int) -> list[int]:
        return self._wires.chip(address).read_block(register, length)

    def write_i2c_block_data(self, address: int, register: int, data: list[int]) -> None:
        self._wires.chip(address).write_block(register, data)

    def close(self) -> None:
        pass


Analog = Callable[[], tuple[float, float]]
"""Volts at the load and amperes through the shunt, now."""
