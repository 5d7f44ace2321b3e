"""One folder put in another's place in a single step, and what a killed process left cleared away.

Linux exchanges two names at once (renameat2, RENAME_EXCHANGE): a reader finds the old folder or the
new one, never none, even at a power cut. Where the file system cannot, the old folder is set
aside first, and put back by `clear` should the process die in between.
"""

from __future__ import annotations

import ctypes
import functools
import os
import shutil
from collections.abc import Callable
from pathlib import Path

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
_OLD = ".old"


def prefix(folder: Path) -> str:
    """Of temporary folders beside `folder`; it names this process."""
    return f".{folder.name}.{os.getpid()}-"


def exchange(new: Path, folder: Path) -> None:
    """Put the folder `new` in `folder`'s place; what was there is removed. Raises `OSError`."""
    if not folder.exists():
        new.rename(folder)
    elif _swapped(new, folder):
        shutil.rmtree(new, ignore_errors=True)
    else:
        _in_two_steps(new, folder)
    _flush(folder.parent)


def _swapped(new: Path, folder: Path) -> bool:
    call = _renameat2()
    return call is not None and call(bytes(new), bytes(folder)) == 0


@functools.cache
def _renameat2() -> Callable[[bytes, bytes], int] | None:
    try:
        function = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return None
    function.argtypes = (
        ctypes.c_int,
        ctypes.c_char_p,
        ctypes.c_int,
        ctypes.c_char_p,
        ctypes.c_uint,
    )
    return lambda a, b: int(function(_AT_FDCWD, a, _AT_FDCWD, b, _RENAME_EXCHANGE))


def _in_two_steps(new: Path, folder: Path) -> None:
    old = new.with_name(new.name + _OLD)
    folder.rename(old)
    try:
        new.rename(folder)
    except OSError:
        old.rename(folder)
        raise
    shutil.rmtree(old, ignore_errors=True)


def clear(folder: Path) -> None:
    """Remove temporary folders beside `folder` whose process has gone; an old folder that one of
    them had set aside comes back where there is none.
    """
    for left in sorted(folder.parent.glob(f".{folder.name}.*-*")):
        number = left.name.removeprefix(f".{folder.name}.").split("-")[0]
        if not number.isdecimal() or _alive(int(number)):
            continue
        if left.name.endswith(_OLD) and not folder.exists():
            left.rename(folder)
        else:
            shutil.rmtree(left, ignore_errors=True)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _flush(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
