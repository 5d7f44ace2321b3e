"""A DLPC34xx display controller, command by command (programmer's guide DLPU020)."""

from __future__ import annotations

from hypermask_sim.emulators.i2c import Chip

_PAIRS = {0x16: (0x17, 1), 0x50: (0x51, 1), 0x52: (0x53, 1), 0x54: (0x55, 6)}
"""Write command -> read command and number of parameters."""


class Dlpc34xxChip(Chip):
    """Currents above `most_current` are cut to it, as the LED driver does."""

    def __init__(self, temperature_c: float = 41.5, most_current: int = 800) -> None:
        super().__init__()
        self.temperature_c, self.most_current = temperature_c, most_current
        self.system_status = [0, 0, 0, 0]
        self.power_cycle()

    def power_cycle(self) -> None:
        """It comes up lit, its currents steered by the picture (method 1: CAIC)."""
        self.ready = True
        self.parameters = {
            0x17: [0], 0x51: [1], 0x53: [0b111], 0x55: [0x30, 2, 0x30, 2, 0x30, 2],
        }  # fmt: skip

    def write_block(self, register: int, data: list[int]) -> None:
        if register not in _PAIRS:
            return
        read, length = _PAIRS[register]
        if len(data) != length:
            return
        self.parameters[read] = self._cut(data) if register == 0x54 else list(data)

    def _cut(self, data: list[int]) -> list[int]:
        cut: list[int] = []
        for low, high in zip(data[::2], data[1::2], strict=True):
            cut += divmod(min(low | high << 8, self.most_current), 256)[::-1]
        return cut

    def read_block(self, register: int, length: int) -> list[int]:
        lit = self.parameters[0x53][0] & 0b111
        tenths = round(self.temperature_c * 10)
        status = [self.system_status[0], self.system_status[1] | lit, *self.system_status[2:]]
        answers = {
            0xD0: [int(self.ready)],
            0xD1: status,
            0xD6: [tenths & 0xFF, tenths >> 8],
            **self.parameters,
        }
        return (answers.get(register, []) + [0] * length)[:length]
