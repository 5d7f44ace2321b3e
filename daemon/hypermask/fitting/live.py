"""The texture of a mesh that is being dragged: as a character has it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.errors import UsageError
from hypermask.texture.build import make_texture, registration
from hypermask.texture.landmarks import Landmarks
from hypermask.texture.normalise import FINE_SIZE, SIZE, shrunk
from hypermask.texture.pupils import find_pupils

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Map = NDArray[np.float32]


class LiveTexture:
    """photo: (h, w, 3) BGR; landmarks: (468, 3) pixels."""

    def __init__(self, photo: Image, landmarks: Array) -> None:
        self._photo = photo
        self._face = Landmarks(landmarks, 1.0, find_pupils(photo, landmarks[:, :2]))
        self._kept: dict[int, tuple[Image, Landmarks, float]] = {}
        self._beside: dict[int, Map | None] = {}

    def make(self, vertices: Array, size: int = SIZE) -> tuple[Image, Image]:
        """(texture (size, size, 3), eyes), both RGB, where the mesh lies so (V, 2).

        Raises `UsageError` FIT-SIZE, `DataError` FACE-HIDDEN, TEXTURE-MODEL.
        """
        if size not in (SIZE, FINE_SIZE):
            raise UsageError(
                "FIT-SIZE", f"a texture of {size!r} texels is not made", "512 or 1024."
            )
        photo, face, scale = self._at(size)
        if size not in self._beside:
            self._beside[size] = registration(photo, face)
        placed = (vertices + 0.5) * scale - 0.5
        return make_texture(photo, face, size, vertices=placed, beside=self._beside[size])

    def _at(self, size: int) -> tuple[Image, Landmarks, float]:
        """Photograph, landmarks and scale: no larger than a texture of this size can use."""
        if size not in self._kept:
            self._kept[size] = self._scaled(size)
        return self._kept[size]

    def _scaled(self, size: int) -> tuple[Image, Landmarks, float]:
        scale = shrunk(self._face.eye_distance, size)
        if scale == 1:
            return self._photo, self._face, 1.0
        photo = cv2.resize(self._photo, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        points = self._face.points * scale
        points[:, :2] += (scale - 1) / 2
        pupils = (self._face.pupils + 0.5) * scale - 0.5
        return np.asarray(photo, np.uint8), Landmarks(points, 1.0, pupils), scale
