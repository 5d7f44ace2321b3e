"""Theatre make-up painted on to the mean face: noh, kabuki and clown.

Everything is given in millimetres on the mask for the audience's right side and mirrored. The
mean face's light and shade stay under the paint, so that it keeps its form.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.face.points import (
    LEFT_BROW,
    LEFT_EYE,
    LIPS_OUTER,
    RIGHT_BROW,
    RIGHT_EYE,
)
from hypermask.texture import regions
from hypermask.texture.fill import diffuse
from hypermask.texture.normalise import SIZE

Image = NDArray[np.uint8]
Map = NDArray[np.float32]
Points = Sequence[tuple[float, float]]
Colour = tuple[int, int, int]

_FINE = 4


def _plan(texture: Image) -> tuple[NDArray[np.float32], Map]:
    """(canvas without brows, light): what make-up is put on, and its shading, 1 on average."""
    brows = np.maximum(regions.polygon(LEFT_BROW), regions.polygon(RIGHT_BROW))
    brows = regions.soften(regions.grow(brows, 5), 1.2)
    canvas = texture.astype(np.float32)
    around = cv2.GaussianBlur(canvas, (0, 0), 2).astype(np.float32)
    skin = diffuse(around, np.asarray((brows < 0.02).astype(np.float32)))
    canvas = canvas * (1 - brows[..., None]) + skin * brows[..., None]
    grey = cv2.cvtColor(canvas, cv2.COLOR_BGR2GRAY)
    light = grey / float(np.median(grey[regions.cheeks() > 0.5]))
    return canvas, np.asarray(np.clip(light, 0.25, 1.4), np.float32)


def _cover(
    canvas: NDArray[np.float32], mask: Map, colour: Colour, light: Map, form: float = 0.6
) -> None:
    """Paint `colour` (RGB) where `mask` is 1; `form` is how far light and shade show through."""
    paint = np.array(colour[::-1], np.float32) * (light**form)[..., None]
    canvas += mask[..., None] * (paint - canvas)


def _draw(shapes: Sequence[NDArray[np.float64]], soft_mm: float = 0.5) -> Map:
    """Polygons (n, 2) in mm, smooth-edged, 0 to 1."""
    fine = np.zeros((SIZE * _FINE, SIZE * _FINE), np.uint8)
    for shape in shapes:
        texel = (regions.to_texels(shape) + 0.5) * _FINE - 0.5
        cv2.fillPoly(fine, [np.round(texel * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
    small = cv2.resize(fine, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    return regions.soften(np.asarray(small / 255, np.float32), soft_mm)


def _both(shape: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    return [shape, shape * (-1, 1)]


def _stroke(points: Points, widths: ArrayLike) -> NDArray[np.float64]:
    """The outline of a brush stroke through `points`, its width varying along it (mm)."""
    knots = np.array(points, float)
    t = np.linspace(0, len(knots) - 1, 80)
    line = np.stack([_smooth_through(knots[:, k], t) for k in range(2)], 1)
    width = np.interp(t, np.linspace(0, t[-1], np.size(widths)), np.atleast_1d(widths))
    along = np.gradient(line, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], 1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    side = normal * width[:, None] / 2
    return np.concatenate([line + side, (line - side)[::-1]])


def _area(border: Points, corners: Points) -> NDArray[np.float64]:
    """The area between a smooth border and some corners outside."""
    knots = np.array(border, float)
    t = np.linspace(0, len(knots) - 1, 90)
    line = np.stack([_smooth_through(knots[:, k], t) for k in range(2)], 1)
    return np.concatenate([line, np.array(corners, float)])


def _smooth_through(values: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Catmull-Rom spline through the values at 0, 1, 2, ..."""
    padded = np.concatenate([[2 * values[0] - values[1]], values, [2 * values[-1] - values[-2]]])
    k = np.minimum(t.astype(int), len(values) - 2)
    f = t - k
    a, b, c, d = (padded[k + n] for n in range(4))
    return np.asarray(
        0.5 * (2 * b + (c - a) * f + (2 * a - 5 * b + 4 * c - d) * f**2)
        + 0.5 * (3 * b - a - 3 * c + d) * f**3
    )


def _ellipse(x: float, y: float, rx: float, ry: float, turn: float = 0.0) -> NDArray[np.float64]:
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    flat = np.stack([rx * np.cos(angle), ry * np.sin(angle)], 1)
    c, s = np.cos(turn), np.sin(turn)
    return np.asarray(flat @ np.array([[c, s], [-s, c]]) + (x, y))


