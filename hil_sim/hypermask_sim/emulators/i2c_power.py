"""INA219 (SBOS448G, section 8.6) and INA226 (SBOS547, section 7.1), register by register."""

from __future__ import annotations

from typing import ClassVar

from hypermask_sim.emulators.i2c import Analog, Chip


def _swapped(word: int) -> int:
    return (word & 0xFF) << 8 | word >> 8


class InaChip(Chip):
    """Measures when it is read. SMBus words come low byte first, the chip sends its high byte."""

    start: ClassVar[int]
    shunt_step_v: ClassVar[float]

    def __init__(self, analog: Analog, shunt_ohm: float) -> None:
        super().__init__()
        self._analog, self._shunt_ohm = analog, shunt_ohm
        self.power_cycle()

    def power_cycle(self) -> None:
        self.configuration, self.calibration = self.start, 0

    def write_word_data(self, register: int, value: int) -> None:
        word = _swapped(value)
        if register == 0:
            if word & 0x8000:
                self.power_cycle()
            else:
                self.configuration = word
        elif register == 5:
            self.calibration = self._kept(word)

    def read_word_data(self, register: int) -> int:
        return _swapped(self._word(register) & 0xFFFF)

    def _word(self, register: int) -> int:
        volts, amperes = self._analog()
        shunt = round(amperes * self._shunt_ohm / self.shunt_step_v)
        shunt = min(max(shunt, -0x8000), 0x7FFF)
        current = self._current(shunt)
        registers = {
            0: self.configuration,
            1: shunt,
            2: self._bus(volts, current),
            3: self._power(volts, current),
            4: min(max(current, -0x8000), 0x7FFF),
            5: self.calibration,
        }
        return registers.get(register, 0)

    def _kept(self, word: int) -> int:
        return word

    def _current(self, shunt: int) -> int:
        raise NotImplementedError

    def _bus(self, volts: float, current: int) -> int:
        raise NotImplementedError

    def _power(self, volts: float, current: int) -> int:
        raise NotImplementedError


class Ina219Chip(InaChip):
    start, shunt_step_v = 0x399F, 10e-6

    def _kept(self, word: int) -> int:
        return word & ~1  # FS0 is always 0, section 8.6.4.1

    def _current(self, shunt: int) -> int:
        return shunt * self.calibration // 4096

    def _bus(self, volts: float, current: int) -> int:
        overflow = abs(current) > 0x7FFF
        return (min(round(volts / 0.004), 8000) << 3) | 0b10 | int(overflow)

    def _power(self, volts: float, current: int) -> int:
        return abs(current) * round(volts / 0.004) // 5000


class Ina226Chip(InaChip):
    start, shunt_step_v = 0x4127, 2.5e-6

    def _kept(self, word: int) -> int:
        return word & 0x7FFF  # bit 15 is not there

    def _current(self, shunt: int) -> int:
        return shunt * self.calibration // 2048

    def _bus(self, volts: float, current: int) -> int:
        return min(round(volts / 0.00125), 0x7FFF)

    def _power(self, volts: float, current: int) -> int:
        return abs(current) * round(volts / 0.00125) // 20000

    def _word(self, register: int) -> int:
        return {0xFE: 0x5449, 0xFF: 0x2260}.get(register) or super()._word(register)
