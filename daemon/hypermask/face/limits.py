"""What keeps a sum of action units from tearing the face: two limits, both without a jump.

Single units, the emotions and their mixtures with speech lie inside both and are not touched;
only sums of many units that pull the same way are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.face.mesh import Mesh

Array = NDArray[np.float64]

_BEYOND = 1.3
"""A point's reach is this much more than the farthest that one unit takes it."""
_UNTOUCHED, _SOFT = 0.8, 0.3
_TIGHT_M, _AROUND_M = 0.008, (0.015, 0.03)
"""What lies so near to a torn triangle goes back with it; farther out ever less does."""
_LEAST_AREA = 0.03
"""No triangle gets smaller than this share of its area at rest."""


def reaches(moves: Array) -> Array:
    """(48,) metres: how far each feature point may go; moves: (88, 48, 3) of the single units."""
    both = np.abs(moves).reshape(-1, 2, *moves.shape[1:]).sum(axis=1)
    return np.asarray(_BEYOND * np.hypot(both[..., 0], both[..., 1]).max(axis=0) + 1e-9)


def hold(displacement: Array, reach: Array) -> Array:
    """(48, 3): displacements up to 0.8 of the reach as they are, longer ones ever less so."""
    far = np.sqrt(displacement[:, 0] ** 2 + displacement[:, 1] ** 2) / reach
    if far.max() <= _UNTOUCHED:
        return displacement
    over = np.maximum(far - _UNTOUCHED, 0)
    held = np.minimum(far, _UNTOUCHED) + _SOFT * np.tanh(over / _SOFT)
    return np.asarray(displacement * (held / np.maximum(far, 1e-12))[:, None])


@dataclass(frozen=True)
class Guard:
    """Keeps triangles from being turned over.

    rest: (V, 2) metres; corners: 3 times (T,); areas: (T,) twice the areas at rest; edges: x, y of
    both edges from each triangle's first corner at rest.
    """

    rest: Array
    corners: tuple[NDArray[np.intp], ...]
    areas: Array
    edges: tuple[Array, ...]

    def untangle(self, flat: Array) -> float:
        """Bring flat (V, 2), in place, so far back towards rest that no triangle is turned over.

        First only what is near, then wider around, and if that did not do the whole face, which
        always does. Gives the least share of its way that any vertex has kept.
        """
        kept = 1.0
        for around in (*_AROUND_M, None):
            bad, scales = self._first_turns(flat)
            if not len(bad):
                return kept
            kept *= float(scales.min())
            share = scales.min() if around is None else self._share(bad, scales, around)[:, None]
            flat -= (1 - share) * (flat - self.rest)
        return kept

    def _first_turns(self, flat: Array) -> tuple[NDArray[np.intp], Array]:
        """The triangles below their least area, and where on their way they fall below it.

        Twice a triangle's area is a0 + a1 s + a2 s^2 along the straight way from rest (s = 0) to
        `flat` (s = 1).
        """
        a1, a2 = self._growth(flat - self.rest)
        least = self.areas * (1 - _LEAST_AREA)
        bad = np.flatnonzero(least + a1 + a2 < -1e-9 * self.areas)
        b, c, a = a1[bad], least[bad], a2[bad]
        root = np.sqrt(np.maximum(b * b - 4 * a * c, 0))
        return bad, np.asarray(2 * c / np.maximum(root - b, 1e-30))

    def _share(self, bad: NDArray[np.intp], scales: Array, around: float) -> Array:
        """(V,) how much of its way each vertex keeps: bad triangles hold back what is near them."""
        middles = sum(self.rest[corner[bad]] for corner in self.corners) / 3
        far = np.linalg.norm(self.rest[:, None] - middles, axis=2)
        near = np.exp(-((np.maximum(far - _TIGHT_M, 0) / around) ** 2))
        return np.asarray(1 - (near * (1 - scales)).max(axis=1))

    def _growth(self, moved: Array) -> tuple[Array, Array]:
        a, b, c = self.corners
        x, y = np.ascontiguousarray(moved[:, 0]), np.ascontiguousarray(moved[:, 1])
        xa, ya = x[a], y[a]
        ux, uy, vx, vy = x[b] - xa, y[b] - ya, x[c] - xa, y[c] - ya
        rux, ruy, rvx, rvy = self.edges
        return rux * vy + ux * rvy - ruy * vx - uy * rvx, ux * vy - uy * vx


def make_guard(mesh: Mesh) -> Guard:
    a, b, c = (mesh.triangles[:, k].astype(np.intp) for k in range(3))
    u, v = mesh.rest[b] - mesh.rest[a], mesh.rest[c] - mesh.rest[a]
    areas = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    return Guard(mesh.rest, (a, b, c), areas, (u[:, 0], u[:, 1], v[:, 0], v[:, 1]))
