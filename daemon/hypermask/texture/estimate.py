"""What the photograph cannot show, estimated by the morphable model (PAPERS B5, B6).

The model's coefficients are found from the texels of a regular grid with spacing k, each with a
weight of how far it is believed. Two solvers: `ridge`, in closed form with the faces' own
variances as prior, and `levenberg_marquardt`, the paper's. What the model leaves of the person
where the photograph is believed is then carried smoothly into the part that was estimated.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.texture import regions
from hypermask.texture.fill import diffuse
from hypermask.texture.morphable import SIDE, MorphableModel

Map = NDArray[np.float32]
Array = NDArray[np.float64]
Solver = Literal["ridge", "levenberg_marquardt"]

SPACING = 8
BASES = 32
PAPER_BASES = 20
_CORRELATION = 800.0
"""Texels of the model over which what it leaves is alike: so many count as one measurement.
Chosen on faces left out, parts of them hidden; 600 to 1500 are about as good."""
_ITERATIONS = 100
_TOLERANCE = 1e-6
_STRANGE = (3.0, 4.5)
_ROUNDS = 3
_FIRST = 8
"""Bases of the first round: too few for dark eyes to be fitted to sunglasses."""
_SMOOTH = 2.0
_INNER_MM = 15.0
_LEAST_LIGHT = 0.55
_MIRRORED = 0.7
"""How much of what is a person's own on one side of the face is taken to be on the other."""


@functools.lru_cache(maxsize=8)
def _samples(model: MorphableModel, spacing: int, count: int) -> tuple[Array, Array]:
    """(mean (3 m,), bases (count, 3 m)) on the grid's m texels."""
    mean = on_grid(model.mean, spacing).reshape(-1)
    bases = [on_grid(basis, spacing).reshape(-1) for basis in model.bases[:count]]
    return mean.astype(float), np.array(bases, float).reshape(len(bases), -1)


def on_grid(texture: NDArray[np.float32], spacing: int) -> NDArray[np.float32]:
    """Every spacing-th texel of the rows and columns, from the middle of the first cell."""
    start = spacing // 2
    return texture[start::spacing, start::spacing]


def ridge(
    model: MorphableModel, texture: Map, weight: Map, spacing: int = SPACING, count: int = BASES
) -> Array:
    """(count,) coefficients c = (B W B' + s2 L^-1)^-1 B W (x - mean), the most likely ones.

    texture: (SIDE, SIDE, 3); weight: (SIDE, SIDE), 0 to 1. L: the faces' variances; s2: the
    variance of what the bases leave, greater where the grid is finer than that varies. On a coarse
    grid each point is the mean of four, which costs little and takes half the noise away.
    """
    starts = _starts(spacing)
    means, bases = _cells(model, spacing, count)
    share = [weight[y::spacing, x::spacing] for y, x in starts]
    total = np.sum(share, axis=0)
    parts = zip(starts, means, share, strict=True)
    weighted = [w[..., None] * (texture[y::spacing, x::spacing] - m) for (y, x), m, w in parts]
    wanted = (np.sum(weighted, axis=0) / np.maximum(total, 1e-6)[..., None]).reshape(-1)
    weights = np.repeat(total.reshape(-1) / len(starts), 3).astype(float)
    noise = model.noise * max(_CORRELATION / spacing**2, 1.0)
    scaled = bases * weights
    normal = scaled @ bases.T + np.diag(noise / model.variances[:count])
    return np.linalg.solve(normal, scaled @ wanted)


