"""The reference mesh fitted to a photograph by radial basis functions (PAPERS B1, B2).

84 of the 468 landmarks, placed like the paper's: outline, brows, eyes, nose, lips. From them
Hardy's multiquadric gives every other vertex's place in the photograph, x and y separately.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from hypermask.face import points
from hypermask.face.mesh import load_mesh

Array = NDArray[np.float64]

PAPER_LANDMARKS = (
    *points.OVAL[::2],
    *(70, 63, 105, 66, 107, 55, 52, 46),
    *(300, 293, 334, 296, 336, 285, 282, 276),
    *points.LEFT_EYE[::2],
    *points.RIGHT_EYE[::2],
    *(168, 197, 5, 4, 2, 98, 327, 129, 358, 64, 294, 48, 278, 6),
    *(61, 40, 37, 0, 267, 270, 291, 321, 314, 17, 84, 91),
    *(78, 81, 13, 311, 308, 402, 14, 178),
)
"""The 84: outline 18, brows 16, eyes 16, nose 14, outer lips 12, inner lips 8."""


def stiffness(centres: Array) -> Array:
    """(n,) s_j: the distance of each centre (n, 2) from its nearest neighbour."""
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    np.fill_diagonal(gaps, np.inf)
    return np.asarray(gaps.min(axis=1))


def multiquadric(places: Array, centres: Array) -> Array:
    """(m, n) phi = sqrt(|x - x_j|^2 + s_j^2) of places (m, 2) and centres (n, 2)."""
    squares = np.square(places[:, None] - centres[None]).sum(axis=2)
    return np.asarray(np.sqrt(squares + stiffness(centres) ** 2))


@functools.cache
def _weights() -> Array:
    """(V, 84): what each landmark in the photograph gives to each vertex of the mesh.

    The centres are the mesh's, the same for every photograph, so the system is solved once.
    """
    rest = load_mesh().rest
    centres = rest[list(PAPER_LANDMARKS)]
    system = multiquadric(centres, centres)
    return np.asarray(np.linalg.solve(system.T, multiquadric(rest, centres).T).T)


def hardy_fit(landmarks: Array) -> Array:
    """(V, 2) pixels: every vertex of the mesh in the photograph, from landmarks (468, 2).

    f(x) = sum_j w_j phi(x - x_j) with f(x_j) = the 84 landmarks, for x and for y.
    """
    return np.asarray(_weights() @ landmarks[list(PAPER_LANDMARKS)])
