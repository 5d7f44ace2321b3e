"""One axis of a pan-tilt unit: between radians and the unit's steps."""

from __future__ import annotations

import math

_ARC_SECOND = math.radians(1 / 3600)


class Axis:
    """One axis in the unit's steps: letter P or T, radians a step, limits, speeds in steps/s."""

    def __init__(self, letter: str, values: dict[str, float], soft_deg: tuple[float, float]):
        self.letter = letter
        self.sign = 1
        self.step_rad = values["r"] * _ARC_SECOND
        soft = [math.radians(angle) / self.step_rad for angle in soft_deg]
        self.low = max(math.ceil(values["n"]), math.ceil(min(soft)))
        self.high = min(math.floor(values["x"]), math.floor(max(soft)))
        self.slowest, self.fastest = max(1, math.ceil(values["l"])), math.floor(values["u"])

    @property
    def range_rad(self) -> tuple[float, float]:
        ends = sorted(self.sign * end * self.step_rad for end in (self.low, self.high))
        return ends[0], ends[1]

    def steps(self, angle_rad: float) -> int:
        """Clamped to the limits."""
        wanted = self.sign * angle_rad / self.step_rad
        return round(min(max(wanted, self.low), self.high))

    def speed(self, speed_rad_s: float) -> int:
        """Never faster than told, except that the unit cannot go slower than its lower bound."""
        return min(max(int(abs(speed_rad_s) / self.step_rad), self.slowest), self.fastest)
