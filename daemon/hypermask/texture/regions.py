"""Where in the texture's layout the skin, the features and the face's border are."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.mesh import HALF_HEIGHT_M, HALF_WIDTH_M, load_mesh
from hypermask.face.points import (
    LEFT_BROW,
    LEFT_EYE,
    LIPS_OUTER,
    OVAL,
    RIGHT_BROW,
    RIGHT_EYE,
)
from hypermask.texture.normalise import SIZE

Map = NDArray[np.float32]

_CHEEKS = ((117, 50, 205, 203, 129, 114), (346, 280, 425, 423, 358, 343))
_NOSTRILS = (98, 97, 2, 326, 327, 358, 4, 129)


def to_texels(points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Texel coordinates (n, 2) of points (n, 2) in mm on the mask."""
    u = (points_mm[:, 0] / 1000 + HALF_WIDTH_M) / (2 * HALF_WIDTH_M)
    v = (HALF_HEIGHT_M - points_mm[:, 1] / 1000) / (2 * HALF_HEIGHT_M)
    return np.stack([u, v], axis=1) * SIZE - 0.5


@functools.cache
def grid_mm() -> tuple[Map, Map]:
    """(x, y) in mm on the mask of each texel's centre."""
    line = (np.arange(SIZE, dtype=np.float32) + 0.5) / SIZE
    x = (2 * line - 1) * HALF_WIDTH_M * 1000
    y = (1 - 2 * line) * HALF_HEIGHT_M * 1000
    xs, ys = np.meshgrid(x, y)
    return xs.astype(np.float32), ys.astype(np.float32)


def polygon(landmarks: Sequence[int]) -> Map:
    """1 inside the outline through these landmarks, 0 outside."""
    points = to_texels(load_mesh().rest[list(landmarks)] * 1000)
    mask = np.zeros((SIZE, SIZE), np.uint8)
    cv2.fillPoly(mask, [np.round(points * 16).astype(np.int32)], 1, lineType=8, shift=4)
    return mask.astype(np.float32)


def grow(mask: Map, millimetres: float) -> Map:
    """A region grown (or shrunk, where negative) by so many mm; the texture is not square."""
    pixels = [
        abs(millimetres) * mask.shape[0] / (2000 * half) for half in (HALF_WIDTH_M, HALF_HEIGHT_M)
    ]
    size = tuple(2 * round(p) + 1 for p in pixels)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, size)
    return np.asarray((cv2.dilate if millimetres > 0 else cv2.erode)(mask, kernel), np.float32)


def soften(mask: Map, millimetres: float) -> Map:
    sigmas = [millimetres * mask.shape[0] / (2000 * half) for half in (HALF_WIDTH_M, HALF_HEIGHT_M)]
    return np.asarray(cv2.GaussianBlur(mask, (0, 0), sigmas[0], sigmaY=sigmas[1]), np.float32)


@functools.cache
def depth_mm() -> Map:
    """Distance inside the face's outline in mm, negative outside."""
    inside = polygon(OVAL)
    height = round(SIZE * HALF_HEIGHT_M / HALF_WIDTH_M)
    square = cv2.resize(inside, (SIZE, height), interpolation=cv2.INTER_NEAREST).astype(np.uint8)
    inner = cv2.distanceTransform(square, cv2.DIST_L2, 5)
    outer = cv2.distanceTransform(1 - square, cv2.DIST_L2, 5)
    depth = cv2.resize(inner - outer, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    return np.asarray(depth * (2000 * HALF_WIDTH_M / SIZE), np.float32)


@functools.cache
def cheeks() -> Map:
    """Skin for certain: what the skin's colour is measured on."""
    return np.maximum(polygon(_CHEEKS[0]), polygon(_CHEEKS[1]))


@functools.cache
def features(margin: float = 1.0) -> Map:
    """Eyes, brows, nostrils and lips with a margin (1: some mm): never skin."""
    outlines = (LEFT_EYE, RIGHT_EYE, LEFT_BROW, RIGHT_BROW, LIPS_OUTER, _NOSTRILS)
    margins = (6.0, 6.0, 4.0, 4.0, 4.0, 2.0)
    grown = [grow(polygon(o), m * margin) for o, m in zip(outlines, margins, strict=True)]
    return np.asarray(np.max(grown, axis=0), np.float32)


def ramp(values: Map, low: float, high: float) -> Map:
    """0 at `low` and below, 1 at `high` and above, smooth between."""
    t = np.asarray(values, np.float32) - np.float32(low)
    t *= np.float32(1 / (high - low))
    np.clip(t, 0, 1, out=t)
    smooth = t * t
    t *= -2
    t += 3
    smooth *= t
    return smooth
