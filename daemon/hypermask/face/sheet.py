"""A character's sheet: emotions, mouth shapes, lids and mixtures, as the mask shows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.character import Character
from hypermask.face.emotions import EMOTIONS
from hypermask.face.face import Face, Positions
from hypermask.face.mouth import MOUTH_SHAPES
from hypermask.mask import Mask
from hypermask.stage.layers import MeshLayer
from hypermask.texture.normalise import rasterise

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_SMOOTH = 2


@dataclass(frozen=True)
class Pose:
    """One picture of the sheet."""

    title: str
    expression: Mapping[str, float]
    mouth: str = "closed"
    lids: float = 0.0


POSES: tuple[Pose, ...] = (
    Pose("neutral", {}),
    *(Pose(name, {name: 1.0}) for name in EMOTIONS),
    *(Pose(f"/{name}/", {}, name) for name in MOUTH_SHAPES if name != "closed"),
    Pose("blink, half", {}, lids=0.5),
    Pose("blink", {}, lids=1.0),
    Pose("happiness /a/", {"happiness": 1.0}, "a"),
    Pose("happiness /u/", {"happiness": 1.0}, "u"),
    Pose("anger /e/", {"anger": 1.0}, "e"),
    Pose("sadness /o/", {"sadness": 1.0}, "o"),
    Pose("fear /i/, blink", {"fear": 1.0}, "i", 1.0),
    Pose("anger + disgust", {"anger": 0.7, "disgust": 0.7}),
    Pose("surprise + happiness", {"surprise": 0.6, "happiness": 0.7}),
)


def sheet(
    character: Character,
    mask: Mask,
    columns: int = 7,
    pixels_per_mm: float = 1.2,
    eye_holes: bool = True,
) -> Image:
    """(h, w, 3) RGB: the faces of `POSES`, each with its title."""
    face = Face(character, mask)
    pictures = []
    for pose in POSES:
        positions = face.positions(pose.expression, MOUTH_SHAPES[pose.mouth], pose.lids)
        picture = front_view(face, positions, pixels_per_mm, eye_holes)
        pictures.append(_titled(picture, pose.title))
    blank = np.zeros_like(pictures[0])
    pictures += [blank] * (-len(pictures) % columns)
    rows = [np.hstack(pictures[k : k + columns]) for k in range(0, len(pictures), columns)]
    return np.asarray(np.vstack(rows), np.uint8)


def front_view(
    face: Face, positions: Sequence[Positions], pixels_per_mm: float, eye_holes: bool = True
) -> Image:
    """(h, w, 3) RGB: the actor's layers seen along the mask's axis, on black."""
    outline = face.mask.settings.outline
    scale = pixels_per_mm * 1000 * _SMOOTH
    size = (
        round(2.06 * outline.half_width_m * scale / _SMOOTH) * _SMOOTH,
        round(2.04 * outline.half_height_m * scale / _SMOOTH) * _SMOOTH,
    )
    picture = np.zeros((size[1], size[0], 3), np.float32)
    for layer, places in zip(face.actor.layers, positions, strict=True):
        flat = places[:, :2].astype(float) * (1, -1) * scale + np.array(size) / 2 - 0.5
        _paint(picture, layer, flat)
    xs, ys = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    x, y = (xs - size[0] / 2) / scale, (size[1] / 2 - ys) / scale
    picture[~face.mask.inside(x, y)] = 0
    for hole in face.mask.settings.eye_holes if eye_holes else ():
        gap = np.hypot(x - hole.centre_m[0], y - hole.centre_m[1])
        picture[gap < hole.radius_m] = 0
    smaller = (size[0] // _SMOOTH, size[1] // _SMOOTH)
    smooth = cv2.resize(picture, smaller, interpolation=cv2.INTER_AREA)
    return np.asarray(np.clip(smooth + 0.5, 0, 255), np.uint8)


def _paint(picture: NDArray[np.float32], layer: MeshLayer, flat: Array) -> None:
    height, width = picture.shape[:2]
    low = np.clip(np.floor(flat.min(axis=0)).astype(int) - 1, 0, (width - 1, height - 1))
    high = np.clip(np.ceil(flat.max(axis=0)).astype(int) + 2, low + 1, (width, height))
    box = high - low
    raster = rasterise(flat - low, layer.triangles, (int(box[0]), int(box[1])))
    size = np.array(layer.texture.shape[1::-1], float)
    place = (layer.uv * size - 0.5).astype(np.float32)[raster.corners]
    where = np.einsum("ijk,ijkl->ijl", raster.weights, place).astype(np.float32)
    colour = cv2.remap(
        layer.texture, where[..., 0], where[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE
    )
    alpha = colour[..., 3:].astype(np.float32) / 255 * raster.covered[..., None]
    part = picture[low[1] : high[1], low[0] : high[0]]
    part += alpha * (colour[..., :3].astype(np.float32) - part)


def _titled(picture: Image, title: str) -> Image:
    strip = np.zeros((24, picture.shape[1], 3), np.uint8)
    cv2.putText(
        strip, title, (6, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (220, 220, 220), 1, cv2.LINE_AA
    )
    return np.vstack([picture, strip])
