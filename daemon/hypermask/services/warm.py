"""The very beginning of a stage: before others, the GPU's driver beside everything else."""

from __future__ import annotations

import contextlib
import ctypes
import os
import threading


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
    """The libraries alone: Mesa with its compiler. A display must not be opened here: Mesa may take
    the card itself for it, whose first opener is its master, and the projector's driver is not."""
    for name in ("libEGL.so.1", "libEGL_mesa.so.0", "libgbm.so.1"):
        with contextlib.suppress(OSError):
            ctypes.CDLL(name)
