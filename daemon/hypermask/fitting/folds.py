"""How far points may be dragged before a triangle of the photograph's mesh turns over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hypermask.face.mesh import Mesh, signed_areas

Array = NDArray[np.float64]

_LEAST_AREA = 0.01
"""No drag makes a triangle smaller than this share of its proper size."""
_THIN = 0.25
"""One that is thinner already keeps at least this share of what it has at the drag's begin."""
_TINY_PX = 1e-6
"""Twice an area in square pixels; well above what rounding takes away."""
_BACK = 1 - 1e-6
_ROUNDS = 50


def upright_areas(mesh: Mesh, places: Array) -> Array:
    """(T + holes,) areas in square pixels of all triangles, positive where they are not turned
    over; places: (V, 2) pixels, y down.
    """
    return -signed_areas(places, np.concatenate([mesh.triangles, mesh.holes]))


def free_share(mesh: Mesh, start: Array, way: Array) -> float:
    """0 to 1: how much of the way (V, 2) the vertices at `start` (V, 2) can go.

    Twice a triangle's area on the way is a0 + a1 s + a2 s^2. Triangles that are turned over at the
    start (the landmarks of a photograph can be so) hold nothing back.
    """
    triangles = np.concatenate([mesh.triangles, mesh.holes])
    moving: NDArray[np.bool_] = np.asarray(way.any(axis=1))
    touched = np.flatnonzero(moving[triangles].any(axis=1))
    a, b, c = (triangles[touched, k] for k in range(3))
    u, v = start[b] - start[a], start[c] - start[a]
    du, dv = way[b] - way[a], way[c] - way[a]
    a0, a1, a2 = -_cross(u, v), -(_cross(u, dv) + _cross(du, v)), -_cross(du, dv)
    least = np.minimum(_least(mesh, start)[touched], _THIN * a0)
    least = np.maximum(least, np.minimum(a0, _TINY_PX))
    judged = a0 > 0
    share = 1.0
    for _ in range(_ROUNDS):
        bad = judged & (a0 + a1 * share + a2 * share**2 < least)
        if not bad.any():
            return share
        share = min(share, float(_first(a0[bad] - least[bad], a1[bad], a2[bad]).min())) * _BACK
    return 0.0


def _least(mesh: Mesh, places: Array) -> Array:
    """(T + holes,) twice the least areas: the triangles at rest in the photograph's scale."""
    rest = -upright_areas(mesh, mesh.rest)
    seen = np.abs(signed_areas(places, mesh.triangles)).sum()
    scale = seen / rest[: len(mesh.triangles)].sum()
    least = 2 * _LEAST_AREA * scale * np.abs(rest)
    least[len(mesh.triangles) :] = 0  # eyes and mouth may all but shut
    return np.asarray(least)


def _first(c: Array, b: Array, a: Array) -> Array:
    """The first s > 0 at which c + b s + a s^2 is 0, c > 0."""
    root = np.sqrt(np.maximum(b * b - 4 * a * c, 0))
    return np.asarray(2 * c / np.maximum(root - b, 1e-30))


def _cross(u: Array, v: Array) -> Array:
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
