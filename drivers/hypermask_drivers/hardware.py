"""What drivers of real hardware share: closed, lost, absent, and modules that may be missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any, ClassVar, NoReturn

from hypermask_drivers.device import Device, DeviceState
from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost

RETRIED = "It is retried every second."


class Hardware(Device):
    """code: first part of the error codes; noun: the device in messages; place: its stable name."""

    code: ClassVar[str]
    noun: ClassVar[str]
    place: str = ""

    def _check(self) -> None:
        """Raises `DeviceError` X-CLOSED when not open, `DeviceLost` X-LOST when it vanished."""
        if self._state is DeviceState.LOST:
            self._vanished("it was lost before")
        if self._state is not DeviceState.READY:
            raise DeviceError(
                f"{self.code}-CLOSED", f"the {self.noun} is not open", "Open it first."
            )

    def _vanished(self, why: object) -> NoReturn:
        """The device is lost: raises `DeviceLost` X-LOST."""
        self._lose("LOST", f"the {self.noun} vanished ({plain(why)})", "Check cable and power.")

    def _lose(self, kind: str, what: str, remedy: str) -> NoReturn:
        """The device is lost for a reason of its own; raises `DeviceLost` X-`kind`."""
        self._release()
        self._state = DeviceState.LOST
        raise DeviceLost(f"{self.code}-{kind}", what, f"{remedy} {RETRIED}")

    def _absent(self, kind: str, what: str, remedy: str) -> NoReturn:
        """It cannot be opened now; raises `DeviceAbsent` X-`kind`."""
        self._release()
        self._state = DeviceState.ABSENT
        raise DeviceAbsent(f"{self.code}-{kind}", what, f"{remedy} {RETRIED}")

    def _release(self) -> None:
        """Let go of what the system gave; never raises."""

    def close(self) -> None:
        self._release()
        self._state = DeviceState.ABSENT


def needed(module: str, package: str) -> Any:
    """A module that a driver needs, imported only now.

    Raises `DeviceAbsent` DRV-MODULE that names the Debian package.
    """
    try:
        return import_module(module)
    except (ImportError, OSError) as error:
        raise DeviceAbsent(
            "DRV-MODULE",
            f"the Python module '{module}' cannot be loaded ({plain(error)})",
            f"Install the Debian package {package}.",
        ) from error


def plain(reason: object) -> str:
    """An error in words that fit into a sentence: one line, no full stops at its end."""
    if isinstance(reason, OSError) and reason.strerror:
        return reason.strerror.lower()
    return " ".join(str(reason).split()).rstrip(".").replace(". ", "; ") or type(reason).__name__
