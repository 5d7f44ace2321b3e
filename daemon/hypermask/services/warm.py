"""The very beginning of a stage: before others, the GPU's driver beside everything else."""

from __future__ import annotations

import contextlib
import ctypes
import os
import threading

_PLATFORM_SURFACELESS = 0x31DD


def go_first() -> None:
    """The mask is dark until the stage is there: it loads before all that is not real-time too."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))


def warm_up_graphics() -> threading.Thread:
    """Starts a thread that ends as soon as the driver is there; the GIL is free meanwhile."""
    thread = threading.Thread(target=_load, name="warm-up", daemon=True)
    thread.start()
    return thread


def _load() -> None:
    with contextlib.suppress(OSError, AttributeError):
        egl = ctypes.CDLL("libEGL.so.1")
        egl.eglGetProcAddress.restype = ctypes.c_void_p
        address = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
        if not address:
            return
        kind = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint32, ctypes.c_void_p, ctypes.c_void_p)
        display = kind(address)(_PLATFORM_SURFACELESS, None, None)
        if display:
            egl.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
            egl.eglInitialize(display, None, None)
