"""Which vertices of the mesh lie on the border of the texture's rectangle, outside the face."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hypermask.face.mesh import HALF_HEIGHT_M, HALF_WIDTH_M, Mesh

_NEAR_M = 5e-4


def border(mesh: Mesh) -> NDArray[np.intp]:
    """Vertices on the rectangle's edge: they carry the texture outwards, no face."""
    x, y = np.abs(mesh.rest).T
    return np.flatnonzero((x > HALF_WIDTH_M - _NEAR_M) | (y > HALF_HEIGHT_M - _NEAR_M))


def inner_triangles(mesh: Mesh) -> NDArray[np.int32]:
    """(T, 3) the skin's triangles without those that reach the border."""
    return mesh.triangles[~np.isin(mesh.triangles, border(mesh)).any(axis=1)]
