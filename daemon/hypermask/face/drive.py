"""What other tools' parameters come to: action units, the mouth's parameters and a gaze."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hypermask.face.action_units import COUNT, NAMES, unit_name
from hypermask.face.mouth import MOUTH_PARAMETERS

Array = NDArray[np.float64]

_UNIT = {name: k for k, name in enumerate(NAMES)}
_MOUTH = {name: k for k, name in enumerate(MOUTH_PARAMETERS)}


@dataclass
class Drive:
    """units: (88,) intensities; mouth: (13,) offsets; gaze: (2,) radians, to the audience's right
    and up. `Face.positions` takes all three.
    """

    units: Array = field(default_factory=lambda: np.zeros(COUNT))
    mouth: Array = field(default_factory=lambda: np.zeros(len(MOUTH_PARAMETERS)))
    gaze: Array = field(default_factory=lambda: np.zeros(2))

    def add(self, target: str, amount: float) -> None:
        """Add to a unit ("12L", "12"), a mouth parameter by name, or "gaze_right", "gaze_up"."""
        if target in _MOUTH:
            self.mouth[_MOUTH[target]] += amount
        elif target in ("gaze_right", "gaze_up"):
            self.gaze[("gaze_right", "gaze_up").index(target)] += amount
        else:
            for name in unit_name(target):
                self.units[_UNIT[name]] += amount

    def held(self) -> Drive:
        """The same within the ranges: units 0 to 1, mouth -1.5 to 1.5, gaze 0.6 rad each way."""
        return Drive(
            np.clip(self.units, 0, 1), np.clip(self.mouth, -1.5, 1.5), np.clip(self.gaze, -0.6, 0.6)
        )
