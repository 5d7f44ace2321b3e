"""State of charge from voltage and current: a curve for the chemistry, helped by counting charge.

The curves are rested open-circuit voltages of one cell at 25 degrees C, as battery makers print
them; a battery under load shows `current * resistance` less.
"""

from __future__ import annotations

import bisect
from typing import Literal

from pydantic import Field

from hypermask_drivers.power import Level
from hypermask_drivers.settings import Settings

Curve = tuple[tuple[float, float], ...]

CURVES: dict[str, Curve] = {
    "lead_acid": (
        (1.75, 0.0), (1.90, 0.05), (1.95, 0.2), (1.985, 0.4), (2.03, 0.6), (2.075, 0.8),
        (2.115, 1.0),
    ),
    "li_ion": (
        (3.00, 0.0), (3.30, 0.03), (3.50, 0.1), (3.60, 0.2), (3.70, 0.45), (3.85, 0.65),
        (4.00, 0.83), (4.18, 1.0),
    ),
    "lifepo4": (
        (2.50, 0.0), (3.00, 0.08), (3.20, 0.2), (3.25, 0.35), (3.28, 0.5), (3.31, 0.7),
        (3.34, 0.9), (3.40, 1.0),
    ),
}  # fmt: skip
"""Chemistry -> (volts of a cell, charge 0 to 1), rising."""


class BatterySettings(Settings):
    """cells: in series. capacity_ah: without it, charge comes from the voltage alone.

    settle_s: how quickly the voltage's word prevails over the counted charge.
    """

    chemistry: Literal["lead_acid", "li_ion", "lifepo4"] = "lead_acid"
    cells: int = Field(6, ge=1, le=64)
    capacity_ah: float | None = Field(None, gt=0, le=10000)
    resistance_ohm: float = Field(0.05, ge=0, le=10)
    settle_s: float = Field(900.0, gt=0)
    low: float = Field(0.2, ge=0, le=1)
    critical: float = Field(0.08, ge=0, le=1)
    hysteresis: float = Field(0.03, ge=0, le=0.5)


class Battery:
    """Follows the charge through readings with rising times."""

    def __init__(self, settings: BatterySettings) -> None:
        self._settings = settings
        self._time_s: float | None = None
        self._charge = 0.0
        self._level: Level = "unknown"

    def follow(self, voltage_v: float, current_a: float, time_s: float) -> tuple[float, Level]:
        """Charge 0 to 1 and what to think of it."""
        settings = self._settings
        told = self.by_voltage(voltage_v, current_a)
        if self._time_s is None:
            self._charge = told
        else:
            step_s = max(0.0, time_s - self._time_s)
            if settings.capacity_ah is not None:
                self._charge -= current_a * step_s / 3600 / settings.capacity_ah
            span_s = settings.settle_s if settings.capacity_ah is not None else 30.0
            self._charge += (told - self._charge) * min(1.0, step_s / span_s)
        self._time_s = time_s
        self._charge = min(max(self._charge, 0.0), 1.0)
        self._level = self._judge(self._charge)
        return self._charge, self._level

    def by_voltage(self, voltage_v: float, current_a: float) -> float:
        """Charge that the open-circuit voltage stands for."""
        settings = self._settings
        cell_v = (voltage_v + current_a * settings.resistance_ohm) / settings.cells
        curve = CURVES[settings.chemistry]
        index = bisect.bisect([volts for volts, _ in curve], cell_v)
        if index in (0, len(curve)):
            return curve[0][1] if index == 0 else curve[-1][1]
        (low_v, low), (high_v, high) = curve[index - 1], curve[index]
        return low + (high - low) * (cell_v - low_v) / (high_v - low_v)

    def _judge(self, charge: float) -> Level:
        """A level once reached is left only by more than the hysteresis, so that it is steady."""
        settings = self._settings
        slack = settings.hysteresis
        critical = settings.critical + (slack if self._level == "critical" else 0.0)
        low = settings.low + (slack if self._level in ("low", "critical") else 0.0)
        if charge <= critical:
            return "critical"
        return "low" if charge <= low else "good"
