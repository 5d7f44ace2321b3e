"""The overlay record: what an operator's mode lights in place of the face."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.blackboard import Record

MOST_MARKS = 48
STALE_S = 1.0
"""Who lights an overlay says so again sooner than this; else the face comes back."""

OVERLAY = np.dtype(
    [
        ("time_s", "<f8"),  # when its master last said so
        ("on", "?"),  # the face is dark, and this is lit
        ("cross", "<f8", (2,)),  # projector px of the cross-hair, NaN for none
        ("count", "<i4"),
        ("marks", "<f8", (MOST_MARKS, 2)),  # projector px of faint marks, the first `count`
    ]
)


def new_overlay(
    time_s: float,
    on: bool,
    cross: tuple[float, float] | None = None,
    marks: ArrayLike | None = None,
) -> Record:
    """marks: (n, 2) px; those that are not finite, and more than `MOST_MARKS`, are left out."""
    record = np.zeros((), OVERLAY)
    record["time_s"], record["on"] = time_s, on
    record["cross"] = np.nan if cross is None else cross
    points = np.asarray([] if marks is None else marks, float).reshape(-1, 2)
    points = points[np.isfinite(points).all(axis=1)][:MOST_MARKS]
    record["count"] = len(points)
    record["marks"][: len(points)] = points
    return record


def lit(record: Record | None, now_s: float) -> bool:
    """Whether an overlay is to be drawn: it is on, and its master is alive."""
    return record is not None and bool(record["on"]) and now_s - float(record["time_s"]) <= STALE_S


def cross_of(record: Record) -> tuple[float, float] | None:
    x, y = (float(value) for value in record["cross"])
    return (x, y) if np.isfinite([x, y]).all() else None


def marks_of(record: Record) -> NDArray[np.float64]:
    """(n, 2) px."""
    return np.asarray(record["marks"][: int(record["count"])], float)
