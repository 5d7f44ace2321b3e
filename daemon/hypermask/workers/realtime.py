"""Asking the operating system for steady timing; degrades politely without the rights."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import signal

_MCL_CURRENT_AND_FUTURE = 3
_PR_SET_PDEATHSIG = 1


def freeze_garbage() -> None:
    """Collect once and take all that is there out of later collections.

    A full collection over 300,000 containers takes 78 ms: five flips.
    """
    gc.collect()
    gc.freeze()


def die_with_parent() -> None:
    """This process is killed when its parent dies, however that dies (prctl(2), Linux)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def be_realtime(priority: int) -> list[str]:
    """SCHED_FIFO and locked memory for this process; returns what was granted, in words."""
    granted = []
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        granted.append(f"SCHED_FIFO {priority}")
    except (PermissionError, OSError):
        pass
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.mlockall(_MCL_CURRENT_AND_FUTURE) == 0:
            granted.append("memory locked")
    except (OSError, AttributeError):
        pass
    return granted
