"""Skin where the photograph has none: towards the mask's rim, behind hair and background.

Each texel has a weight of how far the photograph is believed there (PAPERS B5, B6). Where it is
not, the mean face stands in, with its colour multiplied by what the person's own skin is in
proportion to the mean's, carried smoothly outwards from where both are seen.
"""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.texture import regions
from hypermask.texture.normalise import SIZE

Image = NDArray[np.uint8]
Map = NDArray[np.float32]

_BORDER_MM = (3.0, 11.0)
_TESTED_MM = 26.0
_FOREHEAD_MM = 52.0
_BEARD_MM = -38.0
_LIMIT = 3.0
_LEAST_SPREAD = (14.0, 5.0, 5.0)
"""Lab units (0 to 255): light and shade vary more than hue."""


def skin_colour(texture: Image) -> NDArray[np.float32]:
    """Median Lab colour (3,) of the cheeks, OpenCV's 8-bit scale."""
    lab = cv2.cvtColor(texture[_cheeks()][:, None], cv2.COLOR_BGR2LAB)[:, 0].astype(np.float32)
    return np.asarray(np.median(lab, axis=0), np.float32)


@functools.cache
def _cheeks() -> NDArray[np.bool_]:
    return regions.cheeks() > 0.5


def belief(texture: Image) -> Map:
    """(SIZE, SIZE) 0 to 1: how far a normalised photograph (BGR) shows the face's skin there."""
    half = (SIZE // 2, SIZE // 2)  # skin is told by colours over millimetres, not by texels
    lab = cv2.cvtColor(cv2.resize(texture, half, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2LAB)
    seen = lab[_half_cheeks()].astype(np.float32)
    middle = np.median(seen, axis=0)
    spread = 1.4826 * np.median(np.abs(seen - middle), axis=0)
    spread = np.maximum(1.5 * spread, _LEAST_SPREAD)
    change = np.column_stack([np.diag(1 / spread), -middle / spread])
    scaled = cv2.transform(lab.astype(np.float32), change)
    distance = np.sqrt(cv2.transform(scaled * scaled, np.ones((1, 3))))
    strange = regions.ramp(distance, _LIMIT - 0.5, _LIMIT + 0.5) * _half_tested()
    strange = regions.soften(regions.grow(regions.grow(strange, -0.6), 3.6), 1.5)
    fine = cv2.resize(strange, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)
    return np.asarray(_inside() * (1 - fine), np.float32)


@functools.cache
def _inside() -> Map:
    return regions.ramp(regions.depth_mm(), *_BORDER_MM)


@functools.cache
def _half_cheeks() -> NDArray[np.bool_]:
    return _halved(regions.cheeks()) > 0.9


@functools.cache
def _half_tested() -> Map:
    return _halved(_tested())


def _halved(values: Map) -> Map:
    half = (SIZE // 2, SIZE // 2)
    return np.asarray(cv2.resize(values, half, interpolation=cv2.INTER_AREA), np.float32)


@functools.cache
def _tested() -> Map:
    """1 where hair or background can be: near the outline and on the forehead; not on a beard."""
    _, y = regions.grid_mm()
    depth = regions.depth_mm()
    near = 1 - regions.ramp(depth, _TESTED_MM - 6, _TESTED_MM + 6)
    forehead = regions.ramp(y, _FOREHEAD_MM - 4, _FOREHEAD_MM + 4)
    beard = regions.ramp(-y, -_BEARD_MM - 12, -_BEARD_MM + 12) * regions.ramp(depth, 2, 9)
    tested = np.maximum(near, forehead) * (1 - beard) * (1 - regions.features(0.4))
    return np.asarray(tested, np.float32)


def fill(texture: Image, weight: Map, mean: Image) -> Image:
    """`texture` where `weight` is 1, the recoloured `mean` where it is 0 (all BGR)."""
    ratio = np.log((texture.astype(np.float32) + 12) / (mean.astype(np.float32) + 12))
    skin = weight * (1 - regions.features())
    ratio = cv2.GaussianBlur(ratio * skin[..., None], (0, 0), 4)
    share = cv2.GaussianBlur(skin, (0, 0), 4)
    spread = diffuse(ratio / np.maximum(share, 1e-4)[..., None], np.minimum(share, skin))
    stand_in = (mean.astype(np.float32) + 12) * np.exp(spread) - 12
    mixed = weight[..., None] * texture + (1 - weight[..., None]) * stand_in
    return np.clip(mixed, 0, 255).astype(np.uint8)


def diffuse(values: Map, weight: Map) -> Map:
    """Values (h, w, c) carried from where `weight` is 1 to where it is 0, by a pyramid.

    (Gortler et al. 1996, push-pull.)
    """
    if min(weight.shape) <= 2:
        total = max(float(weight.sum()), 1e-6)
        middle = (values * weight[..., None]).sum(axis=(0, 1)) / total
        return np.asarray(np.broadcast_to(middle, values.shape), np.float32)
    less = cv2.pyrDown(weight)
    coarse = cv2.pyrDown(values * weight[..., None]) / np.maximum(less, 1e-6)[..., None]
    believed = np.minimum(less * 2, 1).astype(np.float32)
    below = diffuse(np.asarray(coarse, np.float32), believed)
    size = (weight.shape[1], weight.shape[0])
    smooth = cv2.GaussianBlur(cv2.resize(below, size, interpolation=cv2.INTER_LINEAR), (0, 0), 1.5)
    return np.asarray(values * weight[..., None] + smooth * (1 - weight[..., None]), np.float32)


def balance(texture: Image, mean: Image) -> Image:
    """White balance and exposure part of the way towards the mean; a person's own skin stays.

    texture: (SIZE or more, same, 3) BGR.
    """
    size = (SIZE, SIZE)
    sample = texture if texture.shape[:2] == size else _resized(texture, size)
    own, wanted = skin_colour(sample), skin_colour(mean)
    shift = np.clip((wanted - own) * (0.2, 0.4, 0.4), (-12, -6, -6), (16, 6, 6))
    light = np.arange(256) / 255
    lightness = np.arange(256) + shift[0] * 4 * light * (1 - light) * 1.2
    hue = np.floor(shift[1:] * np.minimum(light * 2, 1)[:, None]).astype(np.int8)
    level, a, b = cv2.split(cv2.cvtColor(texture, cv2.COLOR_BGR2LAB))
    shifted = [cv2.LUT(level, np.clip(lightness, 0, 255).astype(np.uint8))]
    for channel, table in ((a, hue[:, 0]), (b, hue[:, 1])):
        shifted.append(cv2.add(channel, table[level], dtype=cv2.CV_8U))
    return np.asarray(cv2.cvtColor(cv2.merge(shifted), cv2.COLOR_LAB2BGR), np.uint8)


def _resized(texture: Image, size: tuple[int, int]) -> Image:
    return np.asarray(cv2.resize(texture, size, interpolation=cv2.INTER_AREA), np.uint8)
