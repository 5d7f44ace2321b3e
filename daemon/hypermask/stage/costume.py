"""A character's textures made ready for the GPU, so that the stage only has to copy them.

A costume's file is one line of JSON, then every level of every texture one after another. It is
written by one process and mapped into memory by another on the same machine.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.stage.layers import MeshLayer

TEXTURE_GAMMA = 2.2
VERSION = 1
_SMALL = 256
_LIGHT = ((np.arange(256) / 255) ** TEXTURE_GAMMA).astype(np.float32)

Levels = tuple[NDArray[np.uint8], ...]
"""A texture (h, w, 4), alpha premultiplied, and its halves down to one pixel."""


@dataclass(frozen=True)
class Costume:
    """textures: by the layer's number; see_through: layers whose alpha is not 255 everywhere;
    mean_light: 0..1, of all of the actor's layers."""

    textures: dict[int, Levels]
    see_through: frozenset[int]
    mean_light: float


def make_costume(
    layers: Sequence[MeshLayer], projector_gamma: float, names: Sequence[str] | None = None
) -> Costume:
    """The textures of an actor's layers (of those in `names`, without it of all)."""
    lights = [
        mean_light(layer) if names is None or layer.name in names else _lasting_light(layer)
        for layer in layers
    ]
    light = np.average(lights, weights=[len(layer.triangles) for layer in layers])
    textures = {
        number: levels_of(layer.texture, projector_gamma)
        for number, layer in enumerate(layers)
        if names is None or layer.name in names
    }
    see_through = (n for n, levels in textures.items() if levels[0][..., 3].min() < 255)
    return Costume(textures, frozenset(see_through), float(light))


def levels_of(rgba: NDArray[np.uint8], projector_gamma: float) -> Levels:
    """(H, W, 4) straight alpha -> premultiplied, corrected for the projector's gamma, halved
    again and again as OpenGL ES wants mipmaps."""
    import cv2

    curve = np.round(255 * (np.arange(256) / 255) ** (TEXTURE_GAMMA / projector_gamma))
    alpha = rgba[..., 3:]
    colour = curve.astype(np.uint8)[rgba[..., :3]]
    if alpha.min() < 255:
        colour = np.round(colour * (alpha / 255)).astype(np.uint8)
    levels = [np.concatenate([colour, alpha], axis=2)]
    while max(levels[-1].shape[:2]) > 1:
        height, width = levels[-1].shape[:2]
        half = (max(width // 2, 1), max(height // 2, 1))
        levels.append(np.asarray(cv2.resize(levels[-1], half, interpolation=cv2.INTER_AREA)))
    return tuple(levels)


def mean_light(layer: MeshLayer) -> float:
    """Mean light, 0..1, of the part of a layer's texture that its triangles show."""
    import cv2

    size = (_SMALL, _SMALL)
    small = cv2.resize(layer.texture, size, interpolation=cv2.INTER_AREA)
    shown = _shown(layer.uv.tobytes(), layer.triangles.tobytes())
    texels = small[shown]
    light = _LIGHT[texels[:, :3]].mean(axis=1) * (texels[:, 3] / 255)
    return float(light.mean())


def _lasting_light(layer: MeshLayer) -> float:
    """`mean_light` of a layer that all characters share, worked out once."""
    found = _lasting.get(id(layer))
    if found is None or found[0] is not layer:
        found = _lasting[id(layer)] = (layer, mean_light(layer))
    return found[1]


_lasting: dict[int, tuple[MeshLayer, float]] = {}


@functools.lru_cache(maxsize=16)
def _shown(uv: bytes, triangles: bytes) -> NDArray[np.bool_]:
    """Which texels of a small texture the triangles cover."""
    import cv2

    covered = np.zeros((_SMALL, _SMALL), np.uint8)
    places = np.frombuffer(uv, np.float32).reshape(-1, 2)
    corners = places[np.frombuffer(triangles, np.int32).reshape(-1, 3)]
    for triangle in np.round(np.clip(corners, 0, 1) * (_SMALL - 1)).astype(np.int32):
        cv2.fillConvexPoly(covered, triangle, (1,))
    return covered > 0


def write_costume(costume: Costume, path: Path) -> None:
    """Raises `HypermaskError` DISK-WRITE."""
    from hypermask.storage import write_atomically

    sizes = [(number, *levels[0].shape[:2]) for number, levels in costume.textures.items()]
    head = {
        "costume": VERSION,
        "mean_light": costume.mean_light,
        "see_through": sorted(costume.see_through),
        "textures": sizes,
    }
    parts = [level.tobytes() for levels in costume.textures.values() for level in levels]
    write_atomically(path, b"".join([json.dumps(head).encode(), b"\n", *parts]))


def read_costume(path: Path) -> Costume:
    """Raises `DataError` COSTUME-READ for a file that is not whole."""
    try:
        with path.open("rb") as file:
            head = json.loads(file.readline(1 << 16))
            offset = file.tell()
        data: NDArray[np.uint8] = np.memmap(path, np.uint8, "r", offset=offset)
        if head["costume"] != VERSION:
            raise ValueError(f"its version is {head['costume']}")
        textures = {}
        for number, height, width in head["textures"]:
            textures[int(number)], data = _cut(data, int(height), int(width))
        return Costume(textures, frozenset(head["see_through"]), float(head["mean_light"]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(
            "COSTUME-READ", f"{path} is not a character's costume: {error}", "Build it again."
        ) from error


def _cut(data: NDArray[np.uint8], height: int, width: int) -> tuple[Levels, NDArray[np.uint8]]:
    """All levels of a texture from the front of `data`, and what follows them."""
    levels = []
    while True:
        size = height * width * 4
        if size > len(data):
            raise ValueError("it ends too soon")
        levels.append(data[:size].reshape(height, width, 4))
        data = data[size:]
        if max(height, width) == 1:
            return tuple(levels), data
        height, width = max(height // 2, 1), max(width // 2, 1)