def _lids(grow_mm: float, soft_mm: float) -> Map:
    """A line around both eyes."""
    eyes = np.maximum(regions.polygon(LEFT_EYE), regions.polygon(RIGHT_EYE))
    ring = regions.grow(eyes, grow_mm) - regions.grow(eyes, -0.4)
    return np.clip(regions.soften(np.asarray(ring, np.float32), soft_mm), 0, 1)


def _lips(grow_mm: float = 0.0) -> Map:
    return regions.soften(regions.grow(regions.polygon(LIPS_OUTER), grow_mm or 0.01), 0.5)


def _finish(canvas: NDArray[np.float32]) -> Image:
    return np.asarray(np.clip(canvas, 0, 255), np.uint8)


def _tint(eyes: Image, colour: Colour, strength: float) -> Image:
    """Eyeballs with brighter whites, tinted."""
    bright = np.clip(eyes.astype(np.float32) * 1.15, 0, 255)
    tinted = bright * (1 - strength) + bright * np.array(colour[::-1]) / 255 * strength
    return np.asarray(np.clip(tinted, 0, 255), np.uint8)


def noh(texture: Image, eyes: Image) -> tuple[Image, Image]:
    """A young woman of the noh stage: ivory, high smudged brows, small red mouth, black hair."""
    canvas, light = _plan(texture)
    whole = np.ones((SIZE, SIZE), np.float32)
    _cover(canvas, whole * 0.94, (250, 240, 220), light, 0.75)
    _cover(canvas, _draw(_both(_ellipse(52, -22, 20, 18)), 9) * 0.20, (232, 150, 120), light)
    brows = _both(_ellipse(31, 78, 15, 5.5, 0.22))
    _cover(canvas, _draw(brows, 3.2) * 0.85, (40, 34, 36), light)
    liner = _both(
        _stroke([(15, 22), (24, 31.5), (36, 32), (48, 25), (55, 22)], [1.0, 2.6, 2.8, 2.4, 0.3])
    )
    _cover(canvas, _draw(liner, 0.5) * 0.95, (22, 18, 20), light)
    _cover(canvas, _lids(1.2, 0.6) * 0.6, (30, 24, 26), light)
    _cover(canvas, _lips() * 0.92, (188, 30, 36), light, 0.9)
    line = [(0, 113), (36, 107), (66, 86), (81, 50), (85, 8), (84, -30), (94, -64), (104, -80)]
    hair = _both(_area(line, [(130, -80), (130, 160), (0, 160)]))
    _cover(canvas, _draw(hair, 1.2), (24, 20, 22), light, 0.3)
    strands = [
        _stroke([(x, 140), (x * 1.1 + 8, 112), (82 + x * 0.1, 60), (91 + x * 0.06, -10)], [0.5])
        for x in (6.0, 18.0, 30.0, 42.0)
    ]
    both = [side for strand in strands for side in _both(strand)]
    _cover(canvas, _draw(both, 0.4) * 0.35, (110, 100, 100), light, 0)
    return _finish(canvas), _tint(eyes, (255, 250, 235), 0.3)


