"""Connections to a virtual machine from outside: JSON lines over its sockets, and QEMU's monitor.

Source: the QEMU Machine Protocol (QMP), docs/interop/qmp-spec.rst of QEMU.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.errors import HypermaskError

_MEMORY = Path("/dev/shm")
"""QEMU writes a picture while it holds all of the guest's processors; a disk that is busy with
another machine's writes would make the guest stand still for seconds."""


class Lines:
    """JSON objects, one a line, over a socket."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._buffer = b""

    def send(self, item: dict[str, Any]) -> None:
        self._link.sendall(json.dumps(item).encode() + b"\n")

    def receive(self, timeout_s: float) -> dict[str, Any]:
        """The next object; what is no object is passed over. Raises `TimeoutError`."""
        deadline = time.monotonic() + timeout_s
        while True:
            line, newline, rest = self._buffer.partition(b"\n")
            if newline:
                self._buffer = rest
                with contextlib.suppress(ValueError):
                    item = json.loads(line)
                    if isinstance(item, dict):
                        return item
                continue
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                raise TimeoutError
            self._link.settimeout(remaining)
            data = self._link.recv(65536)
            if not data:
                raise HypermaskError("APL-GONE", "the virtual machine ended", "Read qemu.log.")
            self._buffer += data


class Monitor:
    """A connection to QEMU's monitor. Commands raise `HypermaskError` APL-MONITOR."""

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self._events: list[dict[str, Any]] = []
        lines.receive(20)
        self.run("qmp_capabilities")

    def run(self, command: str, **arguments: Any) -> Any:
        self._lines.send({"execute": command, "arguments": arguments})
        while True:
            answer = self._lines.receive(60)
            if "return" in answer:
                return answer["return"]
            if "error" in answer:
                raise HypermaskError(
                    "APL-MONITOR", f"{command}: {answer['error']['desc']}", "Check the command."
                )
            self._events.append(answer)

    def human(self, line: str) -> str:
        """What the monitor for humans answers."""
        return str(self.run("human-monitor-command", **{"command-line": line}))

    def wait_event(self, name: str, timeout_s: float) -> dict[str, Any]:
        """The next event of that name, or one that was seen already. Raises `TimeoutError`."""
        deadline = time.monotonic() + timeout_s
        while True:
            for event in self._events:
                if event.get("event") == name:
                    self._events.remove(event)
                    return event
            self._events.append(self._lines.receive(deadline - time.monotonic()))

    def forget_events(self) -> None:
        self._events.clear()

    def screenshot(self) -> NDArray[np.uint8]:
        """(height, width, 3) RGB, row 0 at the top. Raises `HypermaskError` APL-SCREEN."""
        folder = _MEMORY if os.access(_MEMORY, os.W_OK) else None
        with tempfile.NamedTemporaryFile(prefix="hypermask-", suffix=".ppm", dir=folder) as file:
            self.run("screendump", filename=file.name)
            picture = cv2.imread(file.name, cv2.IMREAD_COLOR)
        if picture is None:
            raise HypermaskError("APL-SCREEN", "the display has no picture", "Is there a mode?")
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
