"""What a head can do: look, nod, shake, as places to go through."""

from __future__ import annotations

import numpy as np

from hypermask.blackboard import Record
from hypermask.errors import UsageError
from hypermask.neck.trajectory import Array, NeckLimits, Trajectory, through

GESTURES = ("look", "nod", "shake", "park")
_NOD_UP = 0.35
"""A nod goes down and comes up only a little over where it began."""
_FADE = 0.75
"""Each further swing is that much smaller."""


def waypoints(gesture: str, look: Array, amplitude_rad: float, cycles: int) -> list[Array]:
    """(2,) places, the last one `look`. Raises `UsageError` NECK-GESTURE."""
    if gesture not in GESTURES:
        raise UsageError(
            "NECK-GESTURE", f"there is no gesture '{gesture}'", f"There are {', '.join(GESTURES)}."
        )
    swings: list[Array] = []
    for cycle in range(cycles):
        size = amplitude_rad * _FADE**cycle
        if gesture == "nod":
            swings += [look + np.array([0, -size]), look + np.array([0, _NOD_UP * size])]
        elif gesture == "shake":
            swings += [look + np.array([size, 0]), look + np.array([-size, 0])]
    return [*swings, look]


def movement(neck: Record, place: Array, speed: Array, start_s: float, limits: NeckLimits,
             late: bool = False) -> Trajectory:  # fmt: skip
    """The order of a neck record, begun at `start_s` from a place and a speed, (2,) each.

    late: the order was given long ago; a gesture that is over is not made again.
    """
    gesture = "look" if late else bytes(neck["gesture"].item()).decode()
    look = np.zeros(2) if gesture == "park" else np.array([neck["pan_rad"], neck["tilt_rad"]])
    places = waypoints(gesture, look, float(neck["amplitude_rad"]), int(neck["cycles"]))
    return through(place, speed, places, start_s, limits.scaled(float(neck["vigour"])))
