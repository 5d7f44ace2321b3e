"""Keeps the text console off the projector, and hears when a display comes or goes."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
import stat
from pathlib import Path

_KDSETMODE = 0x4B3A
_KD_TEXT, _KD_GRAPHICS = 0, 1
_UEVENT = 15  # NETLINK_KOBJECT_UEVENT
_FROM_KERNEL = 1
_POLL_S = 0.5


def silence_console(tty: Path = Path("/dev/tty0"), frame: Path = Path("/dev/fb0")) -> bool:
    """Stop the console from drawing and black out what it drew; False where that is not allowed.

    When the last program leaves a card, the kernel shows the console's own picture again: so that
    picture has to be black too. It stays so after the program; `restore_console` ends it.
    """
    return _set_mode(tty, _KD_GRAPHICS) and _black(frame)


def restore_console(tty: Path = Path("/dev/tty0")) -> bool:
    return _set_mode(tty, _KD_TEXT)


def _set_mode(tty: Path, mode: int) -> bool:
    try:
        descriptor = os.open(tty, os.O_WRONLY | os.O_NOCTTY | os.O_CLOEXEC)
    except FileNotFoundError:  # a kernel without consoles
        return True
    except OSError:
        return False
    try:
        fcntl.ioctl(descriptor, _KDSETMODE, mode)
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True


def _black(frame: Path) -> bool:
    try:
        descriptor = os.open(frame, os.O_WRONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return True
    except OSError:
        return False
    try:
        if not stat.S_ISCHR(os.fstat(descriptor).st_mode):  # a file would grow without end
            return False
        zeros = bytes(1 << 16)
        while os.write(descriptor, zeros):
            pass
    except OSError as error:
        return error.errno in (errno.ENOSPC, errno.EFBIG)  # written to its end
    finally:
        os.close(descriptor)
    return True


class HotplugWatch:
    """Tells that the displays of a card changed, by the kernel's events and by its status file."""

    def __init__(self, card: str, connector: str, root: Path = Path("/sys/class/drm")) -> None:
        self._status = root / f"{Path(card).resolve().name}-{connector}" / "status"
        self._last = self._read()
        self._next_s = 0.0
        self._socket: socket.socket | None = None
        with contextlib.suppress(OSError):  # a sandbox may forbid it: then the file alone
            self._socket = socket.socket(
                socket.AF_NETLINK, socket.SOCK_RAW | socket.SOCK_NONBLOCK, _UEVENT
            )
            self._socket.bind((0, _FROM_KERNEL))

    def _read(self) -> str:
        try:
            return self._status.read_text("ascii").strip()
        except OSError:
            return ""

    def changed(self, now_s: float) -> bool:
        """Never waits; looks into the file twice a second at most."""
        event = self._event()
        if now_s < self._next_s and not event:
            return False
        self._next_s = now_s + _POLL_S
        status, last = self._read(), self._last
        self._last = status
        return event or status != last

    def _event(self) -> bool:
        seen = False
        while self._socket is not None:
            try:
                seen |= is_hotplug(self._socket.recv(16384))
            except BlockingIOError:
                return seen
            except OSError:  # events were lost: look
                return True
        return seen

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None


def is_hotplug(message: bytes) -> bool:
    """Whether a kernel event says that a display was plugged or unplugged."""
    words = message.split(b"\0")
    return b"SUBSYSTEM=drm" in words and b"HOTPLUG=1" in words


def force_connector(card: str, connector: str, root: Path = Path("/sys/class/drm")) -> bool:
    """Make the kernel take a silent display for a connected one; False where not allowed."""
    try:
        (root / f"{Path(card).resolve().name}-{connector}" / "status").write_text("on", "ascii")
    except OSError:
        return False
    return True
