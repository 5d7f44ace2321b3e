"""What lies behind the skin's openings: eyeballs, the bag of the mouth, the teeth (PAPERS A3)."""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.face import points
from hypermask.stage.layers import MeshLayer
from hypermask.texture.eyes import CENTRES_MM, HALF_MM

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Indices = NDArray[np.int32]

EYE_DEPTH_M, TEETH_DEPTH_M, BAG_DEPTH_M = 0.0035, 0.0035, 0.008
"""Behind the skin: enough to be hidden by it, little enough not to shift when seen from aside."""
_EYEBALL_M, _MOST_GAZE, _FIRM_MM = 0.0125, np.array([0.40, 0.33]), (8.0, 5.0)
"""An eyeball's radius, how far it turns aside and up, and what of it turns as a whole."""
_TONGUE_GRID = (7, 7)
_TONGUE_WIDTH, _TONGUE_M, _TONGUE_GAP_M = 0.46, 0.009, 0.005
_EYE_GRID = (17, 13)
_TEETH_COLUMNS = 17
_TEETH_HALF_WIDTH, _TEETH_HALF_MM = 0.98, 37.3
_TEETH_BEND = 0.3
"""How much of the lips' curve the rows of teeth follow: the jaws are stiff."""
_UPPER_SHARE, _LOWER_SHARE = 0.50, 0.24
_UPPER_SHOWN_M, _LOWER_SHOWN_M = 0.0080, 0.0042
_HIDDEN_GAP_M, _WELL_OPEN_M, _BEHIND_LIP_M = 0.0012, 0.0040, 0.0030
_UPPER_HEIGHT, _LOWER_HEIGHT = 0.40, 0.28
"""In half widths of the mouth."""


def grid_triangles(columns: int, rows: int) -> Indices:
    """(T, 3) anti-clockwise triangles of a grid of points, row 0 on top."""
    index = np.arange(columns * rows).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, 1:].ravel(), index[1:, :-1].ravel()
    return np.concatenate([np.stack([a, d, b], 1), np.stack([b, d, c], 1)]).astype(np.int32)


def eye_layer(eyes: Image) -> tuple[MeshLayer, Array]:
    """The layer of both eyeballs and its places (V, 2) in metres, looking straight ahead."""
    columns, rows = _EYE_GRID
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    places, uvs, triangles = [], [], []
    for side, centre in enumerate(CENTRES_MM):
        x = centre[0] + (2 * u - 1) * HALF_MM[0]
        y = centre[1] + (1 - 2 * v) * HALF_MM[1]
        places.append(np.stack([x.ravel(), y.ravel()], 1) / 1000)
        uvs.append(np.stack([(u.ravel() + side) / 2, v.ravel()], 1))
        triangles.append(grid_triangles(columns, rows) + side * columns * rows)
    uv = np.concatenate(uvs).astype(np.float32)
    return MeshLayer("eyes", np.concatenate(triangles), uv, rgba(eyes)), np.concatenate(places)


def eye_shares(straight: Array) -> Array:
    """(V, 1) how much of the gaze's shift each point of the eyeballs takes.

    The iris goes along as a whole; towards the lids' corners the white stays where it is.
    """
    half, firm = np.array(HALF_MM), np.array(_FIRM_MM)
    centres = np.repeat(CENTRES_MM, len(straight) // 2, axis=0)
    offset = np.abs(straight * 1000 - centres)
    shares = np.clip((half - offset) / (half - firm), 0, 1).prod(axis=1)
    return np.asarray(shares[:, None])


def eye_places(straight: Array, shares: Array, gaze: Array) -> Array:
    """(V, 2) metres: the eyeballs' places with the irises turned by gaze (2,), radians."""
    shift = _EYEBALL_M * np.sin(np.clip(gaze, -_MOST_GAZE, _MOST_GAZE))
    return np.asarray(straight + shares * shift)


@functools.cache
def tongue_layer() -> MeshLayer:
    """A tongue that lies over the lower lip when it is shown; drawn over the skin."""
    columns, rows = _TONGUE_GRID
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    uv = np.stack([u.ravel(), v.ravel()], 1).astype(np.float32)
    return MeshLayer("tongue", grid_triangles(columns, rows), uv, _tongue_texture())


def tongue_places(flat: Array, half_width: float, out: float, side: float) -> Array:
    """(V, 2) metres; out: 0 hidden (no area at all) to 1; side: -1 to 1, to the audience's right.

    It comes out only between parted lips and never over the upper one.
    """
    columns, rows = _TONGUE_GRID
    top, bottom = flat[points.UPPER_LIP_INNER[5]], flat[points.LOWER_LIP_INNER[5]]
    gap = max(float(top[1] - bottom[1]), 0.0)
    shown = out * min(gap / _TONGUE_GAP_M, 1.0)
    length = 0.62 * gap + _TONGUE_M * shown
    u, v = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(0, 1, rows))
    width = _TONGUE_WIDTH * half_width * min(2 * shown, 1.0)
    x = bottom[0] + u * width + 0.3 * half_width * side * shown * (0.4 + 0.6 * v)
    y = bottom[1] + 0.62 * gap - v * length * min(4 * shown, 1.0)
    return np.stack([x.ravel(), y.ravel()], 1)


