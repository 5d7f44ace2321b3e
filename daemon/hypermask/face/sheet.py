"""A character's sheet: emotions, mouth shapes, looks, turns and every action unit on the mask."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face.action_units import NUMBERS, load_action_units
from hypermask.face.character import Character
from hypermask.face.emotions import EMOTIONS
from hypermask.face.face import Face, Positions
from hypermask.face.mouth import MOUTH_SHAPES
from hypermask.mask import Mask
from hypermask.stage.layers import MeshLayer

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_SMOOTH = 2


@dataclass(frozen=True)
class Pose:
    """One picture of the sheet; turn: (yaw, pitch) in degrees, to the audience's right and up."""

    title: str
    expression: Mapping[str, float] = field(default_factory=dict)
    mouth: str = "closed"
    lids: float = 0.0
    units: Mapping[str, float | str] = field(default_factory=dict)
    gaze: tuple[float, float] | None = None
    turn: tuple[float, float] = (0.0, 0.0)


_BASE: tuple[Pose, ...] = (
    Pose("neutral"),
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
_LOOKS: tuple[Pose, ...] = (
    Pose("looks left", gaze=(-0.4, 0.0)),
    Pose("looks right", gaze=(0.4, 0.0)),
    Pose("looks up", gaze=(0.1, 0.3)),
    Pose("looks down", gaze=(-0.1, -0.3)),
    Pose("smile and /e/", {}, "e", units={"6": 0.7, "12": 0.8}),
    Pose("one brow, one corner", units={"1L": 0.4, "2L": 1.0, "4R": 0.6, "12R": 0.6}),
    Pose("wink", units={"46L": 1.0, "12L": 0.5}),
)
_TURNS: tuple[Pose, ...] = (
    Pose("turned left 30", {"happiness": 0.8}, turn=(-30.0, 0.0)),
    Pose("turned left 15", {"happiness": 0.8}, turn=(-15.0, 0.0)),
    Pose("ahead", {"happiness": 0.8}),
    Pose("turned right 15", {"happiness": 0.8}, turn=(15.0, 0.0)),
    Pose("turned right 30", {"happiness": 0.8}, turn=(30.0, 0.0)),
    Pose("nods down 20", {"surprise": 0.8}, turn=(0.0, -20.0)),
    Pose("nods up 20", {"surprise": 0.8}, turn=(0.0, 20.0)),
)
POSES = (*_BASE, *_LOOKS, *_TURNS)


def unit_poses() -> tuple[Pose, ...]:
    """Each of the 44 action units at full strength."""
    table = load_action_units().table
    return tuple(Pose(f"{n} {table[n].name}", units={str(n): 1.0}) for n in NUMBERS)


def sheet(
    character: Character,
    mask: Mask,
    columns: int = 7,
    pixels_per_mm: float = 1.2,
    eye_holes: bool = True,
    poses: Sequence[Pose] | None = None,
) -> Image:
    """(h, w, 3) RGB: faces with their titles, by default `POSES` and then every action unit."""
    face = Face(character, mask)
    pictures = []
    for pose in (*POSES, *unit_poses()) if poses is None else poses:
        positions = face.positions(
            pose.expression, MOUTH_SHAPES[pose.mouth], pose.lids, pose.units, pose.gaze
        )
        if any(pose.turn):
            picture = turned_view(face, positions, pixels_per_mm, pose.turn, eye_holes)
        else:
            picture = front_view(face, positions, pixels_per_mm, eye_holes)
        pictures.append(titled(picture, pose.title))
    return joined(pictures, columns)


def joined(pictures: Sequence[Image], columns: int) -> Image:
    """Pictures of one size on one page, row by row."""
    blank = [np.zeros_like(pictures[0])] * (-len(pictures) % columns)
    filled = [*pictures, *blank]
    rows = [np.hstack(filled[k : k + columns]) for k in range(0, len(filled), columns)]
    return np.asarray(np.vstack(rows), np.uint8)


def front_view(
    face: Face, positions: Sequence[Positions], pixels_per_mm: float, eye_holes: bool = True
) -> Image:
    """(h, w, 3) RGB: the actor's layers seen along the mask's axis, on black."""
    scale, size = _canvas(face.mask, pixels_per_mm)
    picture = np.zeros((size[1], size[0], 3), np.float32)
    for layer, places in zip(face.actor.layers, positions, strict=True):
        flat = places[:, :2].astype(float) * (1, -1) * scale + np.array(size) / 2 - 0.5
        paint(picture, layer, flat)
    xs, ys = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    x, y = (xs - size[0] / 2) / scale, (size[1] / 2 - ys) / scale
    picture[~_lit(face.mask, x, y, eye_holes)] = 0
    return _smaller(picture)


def turned_view(
    face: Face,
    positions: Sequence[Positions],
    pixels_per_mm: float,
    turn: tuple[float, float],
    eye_holes: bool = True,
) -> Image:
    """(h, w, 3) RGB: the mask turned by (yaw, pitch) degrees, from far away, on black."""
    scale, size = _canvas(face.mask, pixels_per_mm)
    yaw, pitch = np.radians(turn)
    about_y = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    about_x = np.array(
        [[1, 0, 0], [0, np.cos(pitch), np.sin(pitch)], [0, -np.sin(pitch), np.cos(pitch)]]
    )
    middle = np.array([0.0, 0.0, float(face.mask.relief.mean())])
    picture = np.zeros((size[1], size[0], 3), np.float32)
    for layer, places in zip(face.actor.layers, positions, strict=True):
        seen = (places.astype(float) - middle) @ (about_x @ about_y).T
        flat = seen[:, :2] * (1, -1) * scale + np.array(size) / 2 - 0.5
        far_first = np.argsort(seen[layer.triangles, 2].mean(axis=1))
        paint(
            picture,
            replace(layer, triangles=layer.triangles[far_first]),
            flat,
            lambda x, y: _lit(face.mask, x, y, eye_holes),
            places,
        )
    return _smaller(picture)


def _canvas(mask: Mask, pixels_per_mm: float) -> tuple[float, tuple[int, int]]:
    """Pixels for a metre, and the size of the picture before it is made smaller."""
    outline, scale = mask.settings.outline, pixels_per_mm * 1000 * _SMOOTH
    width = round(2.06 * outline.half_width_m * scale / _SMOOTH) * _SMOOTH
    height = round(2.04 * outline.half_height_m * scale / _SMOOTH) * _SMOOTH
    return scale, (width, height)


def _lit(mask: Mask, x: NDArray[Any], y: NDArray[Any], eye_holes: bool) -> NDArray[np.bool_]:
    """Where light may fall on the mask: within its outline, not into the eye holes."""
    lit = mask.inside(x, y)
    for hole in mask.settings.eye_holes if eye_holes else ():
        lit &= np.hypot(x - hole.centre_m[0], y - hole.centre_m[1]) >= hole.radius_m
    return np.asarray(lit, np.bool_)


def _smaller(picture: NDArray[np.float32]) -> Image:
    size = (picture.shape[1] // _SMOOTH, picture.shape[0] // _SMOOTH)
    smooth = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return np.asarray(np.clip(smooth + 0.5, 0, 255), np.uint8)


def paint(
    picture: NDArray[np.float32],
    layer: MeshLayer,
    flat: Array,
    lit: Callable[[NDArray[Any], NDArray[Any]], NDArray[np.bool_]] | None = None,
    places: Positions | None = None,
) -> None:
    """Lay a layer over the picture: flat (V, 2) pixels; lit: which places of the mask show it."""
    height, width = picture.shape[:2]
    low = np.clip(np.floor(flat.min(axis=0)).astype(int) - 1, 0, (width - 1, height - 1))
    high = np.clip(np.ceil(flat.max(axis=0)).astype(int) + 2, low + 1, (width, height))
    box = high - low
    number = np.full((int(box[1]), int(box[0])), -1, np.int32)
    outlines = np.round((flat - low) * 16).astype(np.int32)[layer.triangles]
    for k, outline in enumerate(outlines):
        cv2.fillConvexPoly(number, outline, k, lineType=cv2.LINE_8, shift=4)
    size = np.array(layer.texture.shape[1::-1], float)
    x, y = _mapped(flat - low, layer.triangles, layer.uv * size - 0.5, number)
    colour = cv2.remap(layer.texture, x, y, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    alpha = colour[..., 3:].astype(np.float32) / 255 * (number >= 0)[..., None]
    if lit is not None and places is not None:
        where = _mapped(flat - low, layer.triangles, places[:, :2], number)
        alpha *= lit(*where)[..., None]
    part = picture[low[1] : high[1], low[0] : high[0]]
    part += alpha * (colour[..., :3].astype(np.float32) - part)


def _mapped(
    flat: Array, triangles: NDArray[np.int32], values: NDArray[Any], number: NDArray[np.int32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Both columns of values (V, 2) at every pixel, (h, w) each; number: (h, w) its triangle.

    Within a triangle a value is a + b x + c y, so a pixel needs its triangle's three numbers only.
    """
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    area = np.where(np.abs(area) < 1e-9, 1e-9, area)[:, None]
    of_a, of_b, of_c = (values[triangles[:, k]].astype(float) for k in range(3))
    along_u, along_v = of_b - of_a, of_c - of_a
    per_x = (along_u * v[:, 1:] - along_v * u[:, 1:]) / area
    per_y = (along_v * u[:, :1] - along_u * v[:, :1]) / area
    start = of_a - per_x * a[:, :1] - per_y * a[:, 1:]
    xs = np.arange(number.shape[1], dtype=np.float32)
    ys = np.arange(number.shape[0], dtype=np.float32)[:, None]
    first, second = (
        np.asarray(
            np.take(start[:, k].astype(np.float32), number)
            + np.take(per_x[:, k].astype(np.float32), number) * xs
            + np.take(per_y[:, k].astype(np.float32), number) * ys,
            np.float32,
        )
        for k in range(2)
    )
    return first, second


def titled(picture: Image, title: str) -> Image:
    """The picture under a strip with its title."""
    strip = np.zeros((24, picture.shape[1], 3), np.uint8)
    (wide, _), _ = cv2.getTextSize(title, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    size = 0.5 * min(1.0, (picture.shape[1] - 10) / max(wide, 1))
    cv2.putText(
        strip, title, (6, 17), cv2.FONT_HERSHEY_SIMPLEX, size, (220, 220, 220), 1, cv2.LINE_AA
    )
    return np.vstack([picture, strip])
