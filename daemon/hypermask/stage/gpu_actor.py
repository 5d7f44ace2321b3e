"""An actor's meshes and textures in the GPU's memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.stage.layers import Actor, MeshLayer, Positions
from hypermask.stage.settings import StageSettings

TEXTURE_GAMMA = 2.2

_LIGHT = np.array([0.2, 0.5, 0.84])  # from the upper right of the audience, on shaded layers
_AMBIENT = 0.35


@dataclass(frozen=True)
class _GpuLayer:
    texture: moderngl.Texture
    vertex_array: moderngl.VertexArray
    first_index: int
    index_count: int
    vertices: slice
    normals: _VertexNormals | None


class GpuActor:
    """All layers' vertices stream through one buffer, written once a frame.

    opaque, transparent: the programs for textures without and with see-through parts.
    """

    def __init__(
        self,
        context: moderngl.Context,
        actor: Actor,
        programs: tuple[moderngl.Program, moderngl.Program],
        settings: StageSettings,
    ) -> None:
        counts = [len(layer.uv) for layer in actor.layers]
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
        self._staging = np.ones((int(starts[-1]), 4), np.float32)
        self._stream = context.buffer(reserve=self._staging.nbytes, dynamic=True)
        self._uv = context.buffer(
            np.concatenate([layer.uv for layer in actor.layers]).astype(np.float32).tobytes()
        )
        triangles = [
            layer.triangles + start for layer, start in zip(actor.layers, starts, strict=False)
        ]
        self._indices = context.buffer(np.concatenate(triangles).astype(np.uint32).tobytes())
        arrays = [self._vertex_array(context, program) for program in programs]
        self._arrays = arrays
        self._layers: list[_GpuLayer] = []
        first = 0
        for layer, start in zip(actor.layers, starts, strict=False):
            see_through = bool(layer.texture[..., 3].min() < 255)
            self._layers.append(
                _GpuLayer(
                    _upload(context, layer.texture, settings.projector_gamma),
                    arrays[int(see_through)],
                    first,
                    layer.triangles.size,
                    slice(int(start), int(start) + len(layer.uv)),
                    _VertexNormals(layer.triangles, len(layer.uv)) if layer.shaded else None,
                )
            )
            first += layer.triangles.size
        self.mean_light = float(
            np.average(
                [mean_light(layer) for layer in actor.layers],
                weights=[len(layer.triangles) for layer in actor.layers],
            )
        )

    def _vertex_array(
        self, context: moderngl.Context, program: moderngl.Program
    ) -> moderngl.VertexArray:
        content = [(self._stream, "4f", "in_vertex"), (self._uv, "2f", "in_uv")]
        return context.vertex_array(program, content, index_buffer=self._indices)

    def check(self, key: str, positions: Sequence[Positions]) -> None:
        """Raises `DataError` STAGE-MESH unless there are positions (V, 3) for each layer."""
        wanted = [(part.vertices.stop - part.vertices.start, 3) for part in self._layers]
        given = [part.shape for part in positions]
        if wanted != given:
            raise DataError(
                "STAGE-MESH",
                f"the actor '{key}' has vertices {wanted}, but {given} came to be drawn",
                "Load the actor again after a change of its mesh.",
            )

    def stream(self, positions: Sequence[Positions]) -> None:
        """Send this frame's positions, one finite (V, 3) array a layer."""
        for layer, part in zip(self._layers, positions, strict=True):
            self._staging[layer.vertices, :3] = part
            if layer.normals is not None:
                self._staging[layer.vertices, 3] = layer.normals.shade(part)
        self._stream.orphan()
        self._stream.write(self._staging)

    def render(self) -> None:
        for layer in self._layers:
            layer.texture.use(0)
            layer.vertex_array.render(
                moderngl.TRIANGLES, vertices=layer.index_count, first=layer.first_index
            )

    def release(self) -> None:
        for layer in self._layers:
            layer.texture.release()
        for array in self._arrays:
            array.release()
        for buffer in (self._stream, self._uv, self._indices):
            buffer.release()


class _VertexNormals:
    """Gouraud shading: light by the mean direction of the triangles around each vertex."""

    def __init__(self, triangles: NDArray[np.int32], vertex_count: int) -> None:
        self._triangles = triangles
        corner_vertices = triangles.ravel()
        order = np.argsort(corner_vertices, kind="stable")
        self._corners = order // 3
        self._used, self._starts = np.unique(corner_vertices[order], return_index=True)
        self._count = vertex_count

    def shade(self, positions: Positions) -> NDArray[np.float32]:
        """(V,) in 0..1. The mesh as a whole faces the audience, whatever its winding."""
        a, b, c = (positions[self._triangles[:, corner]] for corner in range(3))
        of_triangles = np.cross(b - a, c - a)  # length: twice the area, so large ones count more
        if of_triangles[:, 2].sum() < 0:
            of_triangles = -of_triangles
        sums = np.add.reduceat(of_triangles[self._corners], self._starts, axis=0)
        lengths = np.maximum(np.sqrt(np.einsum("ij,ij->i", sums, sums)), 1e-20)
        lit = np.maximum(sums @ (_LIGHT / np.linalg.norm(_LIGHT)) / lengths, 0)
        shade = np.ones(self._count, np.float32)
        shade[self._used] = _AMBIENT + (1 - _AMBIENT) * lit
        return shade


def _upload(
    context: moderngl.Context, rgba: NDArray[np.uint8], projector_gamma: float
) -> moderngl.Texture:
    """Premultiplied, corrected for the projector's gamma, with mipmaps."""
    levels = np.arange(256) / 255
    curve = np.round(255 * levels ** (TEXTURE_GAMMA / projector_gamma))
    colour = curve[rgba[..., :3]]
    alpha = rgba[..., 3:]
    pixels = np.concatenate([np.round(colour * (alpha / 255)).astype(np.uint8), alpha], axis=2)
    height, width = pixels.shape[:2]
    texture = context.texture((width, height), 4, pixels.tobytes())
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    return texture


def mean_light(layer: MeshLayer) -> float:
    """Mean light, 0..1, of the part of a layer's texture that its triangles show."""
    size = 256
    small = cv2.resize(layer.texture, (size, size), interpolation=cv2.INTER_AREA) / 255.0
    light = (small[..., :3] ** TEXTURE_GAMMA).mean(axis=2) * small[..., 3]
    shown = np.zeros((size, size), np.uint8)
    corners = np.round(np.clip(layer.uv, 0, 1)[layer.triangles] * (size - 1)).astype(np.int32)
    for triangle in corners:
        cv2.fillConvexPoly(shown, triangle, (1,))
    return float(light[shown > 0].mean())
