"""Where the pupils are: the iris is the darkest disc between the lids, near straight ahead."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.points import LEFT_EYE, RIGHT_EYE

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_WIDTH = 64
"""Pixels from corner to corner of the eye in the patch that is searched."""
_PATCH = (96, 64)
_AHEAD = np.array([47.5, 31.5 - 0.096 * _WIDTH])
"""Where the pupil is in the patch when looking ahead: the mean of 130 faces."""
_IRIS = 0.19 * _WIDTH
_REACH = (14.0, 7.0)
_PULL = 5.0
_HIDDEN = 0.018 * _WIDTH
"""The upper lid hides the top of the iris, so the centre of what is seen is this much too low."""


def find_pupils(image: Image, points: Array) -> Array:
    """(2, 2) pixels, the image's left one first, from 468 landmarks (468, 2) on a BGR image."""
    return np.array([_pupil(image, points, ring) for ring in (LEFT_EYE, RIGHT_EYE)])


def _pupil(image: Image, points: Array, ring: Sequence[int]) -> Array:
    outline = points[list(ring)]
    axis = outline[8] - outline[0]  # corner to corner: the ninth point is the other corner
    turn = np.array([[axis[0], -axis[1]], [axis[1], axis[0]]]) / _WIDTH
    offset = (outline[0] + outline[8]) / 2 - turn @ ((np.array(_PATCH) - 1) / 2)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    patch = cv2.warpAffine(image, np.column_stack([turn, offset]), _PATCH, flags=flags)
    flat = (outline - offset) @ np.linalg.inv(turn).T
    place = _darkest(patch.mean(axis=2).astype(np.float32), flat)
    return np.asarray(turn @ (place - (0, _HIDDEN)) + offset)


def _darkest(grey: NDArray[np.float32], outline: Array) -> Array:
    """(x, y) in the patch: the best mean darkness over a disc, less a pull to straight ahead."""
    opening = np.zeros(grey.shape, np.uint8)
    cv2.fillPoly(opening, [np.round(outline * 16).astype(np.int32)], 1, cv2.LINE_8, 4)
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.5)
    seen = smooth[opening > 0]
    if seen.size < 20:
        return _AHEAD
    white = float(np.percentile(seen, 85))
    dark = np.where(opening > 0, white - smooth, 0) / max(white - float(seen.min()), 1.0)
    y, x = np.mgrid[-16:17, -16:17]
    disc = (np.hypot(x, y) < _IRIS).astype(np.float32)
    score = cv2.filter2D(dark, -1, disc / disc.sum(), borderType=cv2.BORDER_CONSTANT)
    ys, xs = np.mgrid[: grey.shape[0], : grey.shape[1]]
    across, up = xs - _AHEAD[0], ys - _AHEAD[1]
    score = score - _PULL * (across**2 + 2 * up**2) / _WIDTH**2
    score[(np.abs(across) > _REACH[0]) | (np.abs(up) > _REACH[1])] = -np.inf
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    return np.array([column, row], float)
