"""Pan-tilt interface: two axes in radians, positive pan to the left, positive tilt up."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from hypermask_drivers.device import Device


@dataclass(frozen=True)
class PanTiltState:
    pan_rad: float
    tilt_rad: float
    moving: bool
    time_s: float


@dataclass(frozen=True)
class PanTiltLimits:
    pan_rad: tuple[float, float]
    tilt_rad: tuple[float, float]
    speed_rad_s: float


class PanTilt(Device):
    @property
    @abstractmethod
    def limits(self) -> PanTiltLimits: ...

    @abstractmethod
    def home(self) -> None:
        """Find the axes' zero. Raises `DeviceLost`."""

    @abstractmethod
    def move(self, pan_rad: float, tilt_rad: float, speed_rad_s: float) -> None:
        """Set a new target; returns at once. Values outside the limits are clamped to them."""

    @abstractmethod
    def halt(self) -> None:
        """Stop both axes at once."""

    @abstractmethod
    def read(self) -> PanTiltState: ...