def _tongue_texture(size: int = 96) -> Image:
    """Pink, a groove in the middle, round at the tip, lost in the dark of the mouth at its root."""
    line = (np.arange(size) + 0.5) / size
    x, y = np.meshgrid(line * 2 - 1, line)
    tip = np.hypot(x, np.maximum(y - 0.45, 0) / 0.55)
    alpha = np.clip((1 - tip) / 0.06, 0, 1) * np.clip(y / 0.35, 0, 1)
    groove = 1 - 0.16 * np.exp(-((x / 0.10) ** 2)) * np.clip(1.5 - 1.6 * y, 0, 1)
    round_off = 1 - 0.34 * np.clip((tip - 0.55) / 0.45, 0, 1) ** 2
    light = groove * round_off * (0.62 + 0.38 * np.clip(y / 0.5, 0, 1))
    colour = light[..., None] * (206, 104, 106)
    return np.clip(np.dstack([colour, alpha * 255]), 0, 255).astype(np.uint8)


@functools.cache
def bag_layer() -> MeshLayer:
    """A ring of 20 points well inside the lips around a middle, with a painted texture."""
    count = len(points.LIPS_INNER)
    angle = np.pi - np.arange(count) / count * 2 * np.pi
    ring = np.stack([0.5 + 0.5 * np.cos(angle), 0.5 - 0.5 * np.sin(angle)], 1)
    uv = np.concatenate([ring, [[0.5, 0.5]]]).astype(np.float32)
    k = np.arange(count)
    triangles = np.stack([k, np.full(count, count), (k + 1) % count], 1).astype(np.int32)
    return MeshLayer("mouth", triangles, uv, _bag_texture())


def bag_places(flat: Array) -> Array:
    """(21, 2) metres for the skin's vertices (V, 2)."""
    inner, outer = flat[list(points.LIPS_INNER)], flat[list(points.LIPS_OUTER)]
    ring = 0.3 * inner + 0.7 * outer
    return np.concatenate([ring, inner.mean(axis=0, keepdims=True)])


def _bag_texture(size: int = 128) -> Image:
    """Dark red, darker towards the throat, a tongue that lies low."""
    line = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(line, line)
    radius = np.hypot(x, y)
    wall = np.clip(0.30 + 0.70 * radius**1.5, 0, 1)[..., None] * (92, 22, 24)
    tongue = np.hypot(x / 0.62, (y - 0.66) / 0.52)
    lit = np.clip(1.15 - 0.55 * tongue, 0, 1) * (1 - 0.35 * np.exp(-((x / 0.06) ** 2)))
    share = np.clip((1 - tongue) / 0.25, 0, 1)[..., None]
    picture = wall * (1 - share) + lit[..., None] * (176, 78, 80) * share
    return rgba(np.clip(picture, 0, 255).astype(np.uint8))


@functools.cache
def teeth_layers() -> tuple[MeshLayer, MeshLayer]:
    """Upper and lower teeth: white strips, shaded smoothly by their curve and painted gaps."""
    columns = _TEETH_COLUMNS
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, 3))
    uv = np.stack([u.ravel(), v.ravel()], 1).astype(np.float32)
    triangles = grid_triangles(columns, 3)
    upper, lower = _teeth_texture(upper=True), _teeth_texture(upper=False)
    return (
        MeshLayer("lower_teeth", triangles, uv, lower, shaded=True),
        MeshLayer("upper_teeth", triangles, uv, upper, shaded=True),
    )


