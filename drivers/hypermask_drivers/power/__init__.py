"""Power interface: the cart's battery."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from hypermask_drivers.device import Device


@dataclass(frozen=True)
class PowerReading:
    """charge: 0 (empty) to 1 (full), None where the monitor cannot tell."""

    voltage_v: float
    current_a: float
    charge: float | None
    time_s: float


class Power(Device):
    @abstractmethod
    def read(self) -> PowerReading: ...
