"""libasound through pyalsaaudio (Debian: python3-alsaaudio), imported when it is needed."""

from __future__ import annotations

import ctypes
import errno
import functools
import os
from importlib import import_module
from typing import Any, Protocol

from hypermask_drivers.errors import DeviceError


class Pcm(Protocol):
    """What is used of `alsaaudio.PCM`."""

    def info(self) -> dict[str, Any]: ...
    def read(self) -> tuple[int, bytes]: ...
    def htimestamp(self) -> tuple[int, int, int]: ...
    def state(self) -> int: ...
    def polldescriptors(self) -> list[tuple[int, int]]: ...
    def close(self) -> None: ...


@functools.cache
def load() -> Any:
    """The module `alsaaudio`. Raises `DeviceError` SND-MODULE."""
    try:
        module = import_module("alsaaudio")
    except ImportError as error:
        raise DeviceError(
            "SND-MODULE",
            f"sound cards cannot be used: {error}",
            "Install Debian's python3-alsaaudio, or pyalsaaudio with libasound2-dev by pip.",
        ) from None
    if not hasattr(module.PCM, "htimestamp"):
        raise DeviceError(
            "SND-MODULE",
            "the installed pyalsaaudio is older than 0.10",
            "Install a newer one (Debian 13 has it).",
        )
    _hush()
    return module


def waiting(pcm: Pcm, module: Any) -> int:
    """Frames that can be read, or minus an errno: EPIPE after an overrun.

    Version 0.10, Debian 13's, does not ask the card for it; there it is what the card said last.
    """
    asked = getattr(pcm, "avail", None)
    if asked is not None:
        return int(asked())
    state = pcm.state()
    if state == module.PCM_STATE_XRUN:
        return -errno.EPIPE
    if state == module.PCM_STATE_DISCONNECTED:
        return -errno.ENODEV
    try:
        return int(pcm.htimestamp()[2])
    except module.ALSAAudioError as error:
        return -(number_of(error) or errno.EIO)


def number_of(error: Exception) -> int:
    """The errno of an ALSAAudioError, which holds only its text; 0 for another one."""
    text = str(error).rsplit(" [", 1)[0]
    return _NUMBERS.get(text, 0)


def reason_of(error: Exception) -> str:
    return str(error).rsplit(" [", 1)[0].lower()


_NUMBERS = {
    os.strerror(number): number
    for number in (
        errno.ENODEV, errno.ENOENT, errno.ENXIO, errno.EBUSY, errno.EACCES, errno.EPERM,
        errno.EINVAL, errno.EIO, errno.EPIPE, errno.ESTRPIPE, errno.EBADFD,
    )
}  # fmt: skip

_Handler = ctypes.CFUNCTYPE(
    None, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p
)
_silent = _Handler(lambda file, line, function, number, form: None)


def _hush() -> None:
    """libasound prints to stderr what it also returns: once a second while a card is away."""
    try:
        ctypes.CDLL("libasound.so.2").snd_lib_error_set_handler(_silent)
    except (OSError, AttributeError):
        return
