"""Camera interface: 8-bit grey frames with the time of mid-exposure and a sequence number."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.device import Device


@dataclass(frozen=True)
class Frame:
    """One camera frame.

    image: (height, width) uint8; read-only, valid until the next `read`.
    time_s: clock time of mid-exposure.
    sequence: counts exposed frames; a gap means dropped frames.
    """

    image: NDArray[np.uint8]
    time_s: float
    sequence: int


@dataclass(frozen=True)
class CameraMode:
    """What the camera really delivers (read back, not what was asked for)."""

    width: int
    height: int
    rate_hz: float
    exposure_s: float


class Camera(Device):
    @property
    @abstractmethod
    def mode(self) -> CameraMode:
        """The delivered mode. Raises `DeviceError` before `open`."""

    @abstractmethod
    def read(self, timeout_s: float) -> Frame | None:
        """The oldest frame not yet read, or None when none arrived within `timeout_s`.

        A timeout of 0 never waits. Raises `DeviceLost` when the camera vanished.
        """

    @abstractmethod
    def set_exposure(self, exposure_s: float) -> float:
        """Set the exposure time; returns the time the camera really uses, in seconds."""

    @abstractmethod
    def shift_phase(self, delay_s: float) -> float:
        """Delay the coming frames by about `delay_s` seconds (may be negative), once.

        Done on real sensors by a few longer or shorter vertical blankings. Lets the tracker put
        the frame's arrival just before the projector's latch. Returns the delay really applied; 0
        from a camera that cannot.
        """
