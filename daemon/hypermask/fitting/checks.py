"""What the fitting tool refuses, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import HypermaskError, UsageError
from hypermask.fitting.handles import LEVELS, Level

Array = NDArray[np.float64]

OUTSIDE = 0.5
"""Points may lie outside the photograph by this share of its longer side: foreheads are cut."""


def finite(value: Any) -> float:
    """Raises `UsageError` FIT-PLACE for anything but a finite number."""
    good = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    number = float(value) if good and abs(value) < 1e12 else math.nan
    if not math.isfinite(number):
        raise UsageError("FIT-PLACE", f"{value!r} is no pixel's place", "Give two finite numbers.")
    return number


def near_photo(x: Any, y: Any, size: tuple[int, int]) -> Array:
    """(2,) a pixel in or near a photograph of this (width, height). Raises FIT-PLACE."""
    place, last = np.array([finite(x), finite(y)]), np.array(size) - 1
    if np.maximum(-place, place - last).max() > OUTSIDE * max(size):
        raise UsageError(
            "FIT-PLACE",
            f"({place[0]:.0f}, {place[1]:.0f}) is far outside the photograph of "
            f"{size[0]} x {size[1]} pixels",
            "Give a place in the photograph or near it.",
        )
    return place


def known_level(name: Any, levels: Mapping[str, Level]) -> Level:
    """Raises `UsageError` FIT-LEVEL."""
    if not isinstance(name, str) or name not in levels:
        raise UsageError("FIT-LEVEL", f"there is no level {name!r}", f"Known: {', '.join(LEVELS)}.")
    return levels[name]


def known_handle(handle: Any, levels: Mapping[str, Level]) -> tuple[Level, int]:
    """The handle's level and row. Raises `UsageError` FIT-HANDLE."""
    level = levels.get(handle.split("/")[0]) if isinstance(handle, str) else None
    if level is None or handle not in level.index:
        raise UsageError(
            "FIT-HANDLE",
            f"there is no handle {handle!r}",
            "A handle is a level and a part, such as face/mouth, parts/brow_left or "
            "features/lip_corner_left.",
        )
    return level, level.index[handle]


def fold_notice(handle: str) -> HypermaskError:
    """What a user is told of a drag that went only a part of its way; nothing is raised."""
    return HypermaskError(
        "FIT-FOLD",
        f"{handle} was held where the mesh would have folded over",
        "Move its neighbours or its coarser group first.",
    )
