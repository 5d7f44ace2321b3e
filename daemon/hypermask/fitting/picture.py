"""A picture of a fit: the photograph with the mesh and its handles, the texture, a few faces."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.border import inner_triangles
from hypermask.face.mesh import load_mesh
from hypermask.face.mouth import MOUTH_SHAPES
from hypermask.face.sheet import front_view
from hypermask.fitting.session import Fitting
from hypermask.mask import Mask

Image = NDArray[np.uint8]
Array = NDArray[np.float64]

SIDE = 1024
_TRIED: tuple[dict[str, Any], ...] = (
    {},
    {"expression": {"happiness": 1.0}},
    {"mouth": MOUTH_SHAPES["a"]},
    {"expression": {"surprise": 0.5}, "lids": 0.8},
)
_MARGIN = 0.12
_MESH = (170, 230, 170)
_DRAWN: dict[str, tuple[int, tuple[int, int, int]]] = {
    "points": (2, (255, 255, 255)),
    "features": (5, (90, 200, 255)),
    "parts": (9, (255, 170, 60)),
    "face": (14, (255, 70, 90)),
}
"""Level -> radius and colour of its handles, the finest first."""


def fit_picture(fitting: Fitting, mask: Mask, side: int = SIDE) -> Image:
    """(side, side * 1.5, 3) RGB."""
    character = fitting.character()
    face, half = fitting.face(mask, character), side // 2
    texture = cv2.resize(character.texture, (half, half), interpolation=cv2.INTER_AREA)
    faces: Any = np.zeros((half, half, 3), np.uint8)
    for number, asked in enumerate(_TRIED):
        view = front_view(face, face.positions(**asked), 1.2, eye_holes=False)
        scale = half / 2 / max(view.shape[:2])
        view = np.asarray(cv2.resize(view, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
        row, column = divmod(number, 2)
        top, left = row * (half // 2), column * (half // 2) + (half // 2 - view.shape[1]) // 2
        faces[top : top + view.shape[0], left : left + view.shape[1]] = view
    return np.hstack([_overlaid(fitting, side), np.vstack([texture, faces])])


def _overlaid(fitting: Fitting, side: int) -> Image:
    """(side, side, 3) RGB: the face's part of the photograph, the mesh and the handles on it."""
    places, triangles = fitting.vertices(), inner_triangles(load_mesh())
    scale, offset = _view(places[np.unique(triangles)], side)
    warp = np.array([[scale, 0, offset[0]], [0, scale, offset[1]]])
    image: Any = cv2.warpAffine(
        np.ascontiguousarray(fitting.photo[..., ::-1]), warp, (side, side), flags=cv2.INTER_AREA
    )
    picture = image.copy()
    outlines = [_pixels(places[corners] * scale + offset) for corners in triangles]
    cv2.polylines(picture, outlines, True, _MESH, 1, cv2.LINE_AA, 4)
    picture = cv2.addWeighted(image, 0.45, picture, 0.55, 0)
    for level, (radius, colour) in _DRAWN.items():
        for place in fitting.handles(level).values():
            x, y = _pixels(np.array(place) * scale + offset).tolist()
            cv2.circle(picture, (x, y), radius * 16, (0, 0, 0), 4, cv2.LINE_AA, 4)
            cv2.circle(picture, (x, y), radius * 16, colour, 2, cv2.LINE_AA, 4)
    return np.asarray(picture, np.uint8)


def _view(places: Array, side: int) -> tuple[float, Array]:
    """Scale and offset (2,) that bring the face into a square picture."""
    low, high = places.min(axis=0), places.max(axis=0)
    scale = side / (float((high - low).max()) * (1 + 2 * _MARGIN))
    return scale, (side - 1) / 2 - (low + high) / 2 * scale


def _pixels(places: Array) -> NDArray[np.int32]:
    """In sixteenths of a pixel, as OpenCV draws them."""
    return np.round(places * 16).astype(np.int32)
