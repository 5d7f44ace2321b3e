"""The neck record, from the show, and the head record, from the pan-tilt worker."""

from __future__ import annotations

import numpy as np

from hypermask.blackboard import Record

SILENT_AFTER_S = 0.5
"""A head whose master has said nothing for so long stops."""
BEAT_S = 0.1
"""How often the master says that it is still there."""

NECK = np.dtype(
    [
        ("time_s", "<f8"),  # when the master last said anything
        ("order", "<i8"),  # counts the orders; a new number begins a new movement
        ("start_s", "<f8"),  # when it was given
        ("gesture", "S16"),  # one of GESTURES
        ("pan_rad", "<f8"),  # where to look during and after it; pan to the left, tilt up
        ("tilt_rad", "<f8"),
        ("amplitude_rad", "<f8"),  # of a nod or a shake
        ("cycles", "<i4"),
        ("vigour", "<f8"),  # 0 to 1: share of the neck's speed and acceleration
    ]
)
HEAD = np.dtype(
    [
        ("time_s", "<f8"),
        ("pan_rad", "<f8"),
        ("tilt_rad", "<f8"),
        ("state", "S16"),  # absent, homing, still, following, halted, parking, parked
        ("ready", "?"),
        ("homed", "?"),
        ("moving", "?"),
        ("master_silent", "?"),
        ("order", "<i8"),  # the order that is carried out
        ("limit_hits", "<i8"),
        ("losses", "<i8"),  # how often the unit vanished
        ("halts", "<i8"),  # how often silence stopped the head
        ("lag_rad", "<f8"),  # how far it is behind where it should be by now
    ]
)


def new_neck(time_s: float) -> Record:
    """Looking straight ahead since `time_s`."""
    return order(np.zeros((), NECK), time_s, "look")


def order(
    neck: Record,
    time_s: float,
    gesture: str,
    look: tuple[float, float] | None = None,
    amplitude_rad: float = 0.2,
    cycles: int = 2,
    vigour: float = 0.6,
) -> Record:
    """A copy of `neck` with a new order, given at `time_s`. look: pan and tilt, else as before."""
    neck = neck.copy()
    neck["order"] += 1
    neck["time_s"] = neck["start_s"] = time_s
    neck["gesture"] = gesture.encode()
    if look is not None:
        neck["pan_rad"], neck["tilt_rad"] = look
    neck["amplitude_rad"], neck["cycles"], neck["vigour"] = amplitude_rad, cycles, vigour
    return neck


def beat(neck: Record, time_s: float) -> Record:
    """A copy that says at `time_s` that its master is there and wants nothing new."""
    neck = neck.copy()
    neck["time_s"] = time_s
    return neck
