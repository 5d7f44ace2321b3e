"""Textures in the GPU's memory: taken from a stock, filled a slice at a time, given back.

Making a texture takes up to 10 ms (software GL, 1024 x 1024), most of a frame; filling one that is
there takes 0.1 ms for each 64 kB and can be spread over many frames.

The smaller levels come from the costume, so the GPU need not make them: moderngl knows no other
way to allocate them than to let it, which takes software GL 90 ms the first time. So they are
allocated and filled by OpenGL ES itself, wherever its library can be loaded.
"""

from __future__ import annotations

import ctypes
import functools
from collections import defaultdict
from collections.abc import Iterator

import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask.stage.costume import Levels

SLICE_BYTES = 1 << 16
_MOST_SPARE = 2
_TEXTURE_2D, _RGBA, _RGBA8, _UNSIGNED_BYTE = 0x0DE1, 0x1908, 0x8058, 0x1401

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
        if _gles() is None:
            texture.build_mipmaps()
        else:
            _allocate_levels(texture, size)
        texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return texture


@functools.cache
def _gles() -> ctypes.CDLL | None:
    try:
        return ctypes.CDLL("libGLESv2.so.2")
    except OSError:
        return None


def _allocate_levels(texture: moderngl.Texture, size: Size) -> None:
    gles = _gles()
    assert gles is not None
    texture.use(0)
    level, (width, height) = 0, size
    while max(width, height) > 1:
        level, width, height = level + 1, max(width // 2, 1), max(height // 2, 1)
        gles.glTexImage2D(_TEXTURE_2D, level, _RGBA8, width, height, 0, _RGBA, _UNSIGNED_BYTE, None)


def _write(texture: moderngl.Texture, part: NDArray[np.uint8], first: int, level: int) -> None:
    """Rows from `first` on of a level of a texture."""
    height, width = part.shape[:2]
    gles = _gles()
    if level == 0 or gles is None:
        texture.write(part.tobytes(), (0, first, width, height), level=level)
        return
    whole = np.ascontiguousarray(part)
    texture.use(0)
    gles.glTexSubImage2D(
        _TEXTURE_2D, level, 0, first, width, height, _RGBA, _UNSIGNED_BYTE,
        ctypes.c_void_p(whole.ctypes.data),
    )  # fmt: skip


def fill(texture: moderngl.Texture, levels: Levels) -> Iterator[None]:
    """Copies about `SLICE_BYTES` at each step, in the last one all of the small levels."""
    for number, level in enumerate(levels):
        height, width = level.shape[:2]
        rows = max(SLICE_BYTES // (4 * width), 1)
        for first in range(0, height, rows):
            part = level[first : first + rows]
            _write(texture, part, first, number)
            if rows < height or level.size > SLICE_BYTES // 4:
                yield
    yield
