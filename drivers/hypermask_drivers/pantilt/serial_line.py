"""A serial line with whole-answer timeouts, over pyserial."""

from __future__ import annotations

import contextlib
import select
import termios
from typing import Any

from hypermask_drivers.hardware import needed


class SerialLine:
    """Raises `OSError` from every method when the device vanished (pyserial's errors are such)."""

    def __init__(self, path: str, baud: int) -> None:
        """Raises `DeviceAbsent` DRV-MODULE, or `OSError` when it cannot be opened."""
        serial = needed("serial", "python3-serial")
        try:
            self._port: Any = serial.Serial(
                path, baud, timeout=0, write_timeout=0.5, exclusive=True,
                xonxoff=False, rtscts=False,
            )  # fmt: skip
        except termios.error as error:  # it vanished while it was set up: no `OSError`
            raise OSError(*error.args) from error

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def read(self, timeout_s: float) -> bytes:
        """What has come, at least one byte unless nothing comes for `timeout_s`."""
        ready, _, _ = select.select([self._port.fileno()], [], [], timeout_s)
        data: bytes = self._port.read(4096) if ready else b""
        return data

    def close(self) -> None:
        with contextlib.suppress(Exception):
            self._port.close()
