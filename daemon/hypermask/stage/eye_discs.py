"""Black discs over the mask's eye holes: no light goes into the actor's eyes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hypermask.mask import Mask
from hypermask.stage.settings import StageSettings

_SEGMENTS = 32


def eye_discs(mask: Mask, settings: StageSettings) -> NDArray[np.float32]:
    """Triangles (3 T, 4) float32 on the relief over the eye holes: x, y, z metres, blackness.

    Black within the hole's radius plus the margin, fading out over the soft edge outside.
    """
    angles = np.linspace(0, 2 * np.pi, _SEGMENTS + 1)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    triangles = [np.zeros((0, 4))]
    for hole in mask.settings.eye_holes:
        # the polygon's edges, not its corners, must lie on the circle
        black = (hole.radius_m + settings.eye_hole_margin_m) / np.cos(np.pi / _SEGMENTS)
        centre = np.asarray(hole.centre_m)
        rings = [
            _on_relief(mask, centre + circle * radius, blackness)
            for radius, blackness in (
                (0.0, 1.0),
                (black, 1.0),
                (black + settings.eye_hole_soft_m, 0.0),
            )
        ]
        for inner, outer in pairwise(rings):
            for corners in (
                (inner[:-1], outer[:-1], outer[1:]),
                (inner[:-1], outer[1:], inner[1:]),
            ):
                triangles.append(np.stack(corners, axis=1).reshape(-1, 4))
    return np.concatenate(triangles).astype(np.float32)


def _on_relief(mask: Mask, points: NDArray[np.float64], blackness: float) -> NDArray[np.float64]:
    heights = mask.height(points[:, 0], points[:, 1])
    return np.column_stack([points, heights, np.full(len(points), blackness)])
