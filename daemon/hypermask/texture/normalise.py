"""The normalised texture: the mesh at rest with the photograph mapped on to it (PAPERS B3)."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.mesh import RIM, even_lips, load_mesh
from hypermask.face.points import LIP_COLUMNS, OVAL
from hypermask.texture.fit import hardy_fit

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Map = NDArray[np.float32]
Fit = Literal["landmarks", "hardy"]
"""All 468 landmarks, affine in each triangle; or the paper's 84 and a multiquadric."""

SIZE = 512
FINE_SIZE = 1024
_LIP_INSET = 0.12
_PHOTO_EYES_PX = 240.0
"""Larger photographs are scaled down to this distance of the pupils before they are sampled; at
1024 texels to twice as much."""


@dataclass(frozen=True)
class Raster:
    """Which triangle covers a pixel, drawn in order.

    covered: (h, w) bool; corners: (h, w, 3) vertices; weights: (h, w, 3), summing to 1.
    """

    covered: NDArray[np.bool_]
    corners: NDArray[np.int32]
    weights: NDArray[np.float32]


def rasterise(points: Array, triangles: NDArray[np.int32], size: tuple[int, int]) -> Raster:
    """points: (V, 2) pixels; triangles: (T, 3), later ones over earlier ones; size: (w, h)."""
    index = np.full(size[::-1], -1, np.int32)
    for number, corners in enumerate(triangles):
        outline = np.round(points[corners] * 16).astype(np.int32)
        cv2.fillConvexPoly(index, outline, number, lineType=8, shift=4)
    corners = triangles[index]
    a, b, c = (points[corners[..., k]] for k in range(3))
    ys, xs = np.mgrid[: size[1], : size[0]]
    p = np.stack([xs, ys], axis=-1).astype(float)
    area = _cross(b - a, c - a)
    area = np.where(np.abs(area) < 1e-9, 1e-9, area)
    second, third = _cross(p - a, c - a) / area, _cross(b - a, p - a) / area
    weights = np.stack([1 - second - third, second, third], axis=-1)
    return Raster(index >= 0, corners, weights.astype(np.float32))


@functools.cache
def texels(size: int = SIZE) -> Raster:
    """Every texel of the layout; the openings of eyes and mouth are covered as well."""
    mesh = load_mesh()
    triangles = np.concatenate([mesh.triangles, mesh.holes])
    return rasterise(mesh.uv.astype(float) * size - 0.5, triangles, (size, size))


def _cross(u: Array, v: Array) -> Array:
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def normalise(
    photo: NDArray[Any],
    landmarks: Array,
    eye_distance: float,
    size: int = SIZE,
    fit: Fit = "landmarks",
    vertices: Array | None = None,
    move: Callable[[Map], Map] | None = None,
) -> Image:
    """The photograph (h, w, 3) in the texture's layout: (size, size, 3), same colour order.

    landmarks: (468, 2) pixels; eye_distance: pixels between the pupils; vertices: (V, 2) pixels
    where the mesh lies in the photograph, instead of the automatic fit; move: what is done to the
    texels' places in the photograph (size, size, 2), such as bringing them into register.
    """
    shrink = shrunk(eye_distance, size)
    if shrink < 1:
        photo = cv2.resize(photo, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
        landmarks = (landmarks + 0.5) * shrink - 0.5
        vertices = None if vertices is None else (vertices + 0.5) * shrink - 0.5
    if vertices is None:
        by_hardy = fit == "hardy"
        vertices = hardy_fit(_inside_lips(landmarks)) if by_hardy else vertices_in_photo(landmarks)
    place = interpolated(vertices.astype(np.float32), size)
    if move is not None:
        place = move(place)
    sampled = cv2.remap(
        photo, place[..., 0], place[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE
    )
    return np.asarray(sampled, np.uint8)


def shrunk(eye_distance: float, size: int = SIZE) -> float:
    """At most 1: the scale at which a photograph has all that a texture of this size can use."""
    scale = _PHOTO_EYES_PX * size / SIZE / eye_distance
    return scale if scale < 1 - 1e-9 else 1.0


def interpolated(values: NDArray[np.float32], size: int = SIZE) -> NDArray[np.float32]:
    """(size, size, c) from values at the mesh's vertices (V, c)."""
    corners, weights = _columns(size, values.shape[1])
    total = np.take(values, corners[0], axis=0)
    total *= weights[0]
    for column in (1, 2):
        part = np.take(values, corners[column], axis=0)
        part *= weights[column]
        total += part
    return np.asarray(total.reshape(size, size, -1), np.float32)


@functools.cache
def _columns(size: int, channels: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """(3, size * size) vertices and (3, size * size, channels) weights, contiguous for speed."""
    where = texels(size)
    corners = np.ascontiguousarray(where.corners.reshape(-1, 3).T, np.intp)
    weights = np.ascontiguousarray(where.weights.reshape(-1, 3).T)
    return corners, np.repeat(weights[..., None], channels, axis=2)


def vertices_in_photo(landmarks: Array) -> Array:
    """(V, 2) pixels: the automatic fit of landmarks (468, 2).

    The landmarks themselves, and the rim by the affine map of the face's outline.
    """
    mesh = load_mesh()
    rest = mesh.rest
    outline = list(OVAL)
    known = np.column_stack([rest[outline], np.ones(len(outline))])
    affine = np.linalg.lstsq(known, landmarks[outline], rcond=None)[0]
    rim = np.column_stack([rest[list(RIM)], np.ones(len(RIM))]) @ affine
    return mesh.halfway(np.concatenate([even_lips(_inside_lips(landmarks)), rim]))


def _inside_lips(landmarks: Array) -> Array:
    """The inner outline drawn a little into the lip, so that no teeth come along with it."""
    outer, _, _, inner = np.array(LIP_COLUMNS).T
    moved = landmarks.copy()
    moved[inner] += (landmarks[outer] - landmarks[inner]) * _LIP_INSET
    return moved
