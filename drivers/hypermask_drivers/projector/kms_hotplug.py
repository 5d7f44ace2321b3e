"""Hears when the display at a connector comes, goes, or is exchanged for another.

Source: drm_sysfs.c of the kernel (6.12) for the events: DEVNAME is the card's, CONNECTOR the number
where the kernel knows which one it was, PROPERTY where only a property changed.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable
from pathlib import Path, PurePath
from typing import NamedTuple

_UEVENT = 15  # NETLINK_KOBJECT_UEVENT
_FROM_KERNEL = 1
_POLL_S = 0.5


class Hotplug(NamedTuple):
    """An event of the kernel about a display. connector: None where it does not name one;
    aspect: only a property changed, as of copy protection."""

    card: str
    connector: int | None
    aspect: bool = False


_LOST = Hotplug("", None)
"""Events were lost: it may have been any."""


class HotplugWatch:
    """Tells that the signal at one connector is to begin anew, or that its display went.

    What other cards and connectors do is no reason: the picture would go dark in mid-show. After
    an event that names no connector the display is asked anew, and compared with before. The
    status file is looked at besides, as a sandbox may keep the events away.
    """

    def __init__(
        self,
        card: str,
        connector: str,
        number: int,
        probe: Callable[[], bool],
        root: Path = Path("/sys/class/drm"),
    ) -> None:
        """probe: asks the display anew; whether its link broke. It may raise `OSError`."""
        self._card, self._number, self._probe = Path(card).resolve().name, number, probe
        self._folder = root / f"{self._card}-{connector}"
        self._status, self._edid = self._read("status"), self._read("edid")
        self._next_s = 0.0
        self._socket: socket.socket | None = None
        with contextlib.suppress(OSError):  # a sandbox may forbid it: then the file alone
            self._socket = socket.socket(
                socket.AF_NETLINK, socket.SOCK_RAW | socket.SOCK_NONBLOCK, _UEVENT
            )
            self._socket.bind((0, _FROM_KERNEL))

    def _read(self, name: str) -> bytes:
        try:
            return (self._folder / name).read_bytes().strip()
        except OSError:
            return b""

    def changed(self, now_s: float) -> bool:
        """Waits only for a probe after an event; looks into the file twice a second at most."""
        events = self._events()
        if now_s < self._next_s and not events:
            return False
        self._next_s = now_s + _POLL_S
        broken = bool(events) and self._probe()
        last = self._status, self._edid
        self._status = self._read("status")
        if events:
            self._edid = self._read("edid") or self._edid
        named = any(event.connector is not None and not event.aspect for event in events)
        return named or broken or last != (self._status, self._edid)

    def _events(self) -> list[Hotplug]:
        """Those that may be about this connector."""
        found: list[Hotplug] = []
        while self._socket is not None:
            try:
                event = hotplug(self._socket.recv(16384))
            except BlockingIOError:
                break
            except OSError:
                return [*found, _LOST]
            if event is not None and self._mine(event):
                found.append(event)
        return found

    def _mine(self, event: Hotplug) -> bool:
        return event.card in ("", self._card) and event.connector in (None, self._number)

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None


def hotplug(message: bytes) -> Hotplug | None:
    """What a kernel event says about displays; None for one about something else."""
    words = message.split(b"\0")
    if b"SUBSYSTEM=drm" not in words or b"HOTPLUG=1" not in words:
        return None
    values = dict(word.split(b"=", 1) for word in words if b"=" in word)
    number = values.get(b"CONNECTOR", b"")
    card = PurePath(values.get(b"DEVNAME", b"").decode("ascii", "replace")).name
    return Hotplug(card, int(number) if number.isdigit() else None, b"PROPERTY" in values)