def _starts(spacing: int) -> list[tuple[int, int]]:
    """(row, column) in a cell of the texels that stand for it."""
    if spacing < 4:
        return [(spacing // 2, spacing // 2)]
    places = spacing // 4, spacing - spacing // 4 - 1
    return [(y, x) for y in places for x in places]


@functools.lru_cache(maxsize=8)
def _cells(model: MorphableModel, spacing: int, count: int) -> tuple[list[Map], Array]:
    """(means at each of the starts (h, w, 3), bases (count, 3 m) averaged over them)."""
    starts = _starts(spacing)
    means = [np.ascontiguousarray(model.mean[y::spacing, x::spacing]) for y, x in starts]
    bases = [model.bases[:count, y::spacing, x::spacing] for y, x in starts]
    return means, np.mean(bases, axis=0, dtype=float).reshape(min(count, model.count), -1)


def levenberg_marquardt(
    model: MorphableModel, texture: Map, weight: Map, spacing: int = SPACING, count: int = BASES
) -> Array:
    """(count,) coefficients of least 1/2 sum |W (d - U a)|^2 as in the paper, from a = 0.

    No prior, and weights that are squared with the residual; damping after Marquardt (1963) and
    Nielsen (1999).
    """
    mean, bases = _samples(model, spacing, count)
    weights = np.repeat(on_grid(weight, spacing).reshape(-1), 3).astype(float)
    wanted = on_grid(texture, spacing).reshape(-1) - mean
    place = np.zeros(count)
    damping, factor = 0.0, 2.0
    residual = weights * (wanted - place @ bases)
    error = float(residual @ residual) / 2
    for _ in range(_ITERATIONS):
        jacobian = bases * weights
        normal, slope = jacobian @ jacobian.T, jacobian @ residual
        damping = damping or 1e-3 * float(normal.diagonal().max())
        while True:
            step = np.linalg.solve(normal + damping * np.eye(count), slope)
            residual = weights * (wanted - (place + step) @ bases)
            lower = error - float(residual @ residual) / 2
            if lower >= 0 or damping > 1e20:
                break
            damping, factor = damping * factor, factor * 2
        place, error = place + step, error - lower
        damping, factor = damping / 3, 2.0
        if np.linalg.norm(step) <= _TOLERANCE * (np.linalg.norm(place) + _TOLERANCE):
            break
    return place


SOLVERS = {"ridge": ridge, "levenberg_marquardt": levenberg_marquardt}


@dataclass(frozen=True)
class Estimate:
    """coefficients; modelled: (SIDE, SIDE, 3), the model's texture alone; whole: the same with the
    person's own residual carried into it; weight: (SIDE, SIDE) without what is before the face.
    """

    coefficients: Array
    modelled: Map
    whole: Map
    weight: Map


def estimate(
    model: MorphableModel,
    texture: Map,
    weight: Map,
    solver: Solver = "ridge",
    spacing: int = SPACING,
    count: int = BASES,
) -> Estimate:
    """The whole face from what is believed of it: texture (SIDE, SIDE, 3), weight (SIDE, SIDE).

    What lies before the face (hand, glasses, hair) differs from the model by far more than faces
    do; its weight is taken away and the model is fitted again.
    """
    count = min(count, model.count)
    solve, kept = SOLVERS[solver], weight
    coefficients = solve(model, texture, kept, spacing, min(_FIRST, count))
    for _ in range(_ROUNDS):
        kept = weight * (1 - strange(model, texture, weight, coefficients))
        coefficients = solve(model, texture, kept, spacing, count)
    modelled = model.texture(coefficients)
    whole = modelled + carried(texture - modelled, kept)
    whole += mirrored(texture - whole, kept)
    return Estimate(coefficients, modelled, np.asarray(np.clip(whole, 0, 255), np.float32), kept)


def hidden_share(believed: Map, kept: Map) -> float:
    """Of the face's inner part: how much of what was believed turned out to be something else."""
    inner = _inner()
    return float(((believed - kept) * inner).sum() / max(float((believed * inner).sum()), 1.0))


@functools.cache
def _inner() -> Map:
    return (small(regions.depth_mm()) > _INNER_MM).astype(np.float32)


def strange(model: MorphableModel, texture: Map, weight: Map, coefficients: Array) -> Map:
    """(SIDE, SIDE) 0 to 1: how surely something that is no face lies there (at half resolution)."""
    size = (SIDE // 2, SIDE // 2)
    mean, bases, spread = _halved(model)
    count = len(coefficients)
    offset = coefficients.astype(np.float32) @ bases[:count].reshape(count, -1)
    half = cv2.resize(texture, size, interpolation=cv2.INTER_AREA)
    residual = half - mean - offset.reshape(mean.shape)
    smooth = cv2.GaussianBlur(residual, (0, 0), _SMOOTH / 2)
    ratio = np.sqrt(cv2.transform(smooth * smooth, np.full((1, 3), 1 / 3))) / spread
    ratio /= _light(mean + offset.reshape(mean.shape), mean)
    seen = cv2.resize(weight, size, interpolation=cv2.INTER_AREA) > 0
    found = regions.ramp(np.asarray(ratio, np.float32), *_STRANGE) * seen
    grown = cv2.dilate(found, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5)))
    return np.asarray(cv2.resize(grown, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR), np.float32)


def _light(modelled: Map, mean: Map) -> float:
    """Dark skin differs from face to face, and from what covers it, by fewer levels than light."""
    middle = np.s_[SIDE // 8 : -SIDE // 8 : 4, SIDE // 8 : -SIDE // 8 : 4]
    return float(np.clip(modelled[middle].mean() / mean[middle].mean(), _LEAST_LIGHT, 1))


@functools.lru_cache(maxsize=8)
def _halved(model: MorphableModel) -> tuple[Map, Map, Map]:
    """(mean, bases, spread) at half the model's resolution."""
    size = (SIDE // 2, SIDE // 2)
    parts = [model.mean, *model.bases, model.spread]
    mean, *bases, spread = (cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in parts)
    return np.asarray(mean, np.float32), np.array(bases, np.float32), np.asarray(spread, np.float32)


def carried(residual: Map, weight: Map) -> Map:
    """The residual (SIDE, SIDE, 3) of the skin that is believed, carried to where it is not."""
    skin = weight * _no_features()
    share = cv2.GaussianBlur(skin, (0, 0), 2)
    smooth = cv2.GaussianBlur(residual * skin[..., None], (0, 0), 2)
    values = smooth / np.maximum(share, 1e-4)[..., None]
    return diffuse(np.asarray(values, np.float32), np.minimum(share, skin))


def mirrored(residual: Map, weight: Map) -> Map:
    """The residual (SIDE, SIDE, 3) of skin that is believed, where only its mirror image is not."""
    other = np.ascontiguousarray(weight[:, ::-1])
    share = _MIRRORED * other * (1 - weight)
    return np.asarray(np.ascontiguousarray(residual[:, ::-1]) * share[..., None], np.float32)


@functools.cache
def _no_features() -> Map:
    return np.asarray(1 - small(regions.features()), np.float32)


def small(texture: NDArray[np.uint8] | Map) -> Map:
    """A texture or map of any size at the model's resolution."""
    return np.asarray(cv2.resize(texture, (SIDE, SIDE), interpolation=cv2.INTER_AREA), np.float32)


def blend(texture: NDArray[np.uint8], weight: Map, estimated: Map) -> NDArray[np.uint8]:
    """x^ = W x + (I - W) x~ (PAPERS B6): (h, w, 3), rounded to whole levels."""
    seen = texture.astype(np.float32)
    mixed = cv2.blendLinear(seen, estimated, weight, 1 - weight)
    return np.asarray(cv2.convertScaleAbs(mixed), np.uint8)


def forget() -> None:
    """Free what is kept of models that were used."""
    _samples.cache_clear()
    _cells.cache_clear()
    _halved.cache_clear()
