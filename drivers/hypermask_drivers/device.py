"""What every device has in common: open, close and a state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from types import TracebackType
from typing import Self


class DeviceState(Enum):
    ABSENT = "absent"  # never seen, or closed
    OPENING = "opening"
    READY = "ready"
    LOST = "lost"  # was ready and vanished; open() may bring it back


class Device(ABC):
    """A piece of hardware behind an interface.

    `open` raises `DeviceAbsent` when the hardware is not there; a method of an open device raises
    `DeviceLost` when it vanishes, and the state becomes LOST. `open` may then be called again.
    `close` never raises and may be called in any state.
    """

    def __init__(self) -> None:
        self._state = DeviceState.ABSENT

    @property
    def state(self) -> DeviceState:
        return self._state

    @abstractmethod
    def open(self) -> None: ...

    @abstractmethod
    def close(self) -> None: ...

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
