"""The face as a body in space: the skin with a depth of its own, eyes, teeth, bag and tongue.

On the mask everything lies on the relief. A body has no relief under it, so here a vertex keeps the
depth it has at rest, comes forward or goes back as its units say, and slides back where it moves
over the edge of a cheek or under the chin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.face.border import inner_triangles
from hypermask.face.drive import Drive
from hypermask.face.face import Face, deform
from hypermask.face.gltf_shapes import Target
from hypermask.stage.layers import MeshLayer

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

_DEEPER_M = {"lower_teeth": 0.0045, "upper_teeth": 0.0025, "mouth": 0.006, "tongue": -0.002}
"""Behind the lips by so much more than on the mask, for lips also go back."""
_THROAT_M = 0.022
"""How much deeper the bag's middle lies."""


@dataclass(frozen=True)
class Part:
    """One layer: triangles (T, 3) anti-clockwise seen from +z, used: its vertices in the layer."""

    layer: MeshLayer
    triangles: Indices
    used: NDArray[np.intp]


class Solid:
    def __init__(self, face: Face) -> None:
        self.face = face
        rig, mask = face.rig, face.mask
        self._rest_height = mask.height(rig.mesh.rest[:, 0], rig.mesh.rest[:, 1])
        opened = face.positions(units={"27": 1.0, "19": 1.0})
        self.parts = tuple(
            _part(layer, _outward(self._triangles(layer), places))
            for layer, places in zip(face.actor.layers, opened, strict=True)
        )

    def places(self, drive: Drive | None = None) -> tuple[Array, ...]:
        """(V, 3) metres of each part's vertices."""
        asked = drive or Drive()
        layers = self.face.positions(units=asked.units, mouth=asked.mouth, gaze=asked.gaze)
        return tuple(
            self._with_depth(part.layer.name, places.astype(float), asked)[part.used]
            for part, places in zip(self.parts, layers, strict=True)
        )

    def offsets(self, target: Target, rest: tuple[Array, ...]) -> tuple[Array, ...]:
        """(V, 3) metres by which a blendshape moves each part from `rest`."""
        moved = self.places(target.drive)
        offsets = [places - start for places, start in zip(moved, rest, strict=True)]
        if target.eye:
            for offset, start in zip(offsets, rest, strict=True):
                offset[start[:, 0] * target.eye < 0] = 0
        return tuple(offsets)

    def _triangles(self, layer: MeshLayer) -> Indices:
        return inner_triangles(self.face.rig.mesh) if layer.name == "skin" else layer.triangles

    def _with_depth(self, name: str, places: Array, asked: Drive) -> Array:
        if name == "skin":
            _, out = deform(self.face.rig, mouth=asked.mouth, units=asked.units, gaze=asked.gaze)
            back = np.minimum(places[:, 2] - self._rest_height, 0)
            places[:, 2] = self._rest_height + back + out
        else:
            places[:, 2] -= _DEEPER_M.get(name, 0.0)
        if name == "mouth":
            places[-1, 2] -= _THROAT_M
        return places


def _part(layer: MeshLayer, triangles: Indices) -> Part:
    used, renumbered = np.unique(triangles, return_inverse=True)
    return Part(layer, renumbered.reshape(-1, 3).astype(np.int32), used.astype(np.intp))


def _outward(triangles: Indices, places: NDArray[np.float32]) -> Indices:
    """All turned anti-clockwise; what has no area is left as it is."""
    a, b, c = (places[triangles[:, k], :2].astype(float) for k in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    turned = triangles.copy()
    turned[turn < 0] = turned[turn < 0][:, ::-1]
    return turned


def normals(places: Array, triangles: Indices) -> Array:
    """(V, 3) unit normals, each the mean of its triangles' by area; +z where there is none."""
    a, b, c = (places[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    sums = np.zeros_like(places)
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], faces)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(length > 1e-14, sums / np.maximum(length, 1e-14), (0.0, 0.0, 1.0))
