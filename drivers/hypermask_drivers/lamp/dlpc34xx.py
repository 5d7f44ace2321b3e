"""The light of projectors with Texas Instruments' DLPC34xx controllers, over I2C.

Command numbers and parameters: Software Programmer's Guide DLPU020 (DLPC3430, 3433, 3435, 3438)
and DLPU116 (DLPC3436), "System Write/Read Commands". Address 36h written with its direction bit,
that is 0x1B. Reads give the command's number first and then take the parameters.
"""

from __future__ import annotations

import math
import struct

from pydantic import Field

from hypermask_drivers.clock import Clock, RealClock
from hypermask_drivers.errors import DeviceError
from hypermask_drivers.i2c import Connect, I2cHardware
from hypermask_drivers.lamp import Lamp, LampState
from hypermask_drivers.settings import Settings

WRITE_CURTAIN, READ_CURTAIN = 0x16, 0x17
WRITE_METHOD, READ_METHOD = 0x50, 0x51  # LED output control: 0 is by RGB currents
WRITE_ENABLE, READ_ENABLE = 0x52, 0x53  # bit 0 red, 1 green, 2 blue
WRITE_CURRENT, READ_CURRENT = 0x54, 0x55  # three 10-bit numbers, low byte first
READ_SHORT_STATUS, READ_SYSTEM_STATUS, READ_TEMPERATURE = 0xD0, 0xD1, 0xD6

_INITIALISED = 0x01
_ALL = 0b111
_FAULTS = (
    (0, 0, "the mirror chip is wrong"), (0, 1, "the mirror chip does not answer"),
    (0, 2, "the mirror chip's link cannot be trained"), (1, 3, "the red LED fails"),
    (1, 4, "the green LED fails"), (1, 5, "the blue LED fails"),
    (2, 0, "the light sequence was aborted"), (2, 1, "the light sequence is wrong"),
    (3, 4, "its configuration does not fit"), (3, 5, "its watchdog has restarted it"),
)  # fmt: skip
"""Byte and bit of Read System Status (D1h), and what it means."""


class Dlpc34xxSettings(Settings):
    """full_current: codes of red, green and blue that are full brightness; they are the product's
    and set its white, so copy those that it starts with."""

    device: str = "/dev/hypermask/i2c"
    address: int = Field(0x1B, ge=0x08, le=0x77)
    full_current: tuple[int, int, int] = (560, 560, 560)


class Dlpc34xxLamp(I2cHardware, Lamp):
    code, noun = "LMP", "projector's light controller"

    def __init__(
        self,
        settings: Dlpc34xxSettings | None = None,
        clock: Clock | None = None,
        connect: Connect | None = None,
    ) -> None:
        self.settings = settings or Dlpc34xxSettings()
        super().__init__(self.settings.device, self.settings.address, connect)
        self._clock = clock or RealClock()
        self._on = False
        self._brightness = 1.0

    def _begin(self) -> None:
        """Raises `DeviceAbsent` LMP-STARTING until the controller has started."""
        status = self._ask(READ_SHORT_STATUS, 1)[0]
        if not status & _INITIALISED:
            self._absent("STARTING", f"the {self.noun} is still starting", "Wait a moment.")
        self._tell(WRITE_METHOD, b"\0")
        self._on = bool(self._ask(READ_ENABLE, 1)[0] & _ALL)
        self._brightness = self._share()
        if self._ask(READ_METHOD, 1)[0] & 0b11:
            self._absent(
                "STRANGE",
                f"the {self.noun} does not let its LED currents be set",
                "Check the address and the projector's type.",
            )

    def _ask(self, command: int, length: int) -> bytes:
        return bytes(self._chip.read_i2c_block_data(self._address, command, length))

    def _tell(self, command: int, data: bytes) -> None:
        self._chip.write_i2c_block_data(self._address, command, list(data))

    def _currents(self) -> tuple[int, ...]:
        return struct.unpack("<3H", self._ask(READ_CURRENT, 6))

    def _share(self) -> float:
        full = self.settings.full_current
        return min(1.0, sum(self._currents()) / sum(full)) if sum(full) else 0.0

    def _wanted(self) -> tuple[int, ...]:
        return tuple(round(full * self._brightness) for full in self.settings.full_current)

    def _apply(self) -> None:
        """Currents, then LEDs; both are read back. At no brightness the LEDs are off, because no
        current code is dark."""
        lit = _ALL if self._on and self._brightness > 0 else 0
        with self._talking():
            self._tell(WRITE_CURRENT, struct.pack("<3H", *self._wanted()))
            self._tell(WRITE_ENABLE, bytes([lit]))
            got = self._currents(), self._ask(READ_ENABLE, 1)[0] & _ALL
        if got != (self._wanted(), lit):
            raise DeviceError(
                "LMP-REFUSED",
                f"the {self.noun} was told {self._wanted()} and {lit:03b}, and says {got[0]}"
                f" and {got[1]:03b}",
                "Lower full_current to what the projector allows.",
            )

    def set_power(self, on: bool) -> None:
        """Raises `DeviceError` LMP-REFUSED when it reads back otherwise."""
        self._check()
        self._on = on
        self._apply()

    def set_brightness(self, brightness: float) -> None:
        """Raises `DeviceError` LAMP-RANGE, LMP-REFUSED."""
        self._check()
        if not (math.isfinite(brightness) and 0 <= brightness <= 1):
            raise DeviceError(
                "LAMP-RANGE", f"a brightness of {brightness} is not possible", "Give 0 to 1."
            )
        self._brightness = brightness
        self._apply()

    def set_curtain(self, closed: bool) -> None:
        """A black curtain over the picture, LEDs as they are (16h: bit 0 on, bits 3:1 colour)."""
        with self._talking():
            self._tell(WRITE_CURTAIN, bytes([int(closed)]))

    def read(self) -> LampState:
        """Raises `DeviceLost` LMP-LOST, also when the controller was restarted meanwhile."""
        with self._talking():
            method, lit = self._ask(READ_METHOD, 1)[0], self._ask(READ_ENABLE, 1)[0] & _ALL
            share, status = self._share(), self._ask(READ_SYSTEM_STATUS, 4)
            tenths = int.from_bytes(self._ask(READ_TEMPERATURE, 2), "little")
            if method & 0b11:
                self._was_reset()
        faults = tuple(text for byte, bit, text in _FAULTS if status[byte] >> bit & 1)
        on = bool(lit) or (self._on and self._brightness == 0)
        return LampState(on, share, tenths / 10 if tenths else None, faults)
