"""An actor in the GPU's memory: meshes that characters may share, and the textures of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.stage.costume import Costume
from hypermask.stage.layers import Actor, Positions
from hypermask.stage.textures import TextureStock, fill

_LIGHT = np.array([0.2, 0.5, 0.84])  # from the upper right of the audience, on shaded layers
_AMBIENT = 0.35
SINGLE = 2
"""So many of the programs draw one actor; as many more draw two."""


@dataclass(frozen=True)
class _Part:
    """Where a layer lies in the buffers."""

    first_index: int
    index_count: int
    vertices: slice
    normals: _VertexNormals | None


class GpuMesh:
    """All layers' vertices stream through one buffer, written once a frame.

    programs: for textures without and with see-through parts, and the same for two actors at once.
    """

    def __init__(
        self,
        context: moderngl.Context,
        actor: Actor,
        programs: Sequence[moderngl.Program],
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
        self._context = context
        self.arrays: list[moderngl.VertexArray] = []
        self.serve(programs)
        self.parts: list[_Part] = []
        self._users = 0
        first = 0
        for layer, start in zip(actor.layers, starts, strict=False):
            normals = _VertexNormals(layer.triangles, len(layer.uv)) if layer.shaded else None
            vertices = slice(int(start), int(start) + len(layer.uv))
            self.parts.append(_Part(first, layer.triangles.size, vertices, normals))
            first += layer.triangles.size

    def serve(self, programs: Sequence[moderngl.Program]) -> None:
        """Be ready to be drawn by these programs too."""
        content = [(self._stream, "4f", "in_vertex"), (self._uv, "2f", "in_uv")]
        for program in programs:
            array = self._context.vertex_array(program, content, index_buffer=self._indices)
            self.arrays.append(array)

    def check(self, key: str, positions: Sequence[Positions]) -> None:
        """Raises `DataError` STAGE-MESH unless there are positions (V, 3) for each layer."""
        wanted = [(part.vertices.stop - part.vertices.start, 3) for part in self.parts]
        given = [part.shape for part in positions]
        if wanted != given:
            raise DataError(
                "STAGE-MESH",
                f"the actor '{key}' has vertices {wanted}, but {given} came to be drawn",
                "Load the actor again after a change of its mesh.",
            )

    def stream(self, positions: Sequence[Positions]) -> None:
        """Send this frame's positions, one finite (V, 3) array a layer."""
        for part, places in zip(self.parts, positions, strict=True):
            self._staging[part.vertices, :3] = places
            if part.normals is not None:
                self._staging[part.vertices, 3] = part.normals.shade(places)
        self._stream.orphan()
        self._stream.write(self._staging)

    def taken(self) -> None:
        self._users += 1

    def left(self) -> None:
        """Freed when the last actor that has it leaves."""
        self._users -= 1
        if self._users:
            return
        for array in self.arrays:
            array.release()
        for buffer in (self._stream, self._uv, self._indices):
            buffer.release()


class GpuActor:
    """A mesh with a texture for each of its layers."""

    def __init__(
        self,
        mesh: GpuMesh,
        stock: TextureStock,
        costume: Costume,
        like: GpuActor | None = None,
    ) -> None:
        """like: an actor with the same mesh; it lends the textures that the costume lacks, and
        must outlive this one."""
        self.mesh = mesh
        self.mean_light = costume.mean_light
        self._stock, self._costume = stock, costume
        self._own = {
            number: stock.take((levels[0].shape[1], levels[0].shape[0]))
            for number, levels in costume.textures.items()
        }
        lent = {} if like is None else dict(enumerate(like._drawn))
        self._drawn: list[tuple[moderngl.Texture, bool]] = [
            (self._own[number], number in costume.see_through)
            if number in self._own
            else lent[number]
            for number in range(len(mesh.parts))
        ]
        mesh.taken()

    def fill(self) -> Iterator[None]:
        """Copies the costume into its textures, a slice at each step."""
        for number, texture in self._own.items():
            yield from fill(texture, self._costume.textures[number])
        self._costume = Costume({}, frozenset(), self.mean_light)

    def mixes_with(self, other: GpuActor) -> bool:
        """Whether `render` can draw both as one: they differ by opaque textures alone."""
        return self.mesh is other.mesh and all(
            mine[0] is his[0] or not (mine[1] or his[1])
            for mine, his in zip(self._drawn, other._drawn, strict=True)
        )

    def render(self, other: GpuActor | None = None) -> None:
        """other: an actor that `mixes_with` this one, to be drawn with it."""
        second = self if other is None else other
        arrays = self.mesh.arrays[:SINGLE] if other is None else self.mesh.arrays[SINGLE:]
        drawn = zip(self.mesh.parts, self._drawn, second._drawn, strict=True)
        for part, (texture, see_through), (second_texture, _) in drawn:
            texture.use(0)
            if other is not None:
                second_texture.use(1)
            arrays[int(see_through)].render(
                moderngl.TRIANGLES, vertices=part.index_count, first=part.first_index
            )

    def release(self) -> None:
        for texture in self._own.values():
            self._stock.give_back(texture)
        self.mesh.left()


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
