"""Chips on an I2C bus, by SMBus transfers only, so that the kernel's i2c-stub can stand in."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Callable, Iterator
from typing import Any, NoReturn, Protocol

from hypermask_drivers.device import DeviceState
from hypermask_drivers.errors import DeviceError
from hypermask_drivers.hardware import Hardware, needed

NO_ANSWER = frozenset({errno.EREMOTEIO, errno.ENXIO, errno.EIO, errno.ETIMEDOUT})


class Bus(Protocol):
    """What is used of `smbus2.SMBus`; every method raises `OSError` when no chip answers."""

    def read_byte(self, address: int) -> int: ...
    def write_byte(self, address: int, value: int) -> None: ...
    def read_byte_data(self, address: int, register: int) -> int: ...
    def write_byte_data(self, address: int, register: int, value: int) -> None: ...
    def read_word_data(self, address: int, register: int) -> int: ...
    def write_word_data(self, address: int, register: int, value: int) -> None: ...
    def read_i2c_block_data(self, address: int, register: int, length: int) -> list[int]: ...
    def write_i2c_block_data(self, address: int, register: int, data: list[int]) -> None: ...
    def close(self) -> None: ...


Connect = Callable[[str], Bus]


def open_bus(device: str) -> Bus:
    """The bus at `/dev/i2c-1` or a stable name for it. Raises `OSError`, DRV-MODULE."""
    bus: Any = needed("smbus2", "python3-smbus2").SMBus(device)
    found: Bus = bus
    return found


class I2cHardware(Hardware):
    """A chip at an address of a bus. Subclasses set `_begin`, and use the transfers below."""

    def __init__(self, device: str, address: int, connect: Connect | None) -> None:
        super().__init__()
        self.place = f"{device} address 0x{address:02x}"
        self._device, self._address = device, address
        self._connect = connect or open_bus
        self._bus: Bus | None = None

    def open(self) -> None:
        """Raises `DeviceAbsent` X-BUS, X-RIGHTS, X-ABSENT, X-STRANGE or DRV-MODULE."""
        if self._state is DeviceState.READY:
            return
        self._state = DeviceState.OPENING
        try:
            self._bus = self._connect(self._device)
        except DeviceError:
            self._state = DeviceState.ABSENT
            raise
        except PermissionError:
            self._absent("RIGHTS", f"{self._device} may not be opened", "Join the group i2c.")
        except OSError:
            self._absent("BUS", f"there is no I2C bus {self._device}", "Enable the bus.")
        try:
            self._begin()
        except DeviceError:
            self._release()
            self._state = DeviceState.ABSENT
            raise
        except OSError as error:
            self._no_answer(error)
        self._state = DeviceState.READY

    def _begin(self) -> None:
        """Prepare the chip; an `OSError` means that nobody answers."""
        raise NotImplementedError

    def _no_answer(self, error: OSError) -> NoReturn:
        if error.errno == errno.EBUSY:
            self._absent(
                "BUSY",
                f"a driver of the kernel uses the {self.noun} at {self.place}",
                "Remove it from the device tree or unbind it.",
            )
        self._absent(
            "ABSENT",
            f"no {self.noun} answers at {self.place}",
            "Check its wires, its power and its address.",
        )

    def _release(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(Exception):
                bus.close()

    @property
    def _chip(self) -> Bus:
        assert self._bus is not None
        return self._bus

    @contextlib.contextmanager
    def _talking(self) -> Iterator[Bus]:
        """Inside, an `OSError` means that the chip is lost."""
        self._check()
        try:
            yield self._chip
        except OSError as error:
            self._vanished(error)

    def _was_reset(self) -> NoReturn:
        """The chip forgot what it was told: it was without power."""
        self._vanished("it was without power for a moment")

    def _read_word(self, register: int) -> int:
        """16 bits, high byte first as TI's chips send them (SMBus sends the low byte first)."""
        return swapped(self._chip.read_word_data(self._address, register))

    def _write_word(self, register: int, value: int) -> None:
        self._chip.write_word_data(self._address, register, swapped(value))


def swapped(word: int) -> int:
    return (word & 0xFF) << 8 | word >> 8


def signed(word: int) -> int:
    """Two's complement of 16 bits."""
    return word - 0x10000 if word & 0x8000 else word
