"""Clicks at still positions of the mask, and which sets of them can fix a projector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.geometry import Array, Pose
from hypermask.mask import LED_NAMES

Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]

LEAST_DEPTH_RATIO = 1.2
LEAST_CLICKS = 8


@dataclass(frozen=True)
class Placement:
    """One still position of the mask and the clicks made there.

    pose: mean `camera_from_mask`; covariance: (6, 6) of that mean; points: (5, 2) the LEDs in the
    camera image; pixels: (5, 2) clicked projector pixels, NaN where skipped.
    """

    pose: Pose
    covariance: Array
    points: Array
    pixels: Array

    @property
    def clicked(self) -> Indices:
        """Indices of the LEDs clicked."""
        return np.flatnonzero(np.isfinite(self.pixels[:, 0]))


@dataclass(frozen=True)
class Click:
    """A click by name: the placement's number from 0, the LED, its residual in px."""

    placement: int
    led: int
    error_px: float

    def __str__(self) -> str:
        name = LED_NAMES[self.led].replace("_", " ")
        return f"position {self.placement + 1}, {name} LED: {self.error_px:.0f} px off"


def check_placements(placements: Sequence[Placement]) -> None:
    """Refuses sets that cannot fix the projector, whatever the clicks: see `procam.solve`."""
    used = [p for p in placements if len(p.clicked)]
    clicks = sum(len(p.clicked) for p in used)
    if clicks < LEAST_CLICKS or len(used) < 2:
        raise DataError(
            "CAL-FEW",
            f"{clicks} clicks at {len(used)} positions are too few",
            "Click the LEDs at two distances at least; three distances with two positions each "
            "are better.",
        )
    depths = [float(p.pose.translation[2]) for p in used]
    if max(depths) < LEAST_DEPTH_RATIO * min(depths):
        raise DataError(
            "CAL-DEPTH",
            f"all positions are {min(depths):.2f} to {max(depths):.2f} m away, "
            "which fixes the picture at that distance only",
            f"Add a position at {_other_depth(min(depths), max(depths)):.1f} m.",
        )


def _other_depth(near: float, far: float) -> float:
    return 2.4 if far < 1.8 else max(1.2, near / 1.5)
