"""Textures in the GPU's memory: taken from a stock, filled a slice at a time, given back.

Making a texture and its smaller levels takes up to 10 ms (software GL, 1024 x 1024), most of a
frame; filling one that is there takes 0.1 ms for each 64 kB and can be spread over many frames.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import moderngl

from hypermask.stage.costume import Levels

SLICE_BYTES = 1 << 16
_MOST_SPARE = 2

Size = tuple[int, int]


class TextureStock:
    """RGBA textures with all their levels; one that was given back serves again."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._spare: dict[Size, list[moderngl.Texture]] = defaultdict(list)

    def reserve(self, size: Size) -> None:
        """Have one spare texture (width, height) at hand. Not within a frame's time."""
        if not self._spare[size]:
            self._spare[size].append(self._make(size))

    def take(self, size: Size) -> moderngl.Texture:
        """Not within a frame's time, unless one is spare."""
        spare = self._spare[size]
        return spare.pop() if spare else self._make(size)

    def give_back(self, texture: moderngl.Texture) -> None:
        spare = self._spare[texture.size]
        if len(spare) < _MOST_SPARE:
            spare.append(texture)
        else:
            texture.release()

    def release(self) -> None:
        for spare in self._spare.values():
            for texture in spare:
                texture.release()
        self._spare.clear()

    def _make(self, size: Size) -> moderngl.Texture:
        texture = self._context.texture(size, 4)
        texture.build_mipmaps()
        texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return texture


def fill(texture: moderngl.Texture, levels: Levels) -> Iterator[None]:
    """Copies about `SLICE_BYTES` at each step, in the last one all of the small levels."""
    for number, level in enumerate(levels):
        height, width = level.shape[:2]
        rows = max(SLICE_BYTES // (4 * width), 1)
        for first in range(0, height, rows):
            part = level[first : first + rows]
            texture.write(part.tobytes(), (0, first, width, len(part)), level=number)
            if rows < height or level.size > SLICE_BYTES // 4:
                yield
    yield
