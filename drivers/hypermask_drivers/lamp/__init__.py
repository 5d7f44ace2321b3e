"""Lamp interface: the projector's light and power."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from hypermask_drivers.device import Device


@dataclass(frozen=True)
class LampState:
    """faults: what the projector says is wrong with it, in words."""

    on: bool
    brightness: float  # 0 to 1
    temperature_c: float | None
    faults: tuple[str, ...] = ()


class Lamp(Device):
    @abstractmethod
    def set_power(self, on: bool) -> None: ...

    @abstractmethod
    def set_brightness(self, brightness: float) -> None:
        """0 (dark) to 1 (full). Raises `DeviceError` LAMP-RANGE outside."""

    @abstractmethod
    def read(self) -> LampState: ...
