"""Texas Instruments' current monitors INA219 and INA226 at the cart's battery.

INA219: datasheet SBOS448G, register map in section 8.6, calibration in 8.5.1 (equations 1 to 5).
INA226: datasheet SBOS547, register map in section 7.1, calibration in 6.5.1 (equations 1 to 4).
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

from pydantic import Field

from hypermask_drivers.clock import Clock, RealClock
from hypermask_drivers.errors import DeviceError
from hypermask_drivers.i2c import Connect, I2cHardware, signed
from hypermask_drivers.power import Power, PowerReading
from hypermask_drivers.power.battery import Battery, BatterySettings
from hypermask_drivers.settings import Settings

CONFIGURATION, SHUNT, BUS, POWER, CURRENT, CALIBRATION = range(6)
MANUFACTURER, DIE = 0xFE, 0xFF


class Ina2xxSettings(Settings):
    """most_a: full scale of the current. reversed: where the shunt's wires are the other way
    round, so that a load counts as charging."""

    device: str = "/dev/hypermask/i2c"
    address: int = Field(0x40, ge=0x08, le=0x77)
    shunt_ohm: float = Field(0.1, gt=0, le=10)
    most_a: float = Field(3.2, gt=0, le=1000)
    reversed: bool = False
    battery: BatterySettings = BatterySettings()


class Raw(NamedTuple):
    """Volts at the load, amperes, watts, as the chip computes them."""

    voltage_v: float
    current_a: float
    power_w: float


class _Ina2xx(I2cHardware, Power):
    code, noun = "PWR", "battery monitor"
    chip: ClassVar[str]
    _scale: ClassVar[float]  # of the calibration register
    _most: ClassVar[int]  # what that register holds
    _watts: ClassVar[float]  # power step, in current steps
    _shunt_full_v: ClassVar[float]

    def __init__(
        self,
        settings: Ina2xxSettings | None = None,
        clock: Clock | None = None,
        connect: Connect | None = None,
    ) -> None:
        self.settings = settings or Ina2xxSettings()
        super().__init__(self.settings.device, self.settings.address, connect)
        self._clock = clock or RealClock()
        self._battery = Battery(self.settings.battery)

    @property
    def current_step_a(self) -> float:
        """The chip's current register counts in these. Full scale over 15 bits or, where the
        calibration is at its most, coarser: a small shunt."""
        return self._scale / (self.calibration * self.settings.shunt_ohm)

    @property
    def calibration(self) -> int:
        """Both chips ignore the lowest bit of the INA219's, so it stays clear."""
        wanted_step_a = self.settings.most_a / 2**15
        value = int(self._scale / (wanted_step_a * self.settings.shunt_ohm))
        return min(value, self._most) & ~1

    def _begin(self) -> None:
        if self.settings.most_a * self.settings.shunt_ohm > self._shunt_full_v * 1.001:
            self._absent(
                "RANGE",
                f"{self.settings.most_a} A through {self.settings.shunt_ohm} ohm is more than"
                f" the {self._shunt_full_v * 1000:.0f} mV that the {self.chip} measures",
                "Lower most_a or take a smaller shunt.",
            )
        self._identify()
        self._write_word(CONFIGURATION, self._configuration())
        self._write_word(CALIBRATION, self.calibration)
        if self._read_word(CALIBRATION) & ~1 != self.calibration:
            self._absent(
                "STRANGE", f"what answers at {self.place} is no {self.chip}", "Check the address."
            )
        self._battery = Battery(self.settings.battery)

    def _identify(self) -> None:
        """Raises `DeviceAbsent` PWR-STRANGE where the chip can say that it is another."""

    def _configuration(self) -> int:
        raise NotImplementedError

    def _bus_v(self, word: int) -> float:
        raise NotImplementedError

    def measure(self) -> Raw:
        """Raises `DeviceLost` PWR-LOST, also when the chip forgot its calibration, and
        `DeviceError` PWR-OVERFLOW."""
        with self._talking():
            if self._read_word(CALIBRATION) & ~1 != self.calibration:
                self._was_reset()
            voltage = self._bus_v(self._read_word(BUS))
            current = signed(self._read_word(CURRENT)) * self.current_step_a
            power = self._read_word(POWER) * self._watts * self.current_step_a
        return Raw(voltage, -current if self.settings.reversed else current, power)

    def read(self) -> PowerReading:
        raw, now_s = self.measure(), self._clock.now()
        charge, level = self._battery.follow(raw.voltage_v, raw.current_a, now_s)
        return PowerReading(raw.voltage_v, raw.current_a, charge, now_s, level)


class Ina219(_Ina2xx):
    """The bus register counts 4 mV from bit 3 on; bit 0 says that the mathematics overflowed."""

    chip = "INA219"
    _scale, _most, _watts, _shunt_full_v = 0.04096, 0xFFFE, 20.0, 0.32

    def _configuration(self) -> int:
        """32 V range (bit 13), shunt gain by its full scale (bits 12:11), 12 bit of 128 averages
        (1111 in bits 10:7 and 6:3), both continuously (111)."""
        full_v = self.settings.most_a * self.settings.shunt_ohm
        gain = next(code for code, top in enumerate((0.04, 0.08, 0.16, 1e9)) if full_v <= top)
        return 1 << 13 | gain << 11 | 0b1111 << 7 | 0b1111 << 3 | 0b111

    def _bus_v(self, word: int) -> float:
        if word & 1:
            raise DeviceError(
                "PWR-OVERFLOW",
                f"the current is more than {self.settings.most_a} A",
                "Raise most_a, or find what draws it.",
            )
        return (word >> 3) * 0.004


class Ina226(_Ina2xx):
    """The bus register counts 1.25 mV; the calibration register has 15 bits."""

    chip = "INA226"
    _scale, _most, _watts, _shunt_full_v = 0.00512, 0x7FFF, 25.0, 0.08192

    def _identify(self) -> None:
        if self._read_word(MANUFACTURER) != 0x5449 or self._read_word(DIE) >> 4 != 0x226:
            self._absent(
                "STRANGE", f"what answers at {self.place} is no INA226", "Check the address."
            )

    def _configuration(self) -> int:
        """Bit 14 is always set; 64 averages (011 in bits 11:9), 1.1 ms each (100), continuously."""
        return 1 << 14 | 0b011 << 9 | 0b100 << 6 | 0b100 << 3 | 0b111

    def _bus_v(self, word: int) -> float:
        return word * 0.00125
