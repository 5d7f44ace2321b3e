"""Keeps the text console off the projector, and makes the kernel believe in a silent display."""

from __future__ import annotations

import errno
import fcntl
import os
import stat
from pathlib import Path

_KDSETMODE = 0x4B3A
_KD_TEXT, _KD_GRAPHICS = 0, 1


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


def force_connector(card: str, connector: str, root: Path = Path("/sys/class/drm")) -> bool:
    """Make the kernel take a silent display for a connected one; False where not allowed."""
    try:
        (root / f"{Path(card).resolve().name}-{connector}" / "status").write_text("on", "ascii")
    except OSError:
        return False
    return True
