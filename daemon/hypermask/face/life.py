"""What a face does when nothing is asked of it: blinks, small shifts of the gaze, breath.

Pure functions of time: the same moment always looks the same, under the virtual clock too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.face.action_units import unit_weights
from hypermask.face.lids import blink, spread

Array = NDArray[np.float64]

_FIXATION_S = 1.7
"""A fixation's mean length; each begins somewhere in the middle third of its period."""
_SACCADE_S = 0.055
_REACH_RAD = (0.16, 0.06)
_STRAIGHT = 0.45
"""Share of fixations that look straight ahead."""
_BREATH_S = 4.3
_IN_SHARE = 0.4
_BREATH = unit_weights({"38": 0.30, "1": 0.03, "2": 0.03, "26": 0.02, "25": 0.06})


@dataclass(frozen=True)
class Life:
    """Which of them are on."""

    blinks: bool = True
    gaze: bool = True
    breath: bool = True

    def lids(self, time_s: float) -> float:
        """0 open to 1 shut."""
        return blink(time_s) if self.blinks else 0.0

    def gaze_at(self, time_s: float) -> Array:
        """(2,) radians, to the audience's right and up."""
        return gaze(time_s) if self.gaze else np.zeros(2)

    def units(self, time_s: float) -> Array:
        """(88,) intensities of the action units that breathe."""
        return np.asarray(_BREATH * (breath(time_s) if self.breath else 0.0))


LIFE = Life()
STILL = Life(False, False, False)


def gaze(time_s: float) -> Array:
    """(2,) radians: fixations of about 1.7 s, small quick shifts (saccades of 55 ms) between."""
    number = int(np.floor(time_s / _FIXATION_S))
    start = (number + (1 + spread(number * 5 + 2)) / 3) * _FIXATION_S
    share = float(np.clip((time_s - start) / _SACCADE_S, 0, 1))
    before, after = _fixation(number - 1), _fixation(number)
    return np.asarray(before + (after - before) * share * share * (3 - 2 * share))


def _fixation(number: int) -> Array:
    if spread(number * 3 + 1) < _STRAIGHT:
        return np.zeros(2)
    aside, up = spread(number * 7 + 3) * 2 - 1, spread(number * 11 + 5) * 2 - 1
    return np.array([aside * _REACH_RAD[0], up * _REACH_RAD[1]])


def breath(time_s: float) -> float:
    """0 to 1: breathed in; 14 breaths a minute, in faster than out."""
    phase = (time_s / _BREATH_S) % 1.0
    way = phase / _IN_SHARE if phase < _IN_SHARE else (1 - phase) / (1 - _IN_SHARE)
    return float(way * way * (3 - 2 * way))
