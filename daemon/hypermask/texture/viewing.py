"""How squarely the camera saw each part of the face: what is seen edge on is not believed."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.mesh import LANDMARKS, RIM, load_mesh
from hypermask.texture import regions
from hypermask.texture.normalise import SIZE, interpolated

Map = NDArray[np.float32]
Array = NDArray[np.float64]

_COARSE = 64
_COSINE = (0.15, 0.45)


def cosines(landmarks: Array) -> Array:
    """(468,) cosine of the angle between skin and camera, 1 is square on, below 0 turned away.

    landmarks: (468, 3) pixels, z in the same unit, smaller is nearer.
    """
    mesh = load_mesh()
    places = mesh.halfway(np.concatenate([landmarks, np.zeros((len(RIM), 3))]))
    triangles = mesh.triangles[~np.isin(mesh.triangles, RIM).any(axis=1)]
    a, b, c = (places[triangles[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)  # y is down: these point to -z, to the camera
    sums = np.zeros_like(places)
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], normals)
    loose, corners, shares = mesh.riders
    sums[loose] = np.einsum("nk,nkd->nd", shares, sums[corners])
    sums = sums[:LANDMARKS]
    return np.asarray(-sums[:, 2] / np.maximum(np.linalg.norm(sums, axis=1), 1e-9))


def viewing(landmarks: Array) -> Map:
    """(SIZE, SIZE) 0 to 1: 0 where the skin is seen edge on or from behind."""
    known = np.concatenate([cosines(landmarks), np.ones(len(RIM))])
    values = load_mesh().halfway(known).astype(np.float32)[:, None]
    coarse = cv2.GaussianBlur(interpolated(values, _COARSE)[..., 0], (0, 0), 1.5)
    fine = cv2.resize(coarse, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR)
    return regions.ramp(np.asarray(fine, np.float32), *_COSINE)
