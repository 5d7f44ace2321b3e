"""Dots painted on the skin, and where they are found again in pictures of the face.

The landmark models see half a millimetre at best from the front, and no depth. A dot of paint at a
point of the face can be found in a rendered picture to a few hundredths of a millimetre, and in a
second picture from below its depth shows as a shift. Only the pictures are measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask.face.face import Face, deform
from hypermask.face.points import LIPS_OUTER
from hypermask.face.sheet import paint
from hypermask.stage.layers import MeshLayer

Array = NDArray[np.float64]
Body = NDArray[np.float64]
"""(V, 3) mm: the skin's vertices on the mask's relief, each out of it by the face's own depth."""

PIXELS_PER_MM = 6.0
PITCH_DEG = 40.0
_DOT_MM, _TEXTURE_MM, _TEXELS = 0.3, 2.0, 80
_WINDOW_MM = (15.0, 34.0)
"""Half the width and half the height of a picture, around where the point is at rest."""
_MOUTH_MM = (-57.0, 40.0, 30.0)
"""The picture of the mouth: the height of its middle, half its width, half its height."""


class Markers:
    """Paints dots on a face and finds them."""

    def __init__(self, face: Face) -> None:
        self._face = face
        self._mesh = face.rig.mesh
        self._skin = [layer.name for layer in face.actor.layers].index("skin")
        self._rest = self.body()

    def body(self, **asked: Any) -> Body:
        """The face as a body, not as light on the mask; asked: as of `Face.positions`."""
        skin = self._face.positions(**asked)[self._skin].astype(float)
        _, out = deform(self._face.rig, **asked)
        return np.asarray((skin + out[:, None] * (0, 0, 1)) * 1000)

    def find(self, vertices: Sequence[int], **asked: Any) -> Array:
        """(n, 3) mm: where the dots painted at these vertices are; NaN for one that is hidden."""
        body = self.body(**asked)
        return np.array([self._place(body, vertex) for vertex in vertices])

    def opening(self, **asked: Any) -> float:
        """How wide the mouth is open: its area over its greatest height, as a share of the distance
        between the corners' dots. It does not depend on how far apart the lips are.
        """
        body, (height, half_width, half_height) = self.body(**asked), _MOUTH_MM
        left, right = (self._ahead(body, LIPS_OUTER[k]) for k in (0, 10))
        triangles, count = self._mesh.triangles, self._mesh.count
        dark = np.zeros((1, 1, 4), np.uint8)
        dark[..., 3] = 255
        layer = MeshLayer("dark", triangles, np.zeros((count, 2), np.float32), dark)
        size = (round(2 * half_width * PIXELS_PER_MM), round(2 * half_height * PIXELS_PER_MM))
        picture = np.full((size[1], size[0], 3), 255, np.float32)
        paint(picture, layer, _to_pixels(body[:, :2], np.array([0.0, height]), size))
        heights = picture[..., 0].sum(axis=0)
        wide = heights.sum() / max(heights.max(), 1.0) / PIXELS_PER_MM
        return float(wide / (right[0] - left[0]))

    def _ahead(self, body: Body, vertex: int) -> Array:
        """(2,) mm: where a dot is seen from ahead."""
        layer = _dot(self._mesh.rest * 1000, self._mesh.triangles, vertex)
        return _centroid(layer, body, self._rest[vertex])

    def _place(self, body: Body, vertex: int) -> Array:
        """(3,) mm: x and y from ahead; the depth from its shift seen from below, or from above.

        Turned by p about the x axis a point comes to y cos p - z sin p.
        """
        layer, around = _dot(self._mesh.rest * 1000, self._mesh.triangles, vertex), self._rest
        x, y = _centroid(layer, body, around[vertex])
        for pitch in np.radians([PITCH_DEG, -PITCH_DEG]):
            turn = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)],
                             [0, np.sin(pitch), np.cos(pitch)]])  # fmt: skip
            _, turned = _centroid(layer, body @ turn.T, turn @ around[vertex])
            if np.isfinite(turned):
                break
        return np.array([x, y, (y * np.cos(pitch) - turned) / np.sin(pitch)])


def _dot(rest: Array, triangles: NDArray[np.int32], vertex: int) -> MeshLayer:
    """Dark skin with a bright dot at a vertex, on the triangles that meet there only.

    So a dot on the edge of one lip does not come off on the other.
    """
    line = ((np.arange(_TEXELS) + 0.5) / _TEXELS * 2 - 1) * _TEXTURE_MM
    x, y = np.meshgrid(line, line)
    bright = np.exp(-(x**2 + y**2) / (2 * _DOT_MM**2)) * 255
    texture = np.dstack([bright, bright, bright, np.full_like(bright, 255)]).astype(np.uint8)
    uv = 0.5 + (rest - rest[vertex]) * (1, -1) / (2 * _TEXTURE_MM)
    near = (triangles == vertex).any(axis=1, keepdims=True)
    layered = np.where(near, triangles, triangles + len(rest)).astype(np.int32)
    both = np.concatenate([uv, np.zeros_like(uv)]).astype(np.float32)
    return MeshLayer("dot", layered, both, texture)


def _centroid(layer: MeshLayer, body: Body, around: Array) -> Array:
    """(2,) mm: the middle of the light in a picture of the body, nearer parts before farther."""
    size = (round(2 * _WINDOW_MM[0] * PIXELS_PER_MM), round(2 * _WINDOW_MM[1] * PIXELS_PER_MM))
    picture = np.zeros((size[1], size[0], 3), np.float32)
    flat = _to_pixels(body[:, :2], around[:2], size)
    corners = flat[layer.triangles % len(body)]
    seen = (corners.max(axis=1) > 0).all(axis=1) & (corners.min(axis=1) < size).all(axis=1)
    triangles = layer.triangles[seen]
    far_first = np.argsort(body[triangles % len(body), 2].mean(axis=1))
    ordered = MeshLayer("dot", triangles[far_first], layer.uv, layer.texture)
    paint(picture, ordered, np.concatenate([flat, flat]))
    light = picture[..., 0].astype(float)
    if light.sum() < 255:
        return np.full(2, np.nan)
    columns, rows = np.arange(size[0]), np.arange(size[1])
    found = np.array([light.sum(axis=0) @ columns, light.sum(axis=1) @ rows]) / light.sum()
    return np.asarray((found - (np.array(size) - 1) / 2) * (1, -1) / PIXELS_PER_MM + around[:2])


def _to_pixels(flat: Array, around: Array, size: tuple[int, int]) -> Array:
    middle = (np.array(size) - 1) / 2
    return np.asarray((flat - around) * (1, -1) * PIXELS_PER_MM + middle)
