"""From a projective map of mask metres to projector pixels, to what the GPU clips and rasterises.

All of it in float64, where pixels of a thousand and depths of metres may cancel; only the finished
matrix, whose entries are about 1, is rounded to float32, which costs less than 0.001 px.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_DEPTH_RANGE = 0.9  # of -1..1, so that rounding never clips a vertex
_PARALLEL = 1e-9


@dataclass(frozen=True)
class View:
    """matrix: (4, 4) float32, clip_from_mask; box: (x, y, width, height), the part of the frame
    that the points cover, in OpenGL's window pixels (y up)."""

    matrix: NDArray[np.float32]
    box: tuple[int, int, int, int]


def view_of(
    projector_from_mask: ArrayLike, points: ArrayLike, size: tuple[int, int]
) -> View | None:
    """The view of points (V, 3) mask metres through a (3, 4) map, in a frame (width, height) px.

    None when nothing can be seen: a point is behind the projector, or all are beside the frame.
    Raises `ValueError` when a number is not finite.
    """
    projection = np.asarray(projector_from_mask, float).reshape(3, 4)
    mask_points = np.asarray(points, float).reshape(-1, 3)
    if not (np.isfinite(projection).all() and np.isfinite(mask_points).all()):
        raise ValueError("not finite")
    projection = _facing(projection, mask_points)
    image = mask_points @ projection[:, :3].T + projection[:, 3]
    scale = np.abs(projection[2]).max()
    if image[:, 2].min() <= 1e-6 * scale or scale == 0:
        return None
    box = _box(image[:, :2] / image[:, 2:], size)
    if box is None:
        return None
    matrix = np.vstack(
        [_ndc_rows(projection, size), _depth_row(projection, mask_points), projection[2]]
    )
    return View((matrix / np.abs(matrix[3]).max()).astype(np.float32), box)


def _facing(projection: Array, points: Array) -> Array:
    """The same map with the sign that puts the points in front (a homography has none)."""
    depth = points.mean(axis=0) @ projection[2, :3] + projection[2, 3]
    return projection if depth >= 0 else -projection


def _ndc_rows(projection: Array, size: tuple[int, int]) -> Array:
    """Rows x and y of the clip matrix; pixel (0, 0) is the centre of the top left pixel."""
    width, height = size
    x = 2 / width * projection[0] + (1 / width - 1) * projection[2]
    y = -2 / height * projection[1] + (1 - 1 / height) * projection[2]
    return np.stack([x, y])


def _depth_row(projection: Array, points: Array) -> Array:
    """Row z of the clip matrix: what is nearer to the projector hides what is behind it.

    A map with a centre of projection orders by w, its depth. A parallel one (also a homography
    of the plane, whose z column is zero) orders along its direction, the mask's front nearer.
    """
    centre = _centre(projection)
    w = projection[2]
    if abs(centre[3]) > _PARALLEL * np.abs(centre[:3]).max():
        depth = points @ w[:3] + w[3]
        near, far = float(depth.min()), float(depth.max())
        far = max(far, near * (1 + 1e-6))
        # z/w = a + b/w runs from -range at `near` to +range at `far`
        b = -2 * _DEPTH_RANGE / (1 / near - 1 / far)
        a = _DEPTH_RANGE - b / far
        row = a * w
        row[3] += b
        return np.asarray(row)
    towards = np.append(centre[:3] * np.sign(centre[2] or 1.0), 0.0)
    height = points @ towards[:3] / (points @ w[:3] + w[3])
    low, high = float(height.min()), float(height.max())
    span = max(high - low, 1e-9)
    return np.asarray(2 * _DEPTH_RANGE / span * ((low + high) / 2 * w - towards))


def _centre(projection: Array) -> Array:
    """The centre of projection (4,), homogeneous: the vector that the map sends to zero."""
    rows = projection / np.maximum(np.linalg.norm(projection, axis=1, keepdims=True), 1e-300)
    centre: Array = np.linalg.svd(rows)[2][3]
    return centre


def _box(pixels: Array, size: tuple[int, int]) -> tuple[int, int, int, int] | None:
    width, height = size
    low = np.clip(np.floor(pixels.min(axis=0)) - 1, 0, (width, height)).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0)) + 2, 0, (width, height)).astype(int)
    if (high <= low).any():
        return None
    left, right = int(low[0]), int(high[0])
    top, bottom = int(low[1]), int(high[1])
    return left, height - bottom, right - left, bottom - top
