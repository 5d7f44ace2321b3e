"""The one mesh of all characters: its rest shape on the mask, its triangles, its texture layout.

468 landmarks, a rim of twelve points outside the mask's outline, and points half-way between two
landmarks where the brows need more than the landmarks give; the eyes and the mouth are open. On the
cheeks, the forehead and the nose some landmarks are no triangle's corner: they ride on the triangle
they lie in. `mesh.json` is made by `hypermask.face.template` from landmark statistics.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask.face.points import LIP_COLUMNS

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

LANDMARKS = 468
RIM = range(468, 480)
"""The vertices outside the mask's outline; the added ones come after them."""
HALF_WIDTH_M = 0.102
HALF_HEIGHT_M = 0.140
_STRETCH = 0.3
"""The texture covers the rectangle |x| <= HALF_WIDTH_M, |y| <= HALF_HEIGHT_M of the mask."""


@dataclass(frozen=True)
class Mesh:
    """rest: (V, 2) metres on the mask; triangles: (T, 3); holes: (46 or so, 3) triangles that
    fill the eyes and the mouth, for the texture only; mirror: (V,) the point on the other side;
    between: (V - 480, 2) the two landmarks that each of the last vertices lies half-way between.
    """

    rest: Array
    triangles: Indices
    holes: Indices
    mirror: Indices
    between: Indices

    @property
    def uv(self) -> NDArray[np.float32]:
        """(V, 2) texture coordinates, v down: the texture is the mask seen from the front."""
        return to_uv(self.rest)

    @functools.cached_property
    def riders(self) -> tuple[Indices, Indices, Array]:
        """(n,) landmarks that are no triangle's corner, (n, 3) the corners of the triangle that
        each lies in at rest, (n, 3) their shares of it.
        """
        loose = np.setdiff1d(np.arange(self.count), self.triangles)
        return loose.astype(np.int32), *_lying_in(self.rest, self.triangles, loose)

    def halfway(self, values: NDArray[Any]) -> Array:
        """(V, ...) from values (480, ...) at the landmarks and the rim."""
        return np.concatenate([values, values[self.between].mean(axis=1)])

    def among(self, landmarks: Sequence[int]) -> tuple[int, ...]:
        """The added vertices of which both neighbours are among these landmarks."""
        inside = np.isin(self.between, list(landmarks)).all(axis=1)
        return tuple((RIM.stop + np.flatnonzero(inside)).tolist())

    @property
    def count(self) -> int:
        return len(self.rest)


def to_uv(points: Array) -> NDArray[np.float32]:
    """Texture coordinates (n, 2) of points (n, 2) in metres on the mask."""
    u = (points[:, 0] + HALF_WIDTH_M) / (2 * HALF_WIDTH_M)
    v = (HALF_HEIGHT_M - points[:, 1]) / (2 * HALF_HEIGHT_M)
    return np.stack([u, v], axis=1).astype(np.float32)


def even_lips(points: Array) -> Array:
    """The 468 landmarks (468, 2) with the two rows inside each lip evenly between its outlines.

    On closed lips the landmark model lays these rows over each other.
    """
    even = points.copy()
    outer, upper, lower, inner = np.array(LIP_COLUMNS).T
    even[upper] = points[outer] + (points[inner] - points[outer]) * 0.4
    even[lower] = points[outer] + (points[inner] - points[outer]) * 0.75
    return even


@functools.cache
def load_mesh() -> Mesh:
    data: dict[str, Any] = json.loads(Path(__file__).with_name("mesh.json").read_text("utf-8"))
    return Mesh(
        np.array(data["rest_mm"], float) / 1000,
        np.array(data["triangles"], np.int32),
        np.array(data["holes"], np.int32),
        np.array(data["mirror"], np.int32),
        np.array(data["between"], np.int32),
    )


def save_mesh(mesh: Mesh, path: Path) -> None:
    data = {
        "version": 2,
        "unit": "mm on the mask, x to the audience's right, y up",
        "rest_mm": np.round(mesh.rest * 1000, 2).tolist(),
        "triangles": mesh.triangles.tolist(),
        "holes": mesh.holes.tolist(),
        "mirror": mesh.mirror.tolist(),
        "between": mesh.between.tolist(),
    }
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in data.items()]
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")


def signed_areas(points: NDArray[Any], triangles: Indices) -> Array:
    """(T,) areas of triangles in the plane, positive anti-clockwise."""
    a, b, c = (points[triangles[:, corner], :2].astype(float) for corner in range(3))
    cross = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return np.asarray(cross / 2)


def _lying_in(points: Array, triangles: Indices, which: NDArray[np.intp]) -> tuple[Indices, Array]:
    """(n, 3) corners and (n, 3) barycentric shares of the triangle that holds each point."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    system = np.stack([b - a, c - a], axis=2)
    offset = points[which][:, None] - a
    second, third = np.moveaxis(np.linalg.solve(system, offset[..., None])[..., 0], 2, 0)
    shares = np.stack([1 - second - third, second, third], axis=2)
    holder = shares.min(axis=2).argmax(axis=1)
    return triangles[holder], shares[np.arange(len(which)), holder]


def influence(mesh: Mesh, moved: Sequence[int], still: Sequence[int]) -> Array:
    """(V, len(moved)) weights that carry displacements of some vertices over the mesh.

    The field is the smoothest one (least sum of squared Laplacians, with a share of stretching
    energy that keeps it from overshooting) that is exact at `moved` and zero at `still`. It follows
    the mesh, so the upper lip does not pull at the lower one across the open mouth.
    """
    laplacian = _laplacian()
    energy = laplacian @ laplacian + _STRETCH * laplacian
    driving = np.array(moved, np.intp)
    loose, corners, shares = mesh.riders
    free = np.setdiff1d(np.arange(mesh.count), np.array([*moved, *still, *loose]))
    weights = np.zeros((mesh.count, len(moved)))
    weights[driving, np.arange(len(moved))] = 1
    driven = energy[free][:, driving]
    weights[free] = np.linalg.solve(energy[free][:, free], -driven)
    weights[loose] = np.einsum("nk,nkm->nm", shares, weights[corners])
    return weights


@functools.cache
def _laplacian() -> Array:
    mesh = load_mesh()
    weights = np.zeros((mesh.count, mesh.count))
    for a, b in ((0, 1), (1, 2), (2, 0)):
        i, j = mesh.triangles[:, a], mesh.triangles[:, b]
        length = np.linalg.norm(mesh.rest[i] - mesh.rest[j], axis=1)
        weights[i, j] = weights[j, i] = 1 / np.maximum(length, 1e-3)
    weights /= weights[weights > 0].mean()
    return np.asarray(np.diag(weights.sum(axis=1)) - weights)
