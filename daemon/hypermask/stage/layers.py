"""What an actor on the stage is made of: textured triangle meshes, drawn one after another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError

if TYPE_CHECKING:
    from hypermask.mask import Mask

Positions = NDArray[np.float32]


@dataclass(frozen=True)
class MeshLayer:
    """A mesh with its texture; the positions of its vertices come with each frame.

    triangles: (T, 3) int32; uv: (V, 2) float32 in 0..1, v down, v = 0 is the top edge of texture
    row 0; texture: (H, W, 4) uint8 RGBA, straight alpha; shaded: smooth (Gouraud) shading by the
    surface's direction, for parts whose texture holds no light and shade of its own.
    Raises `DataError` STAGE-MESH when the arrays do not fit together.
    """

    name: str
    triangles: NDArray[np.int32]
    uv: NDArray[np.float32]
    texture: NDArray[np.uint8]
    shaded: bool = False

    def __post_init__(self) -> None:
        triangles, uv, texture = self.triangles, self.uv, self.texture
        if triangles.ndim != 2 or triangles.shape[1] != 3 or not len(triangles):
            raise _bad_mesh(self.name, f"its triangles have the shape {triangles.shape}")
        if uv.ndim != 2 or uv.shape[1] != 2 or not np.isfinite(uv).all():
            raise _bad_mesh(self.name, "its texture coordinates are not finite (V, 2) numbers")
        if triangles.min() < 0 or triangles.max() >= len(uv):
            raise _bad_mesh(self.name, "its triangles name vertices that do not exist")
        if texture.dtype != np.uint8 or texture.ndim != 3 or texture.shape[2] != 4:
            raise _bad_mesh(self.name, "its texture is not RGBA with 8 bits")


@dataclass(frozen=True)
class Actor:
    """Layers in the order in which they are drawn; nearer ones hide others by depth as well."""

    layers: tuple[MeshLayer, ...]


def dots_actor(
    mask: Mask, texture: NDArray[np.uint8], spacing_m: float = 0.004
) -> tuple[Actor, tuple[Positions, ...]]:
    """The mask's own relief as an actor, with a texture that covers the relief's rectangle.

    texture: (H, W, 3 or 4) uint8 RGB(A) over u = (x + hw) / (2 hw), v = (hh - y) / (2 hh) with
    (hw, hh) = `mask.half_size_m`. Returns the actor and its positions.
    """
    positions, triangles = relief_mesh(mask, spacing_m)
    half_width, half_height = mask.half_size_m
    u = (positions[:, 0] + half_width) / (2 * half_width)
    v = (half_height - positions[:, 1]) / (2 * half_height)
    uv = np.column_stack([u, v]).astype(np.float32)
    layer = MeshLayer("relief", triangles, uv, opaque(texture))
    return Actor((layer,)), (positions,)


def relief_mesh(mask: Mask, spacing_m: float) -> tuple[Positions, NDArray[np.int32]]:
    """A regular grid over the relief, cells wholly outside the outline left out.

    Returns positions (V, 3) float32 metres and triangles (T, 3) int32.
    """
    half_width, half_height = mask.half_size_m
    columns = int(np.ceil(2 * half_width / spacing_m)) + 1
    rows = int(np.ceil(2 * half_height / spacing_m)) + 1
    x, y = np.meshgrid(
        np.linspace(-half_width, half_width, columns), np.linspace(half_height, -half_height, rows)
    )
    index = np.arange(rows * columns).reshape(rows, columns)
    corners = [index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]]
    cells = np.stack(corners, axis=-1).reshape(-1, 4)
    inside = mask.inside(x, y).ravel()
    cells = cells[inside[cells].any(axis=1)]
    triangles = np.concatenate([cells[:, [0, 3, 1]], cells[:, [1, 3, 2]]])
    used, triangles = np.unique(triangles, return_inverse=True)
    xs, ys = x.ravel()[used], y.ravel()[used]
    positions = np.column_stack([xs, ys, mask.height(xs, ys)]).astype(np.float32)
    return positions, triangles.reshape(-1, 3).astype(np.int32)


def opaque(texture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """RGB or RGBA (H, W, 3 or 4) as RGBA, alpha 255 where there was none."""
    if texture.ndim == 3 and texture.shape[2] == 3:
        alpha = np.full((*texture.shape[:2], 1), 255, np.uint8)
        return np.concatenate([texture, alpha], axis=2)
    return texture


def _bad_mesh(name: str, why: str) -> DataError:
    return DataError("STAGE-MESH", f"the layer '{name}' cannot be drawn: {why}", "Make it again.")
