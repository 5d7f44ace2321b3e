"""How well the camera saw each part of the face: what is edge on or hidden is not believed."""

from __future__ import annotations

import functools
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.mesh import LANDMARKS, RIM, load_mesh
from hypermask.texture import regions
from hypermask.texture.normalise import SIZE, interpolated, rasterise

Map = NDArray[np.float32]
Array = NDArray[np.float64]

_COARSE = 64
_COSINE = (0.15, 0.45)
_DEPTH_SIDE = 160
_TURNED_COSINE = (0.22, 0.52)
_BEHIND = (0.006, 0.02)
"""Parts of the face's size; less is the roughness of the mesh."""


def cosines(landmarks: Array) -> Array:
    """(468,) cosine of the angle between skin and camera, 1 is square on, below 0 turned away.

    landmarks: (468, 3) pixels, z in the same unit, smaller is nearer.
    """
    mesh = load_mesh()
    places, triangles = _body(landmarks)
    a, b, c = (places[triangles[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)  # y is down: these point to -z, to the camera
    sums = np.zeros_like(places)
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], normals)
    loose, corners, shares = mesh.riders
    sums[loose] = np.einsum("nk,nkd->nd", shares, sums[corners])
    sums = sums[:LANDMARKS]
    return np.asarray(-sums[:, 2] / np.maximum(np.linalg.norm(sums, axis=1), 1e-9))


def behind(landmarks: Array) -> Array:
    """(468,) by how much of the face's size each landmark lies behind nearer skin; 0 where seen.

    The mesh is drawn into a small depth map from the farthest triangle to the nearest.
    """
    low = landmarks.min(axis=0)
    scale = (_DEPTH_SIDE - 9) / float((landmarks - low)[:, :2].max())
    points, triangles = _body((landmarks - low) * scale + (4, 4, 0))
    order = np.argsort(-points[triangles, 2].mean(axis=1))
    drawn = rasterise(points[:, :2], triangles[order], (_DEPTH_SIDE, _DEPTH_SIDE))
    depths = (points[drawn.corners, 2] * drawn.weights).sum(axis=-1)
    known = points[:LANDMARKS]
    x, y = np.round(known[:, :2]).astype(int).T
    nearest = np.where(drawn.covered, depths, np.inf)[y, x]
    return np.asarray(np.maximum(known[:, 2] - nearest, 0) / _DEPTH_SIDE)


def _body(landmarks: Array) -> tuple[Array, NDArray[np.int32]]:
    """(V, 3) places of all vertices, the rim's zero, and the triangles without the rim."""
    mesh = load_mesh()
    places = mesh.halfway(np.concatenate([landmarks, np.zeros((len(RIM), 3))]))
    return places, mesh.triangles[~np.isin(mesh.triangles, RIM).any(axis=1)]


def viewing(landmarks: Array, turned: bool = True) -> Map:
    """(SIZE, SIZE) 0 to 1: 0 where the skin is seen edge on, from behind or not at all.

    turned: whether the head is turned so far that its own parts may hide others.
    """
    return _viewing(np.ascontiguousarray(landmarks, float).tobytes(), turned)


@functools.lru_cache(maxsize=4)
def _viewing(data: bytes, turned: bool) -> Map:
    """Kept for the few photographs that are being worked on."""
    landmarks = np.frombuffer(data).reshape(-1, 3)
    square = regions.ramp(_spread(cosines(landmarks)), *(_TURNED_COSINE if turned else _COSINE))
    if not turned:
        return square
    clear = 1 - regions.ramp(behind(landmarks).astype(np.float32), *_BEHIND)
    return np.asarray(square * _spread(clear), np.float32)


def _spread(values: NDArray[Any]) -> Map:
    """(SIZE, SIZE) of values at the landmarks (468,), softly; 1 on the rim."""
    known = load_mesh().halfway(np.concatenate([values, np.ones(len(RIM))]))
    coarse = interpolated(known.astype(np.float32)[:, None], _COARSE)[..., 0]
    coarse = np.clip(coarse, 0, 1)  # beyond the mesh it is extrapolated
    soft = cv2.GaussianBlur(coarse, (0, 0), 1.5)
    return np.asarray(cv2.resize(soft, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR), np.float32)
