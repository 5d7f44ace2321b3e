"""The handles of the fitting tool in four levels, and what of the mesh follows each (PAPERS A3).

face       3: the eyes and the mouth; together they turn, stretch and move the whole face
parts      13: brows, eyes, nose, lips, corners of the mouth, chin, sides, forehead
features   48: the feature points of the action units
points     every vertex of the face that is a corner of a triangle, by its number

A handle's name is "level/part". All groups come from the names of the face's points and from the
mesh's own places, none from a number. Left and right are the photograph's.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.face import points
from hypermask.face.border import border
from hypermask.face.features import FEATURE_POINTS
from hypermask.face.mesh import Mesh, influence, load_mesh

Array = NDArray[np.float64]

LEVELS = ("face", "parts", "features", "points")
_REACH_MM = {"parts": (30.0, 60.0), "features": (18.0, 36.0)}
"""A group's pull is whole up to the first distance from it and over at the second."""
_CHIN_MM = 22.0
"""Half the width of the part of the outline that is the chin."""


@dataclass(frozen=True)
class Level:
    """handles: names; means: (H, V), a handle lies in the mean of its vertices; mirror: (H,) the
    handle on the other side; carrier: (V, H), what share of its movement every vertex takes.

    The level "face" has no carrier: its three handles are an affine map.
    """

    name: str
    handles: tuple[str, ...]
    means: Array
    mirror: NDArray[np.intp]
    carrier: Array | None

    @functools.cached_property
    def index(self) -> Mapping[str, int]:
        return {name: k for k, name in enumerate(self.handles)}


@functools.cache
def load_levels() -> Mapping[str, Level]:
    """All four levels of the one mesh, made once."""
    mesh = load_mesh()
    return {
        "face": _level(mesh, "face", _face_groups(), spread=False),
        "parts": _level(mesh, "parts", _part_groups(mesh)),
        "features": _level(mesh, "features", {n: (v,) for n, v in FEATURE_POINTS.items()}),
        "points": _points(mesh),
    }


def _level(
    mesh: Mesh, name: str, groups: Mapping[str, Sequence[int]], spread: bool = True
) -> Level:
    names = list(groups)
    means = np.zeros((len(names), mesh.count))
    for row, members in enumerate(groups.values()):
        means[row, list(members)] = 1 / len(members)
    mirror = np.array([names.index(_other_side(part)) for part in names], np.intp)
    carrier = _carrier(mesh, name, list(groups.values())) if spread else None
    return Level(name, tuple(f"{name}/{part}" for part in names), means, mirror, carrier)


def _other_side(part: str) -> str:
    for side, other in (("_left", "_right"), ("_right", "_left")):
        if part.endswith(side):
            return part.removesuffix(side) + other
    return part


def _carrier(mesh: Mesh, name: str, groups: Sequence[Sequence[int]]) -> Array:
    """(V, H): 1 at a group's own vertices, 0 at all others', smooth between, 0 far away."""
    moved = [vertex for group in groups for vertex in group]
    owner = np.zeros((len(moved), len(groups)))
    owner[np.arange(len(moved)), np.repeat(np.arange(len(groups)), [len(g) for g in groups])] = 1
    field = influence(mesh, moved, sorted(set(border(mesh).tolist()) - set(moved))) @ owner
    full, none = _REACH_MM[name]
    for column, group in enumerate(groups):
        gaps = np.linalg.norm(mesh.rest[:, None] - mesh.rest[list(group)], axis=2).min(axis=1)
        t = np.clip((none - gaps * 1000) / (none - full), 0, 1)
        field[:, column] *= t * t * (3 - 2 * t)
    return np.clip(field, 0, 1)


def _points(mesh: Mesh) -> Level:
    used = np.setdiff1d(np.unique(mesh.triangles), border(mesh))
    place = {vertex: k for k, vertex in enumerate(used.tolist())}
    partner = mesh.mirror[used].tolist()
    mirror = np.array([place.get(vertex, k) for k, vertex in enumerate(partner)], np.intp)
    chosen = np.eye(mesh.count)[used]
    return Level("points", tuple(f"points/{v}" for v in used), chosen, mirror, chosen.T.copy())


def point_vertices() -> NDArray[np.intp]:
    """(H,) the vertex of each handle of the level "points"."""
    return np.asarray(load_levels()["points"].means.argmax(axis=1))


def _face_groups() -> dict[str, Sequence[int]]:
    return {
        "eye_left": points.LEFT_EYE,
        "eye_right": points.RIGHT_EYE,
        "mouth": points.LIPS_OUTER,
    }


def _part_groups(mesh: Mesh) -> dict[str, Sequence[int]]:
    corners = [set(column) for column in points.LIP_COLUMNS]
    left, right = ({points.LIPS_OUTER[k]} for k in (0, len(points.UPPER_LIP_OUTER) - 1))
    groups: dict[str, Sequence[int]] = {
        "brow_left": points.LEFT_BROW,
        "brow_right": points.RIGHT_BROW,
        "eye_left": points.LEFT_EYE,
        "eye_right": points.RIGHT_EYE,
        "nose": _low(mesh, points.NOSE),
        "corner_left": sorted(next(c for c in corners if c & left)),
        "corner_right": sorted(next(c for c in corners if c & right)),
        "upper_lip": (*points.UPPER_LIP_OUTER[2:-2], *points.UPPER_LIP_INNER[2:-2]),
        "lower_lip": (*points.LOWER_LIP_OUTER[2:-2], *points.LOWER_LIP_INNER[2:-2]),
    }
    return groups | _outline_groups(mesh)


def _low(mesh: Mesh, line: Sequence[int]) -> list[int]:
    """The part of the nose below the eyes: its root goes with the eyes and the brows."""
    eyes = mesh.rest[[*points.LEFT_EYE, *points.RIGHT_EYE], 1].min()
    return [vertex for vertex in line if mesh.rest[vertex, 1] < eyes]


def _outline_groups(mesh: Mesh) -> dict[str, Sequence[int]]:
    """The outline in four: chin, forehead above the brows, and the sides at the eyes' to the
    mouth's height; what lies between follows smoothly.
    """
    x, y = mesh.rest[list(points.OVAL)].T
    brows = mesh.rest[[*points.LEFT_BROW, *points.RIGHT_BROW], 1].max()
    eyes = mesh.rest[[*points.LEFT_EYE, *points.RIGHT_EYE], 1].max()
    mouth = mesh.rest[list(points.LIPS_OUTER), 1].max()
    beside = (y < eyes) & (y > mouth)
    chosen = {
        "chin": (np.abs(x) * 1000 < _CHIN_MM) & (y < mouth),
        "side_left": beside & (x < 0),
        "side_right": beside & (x > 0),
        "forehead": y > (brows + y.max()) / 2,
    }
    oval = np.array(points.OVAL)
    return {name: oval[rows].tolist() for name, rows in chosen.items()}
