"""Where the pupils are: the iris is the darkest disc between the lids, near straight ahead."""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.points import LEFT_EYE, RIGHT_EYE

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

VERSION = 1
FILE = Path(__file__).with_name("data") / "pupils.json"
_WIDTH = 64
"""Pixels from corner to corner of the eye in the patch that is searched."""
_PATCH = (96, 64)
_AHEAD = np.array([47.5, 31.5 - 0.096 * _WIDTH])
"""Where the pupil is in the patch when looking ahead: the mean of 130 faces."""
_IRIS = 0.19 * _WIDTH
_REACH = (14.0, 7.0)
_PULL = 5.0
_CELLS = (24, 16)
_HALF = np.array([28.0, 18.0])
_MOST = 5.0
_HIDDEN = 0.018 * _WIDTH
"""The upper lid hides the top of the iris, so the centre of what is seen is this much too low."""


RINGS = (LEFT_EYE, RIGHT_EYE)


@dataclass(frozen=True)
class EyePatch:
    """An eye in a patch of its own, the outer corner to the left; guess: (2,) where its iris seems
    to be. turn, offset: patch to photograph; mirrored: whether it was turned over for that.
    """

    grey: NDArray[np.float32]
    guess: Array
    turn: Array
    offset: Array
    mirrored: bool

    @property
    def pixel(self) -> float:
        """Pixels of the photograph a pixel of the patch."""
        return float(np.hypot(*self.turn[:, 0]))

    def to_patch(self, place: Array) -> Array:
        x, y = np.linalg.solve(self.turn, place - self.offset)
        return np.array([_PATCH[0] - 1 - x if self.mirrored else x, y])

    def to_photo(self, place: Array) -> Array:
        x, y = place
        flat = np.array([_PATCH[0] - 1 - x if self.mirrored else x, y])
        return np.asarray(self.turn @ flat + self.offset)

    def view(self) -> Array:
        """(n,) what is round the guess, coarsely, free of brightness and contrast."""
        wide, high = (2 * half / count for half, count in zip(_HALF, _CELLS, strict=True))
        corner = self.guess - _HALF + np.array([wide, high]) / 2
        smooth = cv2.GaussianBlur(self.grey, (0, 0), 1.5)
        matrix = np.array([[wide, 0, corner[0]], [0, high, corner[1]]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        cells = cv2.warpAffine(
            smooth, matrix, _CELLS, flags=flags, borderMode=cv2.BORDER_REPLICATE
        ).astype(float)
        return np.asarray(((cells - cells.mean()) / (cells.std() + 1)).ravel())


def find_pupils(image: Image, points: Array) -> Array:
    """(2, 2) pixels, the image's left one first, from 468 landmarks (468, 2) on a BGR image.

    The darkest disc, then what a linear map of the eye's picture adds: learnt from 130 faces
    (`hypermask.texture.pupils_train`), on those left out the error is halved.
    """
    weights, constant = _correction()
    found = []
    for ring, mirrored in zip(RINGS, (False, True), strict=True):
        patch = eye_patch(image, points, ring, mirrored)
        more = np.clip(patch.view() @ weights + constant, -_MOST, _MOST)
        found.append(patch.to_photo(patch.guess + more))
    return np.array(found)


@functools.cache
def _correction() -> tuple[Array, Array]:
    data = json.loads(FILE.read_text("utf-8"))
    return np.array(data["weights"], float), np.array(data["constant"], float)


def eye_patch(image: Image, points: Array, ring: Sequence[int], mirrored: bool) -> EyePatch:
    """The patch of the eye with this outline; mirrored: for the image's right one."""
    outline = points[list(ring)]
    axis = outline[8] - outline[0]  # corner to corner: the ninth point is the other corner
    turn = np.array([[axis[0], -axis[1]], [axis[1], axis[0]]]) / _WIDTH
    offset = (outline[0] + outline[8]) / 2 - turn @ ((np.array(_PATCH) - 1) / 2)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    patch = cv2.warpAffine(image, np.column_stack([turn, offset]), _PATCH, flags=flags)
    flat = (outline - offset) @ np.linalg.inv(turn).T
    place = _darkest(patch.mean(axis=2).astype(np.float32), flat) - (0, _HIDDEN)
    grey = cv2.cvtColor(patch, cv2.COLOR_BGR2GRAY).astype(np.float32)
    if mirrored:
        grey = np.ascontiguousarray(grey[:, ::-1])
        place = np.array([_PATCH[0] - 1 - place[0], place[1]])
    return EyePatch(grey, np.asarray(place), turn, offset, mirrored)


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
