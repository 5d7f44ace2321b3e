"""Where rays of light meet the mask's relief: the simulator's own geometry, in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask_drivers.mask import Mask

Array = NDArray[np.float64]

MARCH_STEPS = 64
TOLERANCE_M = 1e-7


class Surface:
    """The relief as a bilinear height field z(x, y); its border goes on outwards.

    Not `Mask.height`: OpenCV's remap rounds positions to 1/32 of a grid cell, which on the flank
    of the nose is a step of 50 um.
    """

    def __init__(self, mask: Mask) -> None:
        self._grid = np.asarray(mask.relief, float)
        self._spacing = mask.settings.relief.spacing_m
        self._half_width, self._half_height = mask.half_size_m
        self._bottom, self._top = float(self._grid.min()), float(self._grid.max())

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """z in metres at (x, y) metres."""
        corner, fraction_row, fraction_column = self._cell(x, y)
        upper = corner[0] + fraction_column * (corner[1] - corner[0])
        lower = corner[2] + fraction_column * (corner[3] - corner[2])
        z: Array = upper + fraction_row * (lower - upper)
        return z

    def slope(self, x: ArrayLike, y: ArrayLike) -> Array:
        """(dz/dx, dz/dy), shape (..., 2)."""
        corner, row, column = self._cell(x, y)
        along_x = (1 - row) * (corner[1] - corner[0]) + row * (corner[3] - corner[2])
        down_y = (1 - column) * (corner[2] - corner[0]) + column * (corner[3] - corner[1])
        return np.stack([along_x, -down_y], axis=-1) / self._spacing

    def _cell(self, x: ArrayLike, y: ArrayLike) -> tuple[tuple[Array, ...], Array, Array]:
        """Heights of the four corners of the cell that holds a point, and where it lies in it."""
        rows, columns = self._grid.shape
        column = np.clip((np.asarray(x) + self._half_width) / self._spacing, 0, columns - 1)
        row = np.clip((self._half_height - np.asarray(y)) / self._spacing, 0, rows - 1)
        left = np.minimum(column.astype(np.intp), columns - 2)
        top = np.minimum(row.astype(np.intp), rows - 2)
        flat, index = self._grid.ravel(), top * columns + left
        heights = tuple(flat[index + offset] for offset in (0, 1, columns, columns + 1))
        return heights, row - top, column - left

    def meet(self, origin: Array, directions: Array) -> Array:
        """First point (N, 3) where rays from `origin` (3,) along `directions` (N, 3) meet it, from
        the front or, where `origin` lies behind the whole relief, from behind.

        NaN for a ray that runs away from the mask. A march through the slab that holds
        the relief brackets the first crossing; regula falsi (Illinois) then closes to 0.1 um.
        """
        directions = np.asarray(directions, float)
        side = -1.0 if origin[2] < self._bottom else 1.0
        near, far = self._top + 1e-4, self._bottom - 1e-4
        near, far = (near, far) if side > 0 else (far, near)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.where(side * directions[:, 2] < 0, 1 / directions[:, 2], np.nan)
        start = (near - origin[2]) * inverse
        stop = (far - origin[2]) * inverse
        steps = start[:, None] + np.linspace(0, 1, MARCH_STEPS) * (stop - start)[:, None]
        above = side * self._above(origin, directions[:, None, :], steps)
        crossing = np.argmax(above <= 0, axis=1)
        ray = np.arange(len(directions))
        previous = np.maximum(crossing - 1, 0)
        low, high = steps[ray, previous], steps[ray, crossing]
        distance = self._close(origin, directions, low, high, side)
        return np.asarray(origin + distance[:, None] * directions)

    def _close(
        self, origin: Array, directions: Array, low: Array, high: Array, side: float
    ) -> Array:
        f_low = side * self._above(origin, directions, low)
        f_high = side * self._above(origin, directions, high)
        best = high
        for _ in range(40):
            span = f_low - f_high
            best = np.where(span > 0, low + (high - low) * f_low / np.where(span > 0, span, 1), low)
            value = side * self._above(origin, directions, best)
            if not np.any(np.abs(value) > TOLERANCE_M):
                break
            front = value > 0
            f_high = np.where(front, f_high * 0.5, value)
            f_low = np.where(front, value, f_low * 0.5)
            low, high = np.where(front, best, low), np.where(front, high, best)
        return best

    def _above(self, origin: Array, directions: Array, distance: Array) -> Array:
        points = origin + distance[..., None] * directions
        finite = np.nan_to_num(points[..., :2])
        return np.asarray(points[..., 2] - self.height(finite[..., 0], finite[..., 1]))
