"""Builds the reference mask's relief: a smooth face-like surface, as a 16-bit height map.

Run `python -m hypermask_sim.relief configs/masks/reference` after changing it. The proportions are
those of an adult face (pupils 62 mm apart, mouth 80 mm below them) on an oblong shell.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

SPACING_M = 0.001
METRES_PER_STEP = 2e-6
OFFSET_M = -0.06
HALF_WIDTH_M, HALF_HEIGHT_M = 0.110, 0.145

Array = NDArray[np.float64]


def _bump(x: Array, y: Array, cx: float, cy: float, sx: float, sy: float, height: float) -> Array:
    """Gaussian bump; all lengths in millimetres, the result in millimetres."""
    bump: Array = height * np.exp(-0.5 * (((x - cx) / sx) ** 2 + ((y - cy) / sy) ** 2))
    return bump


def _nose(x: Array, y: Array) -> Array:
    """A ridge from between the eyes to the tip, widening downwards; millimetres."""
    along = np.clip((28 - y) / 50, 0, 1)  # 0 at the bridge, 1 at the tip
    below = np.clip((-22 - y) / 13, 0, 1)  # falls off under the tip
    width = 6 + 5 * along
    rise = (5 + 14 * along**1.3) * (1 - below**2 * (3 - 2 * below))
    fade = np.clip((38 - y) / 14, 0, 1)
    ridge: Array = rise * fade * np.exp(-0.5 * (x / width) ** 2)
    return ridge


def face_relief() -> Array:
    """Height z in metres on the grid, row 0 at the top, shape (291, 221)."""
    columns = np.arange(round(2 * HALF_WIDTH_M / SPACING_M) + 1) * SPACING_M - HALF_WIDTH_M
    rows = HALF_HEIGHT_M - np.arange(round(2 * HALF_HEIGHT_M / SPACING_M) + 1) * SPACING_M
    x, y = np.meshgrid(columns * 1e3, rows * 1e3)
    z = 14 - 20 * (x / 100) ** 2 - 9 * (y / 135) ** 2
    z += _bump(x, y, 0, 48, 34, 8, 3.0)  # brow
    for side in (-1, 1):
        z += _bump(x, y, side * 31, 25, 13, 9, -6.5)  # eye socket
        z += _bump(x, y, side * 31, 25, 8, 6, 2.0)  # lid over the eye
        z += _bump(x, y, side * 40, -8, 16, 14, 3.5)  # cheek
        z += _bump(x, y, side * 11, -25, 5, 5, 4.0)  # nostril
    z += _nose(x, y)
    z += _bump(x, y, 0, -50, 18, 5, 4.0)  # upper lip
    z += _bump(x, y, 0, -64, 15, 5, 4.0)  # lower lip
    z += _bump(x, y, 0, -57, 22, 2.5, -1.5)  # between the lips
    z += _bump(x, y, 0, -96, 17, 12, 8.0)  # chin
    return np.asarray(cv2.GaussianBlur(z, (0, 0), 2.0)) * 1e-3


def write_relief(folder: Path) -> Path:
    steps = np.round((face_relief() - OFFSET_M) / METRES_PER_STEP)
    path = folder / "relief.png"
    cv2.imwrite(str(path), np.clip(steps, 0, 65535).astype(np.uint16))
    return path


if __name__ == "__main__":
    print(write_relief(Path(sys.argv[1])))
