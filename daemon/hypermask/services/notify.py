"""Telling systemd how a service is (sd_notify(3)); silent without systemd."""

from __future__ import annotations

import contextlib
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import socket


class Notifier:
    """A datagram socket to `$NOTIFY_SOCKET`."""

    def __init__(self) -> None:
        address = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = _datagrams() if address else None
        self.watchdog_s = self._asked()
        """How often systemd wants to hear WATCHDOG=1, None where it does not listen."""

    @staticmethod
    def _asked() -> float | None:
        try:
            wanted = int(os.environ.get("WATCHDOG_USEC", "0"))
        except ValueError:
            return None
        for_us = os.environ.get("WATCHDOG_PID") in (None, "", str(os.getpid()))
        return wanted * 1e-6 if wanted > 0 and for_us else None

    def watch(self, seconds: float) -> None:
        """Ask for this patience in the place of the unit's WatchdogSec; 0 for none."""
        if self.watchdog_s is not None:
            self.send(f"WATCHDOG_USEC={seconds * 1e6:.0f}")
            self.watchdog_s = seconds or None

    def send(self, *lines: str) -> None:
        """Such as READY=1. A full socket or a systemd that restarts is no reason to stop."""
        if self._socket is None:
            return
        with contextlib.suppress(OSError):
            self._socket.sendto("\n".join(lines).encode(), self._address)


def _datagrams() -> socket.socket:
    import socket

    made = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
    made.setblocking(False)
    return made
