"""Pan-tilt interface: two axes in radians, positive pan to the left, positive tilt up."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from hypermask_drivers.device import Device


@dataclass(frozen=True)
class PanTiltState:
    """homed: the zero is known. limit_hits: how often an axis ran into its end since opening,
    which a unit that knows its zero never does."""

    pan_rad: float
    tilt_rad: float
    moving: bool
    time_s: float
    homed: bool = True
    limit_hits: int = 0


@dataclass(frozen=True)
class PanTiltLimits:
    """step_rad: the coarser axis' resolution, 0 where positions are continuous."""

    pan_rad: tuple[float, float]
    tilt_rad: tuple[float, float]
    speed_rad_s: float
    step_rad: float = 0.0


class PanTilt(Device):
    @property
    @abstractmethod
    def limits(self) -> PanTiltLimits: ...

    @abstractmethod
    def home(self) -> None:
        """Begin to find the axes' zero; returns at once. Raises `DeviceLost`.

        Until it is found, `read` says moving, and not homed.
        """

    @abstractmethod
    def move(self, pan_rad: float, tilt_rad: float, speed_rad_s: float) -> None:
        """Set a new target; returns at once. Values outside the limits are clamped to them."""

    @abstractmethod
    def halt(self) -> None:
        """Stop both axes at once."""

    @abstractmethod
    def read(self) -> PanTiltState: ...
