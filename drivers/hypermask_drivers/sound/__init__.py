"""Sound-in interface: mono blocks with the time of their first sample."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.device import Device


@dataclass(frozen=True)
class SoundBlock:
    """samples: (n,) float32, full scale 1.0; time_s: when the first one was heard, by the clock;
    broken: how many of the samples were no numbers and stand here as 0."""

    samples: NDArray[np.float32]
    rate_hz: float
    time_s: float
    overruns: int  # blocks lost before this one since `open`
    broken: int = 0


class SoundIn(Device):
    @property
    @abstractmethod
    def rate_hz(self) -> float: ...

    @abstractmethod
    def read(self, timeout_s: float) -> SoundBlock | None:
        """The oldest block not yet read, or None within `timeout_s` (0 never waits).

        Raises `DeviceLost` when the sound card vanished.
        """
