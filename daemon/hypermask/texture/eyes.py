"""Eyeballs behind the lids: the photograph's eye, completed where the lids hide it."""

from __future__ import annotations

import functools
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.points import LEFT_EYE, RIGHT_EYE
from hypermask.texture import regions
from hypermask.texture.fill import diffuse

Image = NDArray[np.uint8]
Map = NDArray[np.float32]

WIDTH, HEIGHT = 160, 112
"""Texels of one eye."""
HALF_MM = (20.0, 14.0)
CENTRES_MM = ((-31.0, 25.0), (31.0, 25.0))
IRIS_MM = 6.2
_PUPIL_MM = 2.5
_LEAST_WHITE = 150.0


def eye_textures(texture: Image) -> Image:
    """(HEIGHT, 2 * WIDTH, 3): left and right eye of a normalised texture, without lids."""
    eyes = [
        _eye(texture, centre, outline)
        for centre, outline in zip(CENTRES_MM, (LEFT_EYE, RIGHT_EYE), strict=True)
    ]
    return np.concatenate(eyes, axis=1)


def _eye(texture: Image, centre: tuple[float, float], outline: tuple[int, ...]) -> Image:
    x, y = _grid()
    place, seen, keep = _frame(centre, outline)
    photo = _sample(texture, place).astype(np.float32)
    middle = _iris_centre(photo, seen)
    radius = np.hypot(x - middle[0], y - middle[1]).astype(np.float32)
    white = _white(photo, seen, radius, x)
    iris = _iris(photo, seen, radius, y - middle[1])
    inside = 1 - regions.ramp(radius, IRIS_MM - 0.5, IRIS_MM + 0.4)[..., None]
    whole = white * (1 - inside) + iris * inside
    return np.asarray(np.clip(photo * keep + whole * (1 - keep), 0, 255), np.uint8)


@functools.cache
def _frame(centre: tuple[float, float], outline: tuple[int, ...]) -> tuple[Map, Map, Map]:
    """(the texels' places in the texture (h, w, 2), where the eye is open, how far it is kept)."""
    x, y = _grid()
    places = regions.to_texels(np.stack([x + centre[0], y + centre[1]], -1).reshape(-1, 2))
    place = places.reshape(HEIGHT, WIDTH, 2).astype(np.float32)
    opening = regions.grow(regions.polygon(outline), -0.8)
    seen = np.asarray(_sample(opening, place), np.float32)
    keep = np.asarray(cv2.GaussianBlur(seen, (0, 0), 2)[..., None] * 0.85, np.float32)
    return place, seen, keep


def _sample(image: NDArray[Any], place: Map) -> NDArray[Any]:
    return np.asarray(cv2.remap(image, place[..., 0], place[..., 1], cv2.INTER_LINEAR))


@functools.cache
def _grid() -> tuple[Map, Map]:
    """(x, y) mm from the eye's centre of each texel; y up."""
    x = ((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1) * HALF_MM[0]
    y = (1 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 2) * HALF_MM[1]
    xs, ys = np.meshgrid(x, y)
    return xs.astype(np.float32), ys.astype(np.float32)


def _iris_centre(photo: Map, seen: Map) -> tuple[float, float]:
    """(x, y) mm: where a disc of the iris's size is darkest, not far from straight ahead."""
    grey = _grey(photo)
    usual = float(np.median(grey[seen > 0.5]))
    dark = np.where(seen > 0.5, usual - grey, 0).astype(np.float32)
    x, y = _grid()
    score = cv2.filter2D(dark, -1, _disc(), borderType=cv2.BORDER_CONSTANT)
    score = np.where((np.abs(x) < 5) & (np.abs(y) < 2.5), score - 0.15 * np.hypot(x, y), -1e9)
    best = int(np.argmax(score))
    return float(x.ravel()[best]), float(y.ravel()[best])


@functools.cache
def _disc() -> Map:
    """The iris without its edge, summing to 1, no larger than it must be."""
    x, y = _grid()
    disc = (np.hypot(x, y) < IRIS_MM * 0.8).astype(np.float32)
    rows, columns = (np.flatnonzero(disc.any(axis=axis)) for axis in (1, 0))
    small = disc[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return np.asarray(small / small.sum(), np.float32)


def _grey(photo: Map) -> Map:
    return np.asarray(cv2.transform(photo, np.full((1, 3), 1 / 3)), np.float32)


def _white(photo: Map, seen: Map, radius: Map, x: Map) -> Map:
    """The white of the eye, carried outwards from where it is seen, shaded towards the lids."""
    usable = ((seen > 0.9) & (radius > IRIS_MM + 0.7)).astype(np.float32)
    if usable.sum() < 20:
        return np.full(photo.shape, (196, 200, 208), np.float32)
    light = photo[usable > 0.5]
    bright = np.percentile(light.mean(axis=1), 60)
    usable *= _grey(photo) >= bright * 0.7
    known = np.asarray(cv2.GaussianBlur(usable, (0, 0), 1.5), np.float32)
    white = diffuse(np.asarray(cv2.GaussianBlur(photo, (0, 0), 1.5), np.float32), known)
    grey = _grey(white)[..., None]
    white *= 0.4
    white += 0.6 * grey
    white *= max(1.0, _LEAST_WHITE / max(float(np.median(grey)), 1.0))
    shade = 1 - 0.25 * regions.ramp(np.abs(x), 8, 18)
    return np.asarray(white * shade[..., None], np.float32)


def _iris(photo: Map, seen: Map, radius: Map, y: Map) -> Map:
    """A whole iris in the photograph's own colour, darker at its edge, with a dark pupil."""
    ring = (seen > 0.5) & (radius > _PUPIL_MM + 0.5) & (radius < IRIS_MM - 1)
    colour = np.median(photo[ring], axis=0) if ring.sum() > 20 else np.array((52, 62, 74))
    edge = 1 - 0.45 * regions.ramp(radius, IRIS_MM - 1.6, IRIS_MM)
    lit = 1 - 0.12 * regions.ramp(y, -IRIS_MM, IRIS_MM)
    iris = colour * (edge * lit)[..., None]
    pupil = 1 - regions.ramp(radius, _PUPIL_MM - 0.4, _PUPIL_MM + 0.4)
    return np.asarray(iris * (1 - 0.85 * pupil[..., None]), np.float32)