def teeth_places(flat: Array, half_width: float) -> tuple[Array, Array]:
    """(lower, upper) (51, 3): x, y in metres and how far each point lies back along the arch.

    They lie behind the lips and show no more than a share of the gap between them: all of the
    upper ones in a wide, little of them in a rounded mouth.
    """
    upper_lip, lower_lip = flat[list(points.UPPER_LIP_INNER)], flat[list(points.LOWER_LIP_INNER)]
    corners = float(upper_lip[-1, 0] - upper_lip[0, 0]) / 2
    x = np.linspace(-1, 1, _TEETH_COLUMNS) * half_width * _TEETH_HALF_WIDTH
    reach = np.clip(x / max(corners, 1e-6), -1, 1) * corners
    top, bottom = (np.interp(reach, lip[:, 0], lip[:, 1]) for lip in (upper_lip, lower_lip))
    middle = _TEETH_COLUMNS // 2
    open_gap = max(float(top[middle] - bottom[middle]) - _HIDDEN_GAP_M, 0.0)
    top, bottom = (lip[middle] + _TEETH_BEND * (lip - lip[middle]) for lip in (top, bottom))
    width = np.clip(corners / (half_width * 0.87), 0, 1) ** 2
    hidden = _BEHIND_LIP_M * np.clip(1 - open_gap / _WELL_OPEN_M, 0, 1)
    shown = np.minimum(_UPPER_SHARE * open_gap, _smile(x, half_width) * _UPPER_SHOWN_M * width)
    upper_edge = top - shown + hidden
    shown = np.minimum(_LOWER_SHARE * open_gap, _LOWER_SHOWN_M * width)
    lower_edge = bottom + shown - hidden
    arch = (x / half_width) ** 2 * 0.003
    upper_root = upper_edge + _UPPER_HEIGHT * half_width
    lower_root = lower_edge - _LOWER_HEIGHT * half_width
    return _strip(x, lower_edge, lower_root, arch), _strip(x, upper_root, upper_edge, arch)


def _smile(x: Array, half_width: float) -> Array:
    """The line of the upper teeth's edges rises a little to the sides."""
    return np.asarray(1 - 0.2 * (x / half_width) ** 2)


def _strip(x: Array, top: Array, bottom: Array, arch: Array) -> Array:
    y = np.stack([top, (top + bottom) / 2, bottom])
    bulge = np.array([0.0006, 0.0, 0.0006])[:, None]
    z = arch[None] + bulge
    return np.stack([np.broadcast_to(x, y.shape), y, np.broadcast_to(z, y.shape)], -1).reshape(
        -1, 3
    )


def _teeth_texture(upper: bool, width: int = 256, height: int = 64) -> Image:
    """A row of teeth with rounded edges; what is not a tooth is transparent, gums are pink."""
    widths = (8.5, 7.0, 7.6, 7.2, 7.0) if upper else (5.6, 6.0, 7.0, 7.2, 7.2)
    edges = np.cumsum((0.0, *widths))
    half = _TEETH_HALF_MM
    x, y = np.meshgrid(
        ((np.arange(width) + 0.5) / width * 2 - 1) * half, (np.arange(height) + 0.5) / height
    )
    y = y if upper else 1 - y  # 0 at the root, 1 at the cutting edge
    tooth = np.clip(np.searchsorted(edges, np.abs(x), side="right") - 1, 0, len(widths) - 1)
    centre = (edges[tooth] + edges[tooth + 1]) / 2
    across = (np.abs(x) - centre) / (np.array(widths)[tooth] / 2)
    corner = np.clip((np.abs(across) - 0.55) / 0.45, 0, 1)
    length = np.where(tooth == 1, 0.95, 1.0) if upper else 0.98
    alpha = np.clip((length - 0.10 * corner**2 - y) * height / 2, 0, 1)
    gap = 1 - 0.38 * np.clip((np.abs(across) - 0.80) / 0.20, 0, 1) ** 2
    shade = gap * (0.90 + 0.10 * np.sqrt(np.clip(1 - across**2, 0, 1)))
    shade *= (0.97 - 0.75 * (np.abs(x) / half) ** 2) * (0.82 + 0.18 * y)
    colour = shade[..., None] * (255, 252, 242)
    gum = np.clip((0.16 + 0.10 * corner - y) / 0.05, 0, 1)[..., None]
    colour = colour * (1 - gum) + gum * (186, 104, 104)
    picture = np.dstack([colour, alpha * 255])
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.7), 0, 255).astype(np.uint8)


def rgba(image: Image) -> Image:
    """RGB (h, w, 3) as opaque RGBA."""
    alpha = np.full((*image.shape[:2], 1), 255, np.uint8)
    return np.ascontiguousarray(np.concatenate([image, alpha], axis=2))
