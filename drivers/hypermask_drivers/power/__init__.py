"""Power interface: the cart's battery."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Literal

from hypermask_drivers.device import Device

Level = Literal["good", "low", "critical", "unknown"]


@dataclass(frozen=True)
class PowerReading:
    """current_a: out of the battery. charge: 0 (empty) to 1 (full), None where the monitor cannot
    tell. level: low is the time to change the battery, critical the time to stop."""

    voltage_v: float
    current_a: float
    charge: float | None
    time_s: float
    level: Level = "unknown"

    @property
    def power_w(self) -> float:
        return self.voltage_v * self.current_a


class Power(Device):
    @abstractmethod
    def read(self) -> PowerReading: ...