def kabuki(texture: Image, eyes: Image) -> tuple[Image, Image]:
    """A furious hero of the kabuki stage: white ground, red kumadori, black brows and mouth."""
    canvas, light = _plan(texture)
    _cover(canvas, np.full((SIZE, SIZE), 0.95, np.float32), (250, 246, 240), light, 0.65)
    red = (
        _stroke([(13, 30), (26, 42), (46, 50), (66, 66), (80, 92)], [2, 7, 11, 12, 3]),
        _stroke([(7, 46), (9, 62), (16, 84), (32, 108)], [3, 7, 10, 2]),
        _stroke([(16, 15), (32, 8), (54, 14), (76, 32), (92, 58)], [1.5, 7, 10, 10, 2]),
        _stroke([(17, -22), (34, -14), (58, -12), (78, 4), (94, 30)], [2, 8, 12, 10, 2]),
        _stroke([(23, -34), (42, -46), (58, -44), (74, -30), (88, -8)], [1, 5, 10, 9, 2]),
        _stroke([(30, -66), (44, -78), (58, -80), (76, -66)], [1.5, 7, 9, 2]),
        _stroke([(8, -84), (16, -98), (34, -108), (52, -106)], [2, 8, 9, 2]),
    )
    stripes = [side for stroke in red for side in _both(stroke)]
    wide = _draw(stripes, 2.6)
    _cover(canvas, wide * 0.55, (226, 60, 50), light, 0.5)
    _cover(canvas, _draw(stripes, 0.6) * wide, (190, 14, 22), light, 0.6)
    brows = _both(_stroke([(9, 41), (24, 52), (42, 62), (58, 78)], [6, 9.5, 8, 2]))
    _cover(canvas, _draw(brows, 0.5), (16, 14, 16), light, 0.2)
    liner = _both(
        _stroke([(11, 20), (22, 32.5), (36, 34), (52, 28), (66, 34)], [1.5, 3, 3.6, 3.5, 0.6])
    )
    under = _both(_stroke([(16, 21), (30, 16), (46, 20), (60, 29)], [1, 2.2, 2.4, 0.6]))
    _cover(canvas, _draw(liner + under, 0.4), (16, 14, 16), light, 0.2)
    _cover(canvas, _lids(1.0, 0.5) * 0.8, (20, 16, 18), light)
    _cover(canvas, _lips(), (178, 12, 20), light, 0.9)
    corners = _both(_stroke([(25, -58), (32, -61), (37, -68)], [4, 4.5, 0.5]))
    _cover(canvas, _draw(corners, 0.4), (16, 14, 16), light, 0.2)
    _cover(
        canvas,
        _draw([_stroke([(-20, 132), (0, 108), (20, 132)], [20, 26, 20])], 1.0),
        (20, 18, 20),
        light,
        0.2,
    )
    return _finish(canvas), _tint(eyes, (255, 236, 190), 0.5)


def clown(texture: Image, eyes: Image) -> tuple[Image, Image]:
    """A circus clown: white round eyes and mouth, red nose and lips, blue and yellow."""
    canvas, light = _plan(texture)
    _cover(canvas, np.full((SIZE, SIZE), 0.80, np.float32), (248, 205, 178), light, 0.8)
    _cover(canvas, _draw(_both(_ellipse(58, -26, 19, 17)), 6) * 0.75, (236, 92, 84), light)
    white = [*_both(_ellipse(31, 34, 24, 34)), _ellipse(0, -62, 50, 27)]
    _cover(canvas, _draw(white, 0.8) * 0.96, (252, 250, 246), light, 0.55)
    diamonds = [
        np.array([(31, 86), (36, 54), (31, 44), (26, 54)], float),
        np.array([(31, -20), (35, 2), (31, 11), (27, 2)], float),
    ]
    blue = [side for diamond in diamonds for side in _both(diamond)]
    _cover(canvas, _draw(blue, 0.5), (26, 74, 178), light, 0.5)
    brows = _both(_stroke([(13, 66), (26, 84), (44, 86), (58, 70)], [1.5, 4, 4.5, 1]))
    _cover(canvas, _draw(brows, 0.4), (24, 22, 26), light, 0.2)
    _cover(canvas, _lids(1.6, 0.5) * 0.9, (24, 22, 26), light)
    smile = _stroke([(-44, -44), (-30, -58), (0, -66), (30, -58), (44, -44)], [2, 11, 17, 11, 2])
    mouth = np.maximum(_draw([smile], 0.5), _lips(1.0))
    _cover(canvas, mouth, (206, 22, 30), light, 0.8)
    nose = _draw([_ellipse(0, -25, 18.5, 16)], 0.8)
    x, y = regions.grid_mm()
    ball = np.clip(1.05 - 0.55 * np.hypot(x + 4, y + 20) / 20, 0.4, 1.1).astype(np.float32)
    _cover(canvas, nose, (228, 26, 30), ball, 1.0)
    _cover(canvas, _draw([_ellipse(-6, -17, 3.6, 2.8, 0.5)], 1.0) * 0.7, (255, 225, 220), ball, 0)
    fringe = [
        (0, 104),
        (14, 98),
        (28, 105),
        (44, 100),
        (60, 104),
        (74, 88),
        (86, 74),
        (90, 50),
        (104, 30),
    ]
    hair = _both(_area(fringe, [(130, 30), (130, 160), (0, 160)]))
    _cover(canvas, _draw(hair, 1.0), (244, 178, 30), light, 0.4)
    return _finish(canvas), _tint(eyes, (255, 255, 255), 0.0)


MAKEUPS: dict[str, Callable[[Image, Image], tuple[Image, Image]]] = {
    "noh": noh,
    "kabuki": kabuki,
    "clown": clown,
}
