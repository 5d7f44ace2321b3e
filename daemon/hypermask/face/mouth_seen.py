"""How purely each mouth parameter moves its own control point, seen in pictures (PAPERS A5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.face.markers import Markers
from hypermask.face.mouth import CONTROL_POINTS

Array = NDArray[np.float64]

MOUTH_START = np.array([0.04, 0.0, -0.04, 0.0, -0.24, 0.0, -0.30, 0.0, -0.12, 0.0, 0.0, 0.0, 0.0])
"""Half open, with lips so full that none of their edges is in another's way."""
MOUTH_FULL = np.array(
    [0.24, 0.36, 0.20, 0.36, -0.24, 0.36, -0.30, 0.36, -0.60, 0.30, 0.30, 0.30, 0.30]
)
"""How far each parameter goes, in half widths: about as far as the six reference shapes take it, no
farther than the lip has room without the lip's other edge."""
_CORNERS = (5, 6)
OWN: tuple[tuple[int, ...], ...] = (
    *((0,), (0,), (1,), (1,), (2,), (2,), (3,), (3,), (4,)),
    *(_CORNERS, _CORNERS, _CORNERS, ()),
)
AXES: tuple[int, ...] = (1, 2, 1, 2, 1, 2, 1, 2, 1, 1, 0, 2, 0)
"""The control points of each parameter, in `CONTROL_POINTS`, and the axis it moves them along."""


@dataclass(frozen=True)
class Pure:
    """What one mouth parameter does from `MOUTH_START` at 1/3, 2/3 and all of `MOUTH_FULL`.

    own: (3,) mm its control point moves along its axis; other: mm, the farthest that any other
    control point moves in any direction, the lips' horizontal opening among them.
    """

    own: Array
    other: float

    @property
    def steady(self) -> bool:
        steps = np.diff(self.own, prepend=0.0) * np.sign(self.own[-1])
        return bool((steps > 0.05).all())

    @property
    def leak(self) -> float:
        return self.other / abs(float(self.own[-1]))


def mouth_marked(markers: Markers, index: int) -> Pure:
    """How purely a mouth parameter moves its own control point, by dots."""
    vertices = list(CONTROL_POINTS.values())
    start, opening = markers.find(vertices, mouth=MOUTH_START), markers.opening(mouth=MOUTH_START)
    width = float(start[6, 0] - start[5, 0])
    moved, opened = [], []
    for share in (1 / 3, 2 / 3, 1.0):
        mouth = MOUTH_START + np.eye(13)[index] * MOUTH_FULL[index] * share
        moved.append(markers.find(vertices, mouth=mouth) - start)
        opened.append((markers.opening(mouth=mouth) - opening) * width)
    path, wide = np.array(moved), np.array(opened)
    path[:, 5, 0] *= -1
    own = list(OWN[index])
    farthest = np.linalg.norm(np.delete(path[-1], own, axis=0), axis=1).max()
    if not own:
        return Pure(wide, float(farthest))
    axis = AXES[index]
    return Pure(path[:, own, axis].mean(axis=1), max(float(farthest), abs(float(wide[-1]))))
