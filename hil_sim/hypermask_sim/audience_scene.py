"""What stands on the simulated stage: the mask, a hooded figure in dark cloth, curtain and floor.

Meshes are float32 arrays in metres. Stage axes: x to the audience's right, y up, z to the audience.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.mask import Mask

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

TEXELS_PER_M = 2000
MESH_STEP = 5  # of the relief's grid cells
CURTAIN_SIZE_M = (7.0, 4.2)
CURTAIN_PIXELS = (1792, 1075)
FLOOR_DEPTH_M = 4.0


@dataclass(frozen=True)
class Mesh:
    """vertices: (V, 6) position and normal, (V, 5) position and uv, or (V, 3); triangles (T, 3)."""

    vertices: Float32
    triangles: NDArray[np.int32]


def _grid_triangles(rows: int, columns: int) -> NDArray[np.int32]:
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    first, second = np.stack([a, c, b], -1), np.stack([b, c, d], -1)
    return np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])


def _smooth_mesh(points: Array) -> Mesh:
    """A (rows, columns, 3) sheet with its normals; anti-clockwise seen from outside."""
    along, across = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normals = np.cross(along, across)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    vertices = np.concatenate([points, normals], axis=-1).reshape(-1, 6).astype(np.float32)
    return Mesh(vertices, _grid_triangles(*points.shape[:2]))


def mask_mesh(mask: Mask, within: float = 1 / 0.95) -> Mesh:
    """The relief inside the outline scaled by `within`; position only, (V, 3)."""
    half_width, half_height = mask.half_size_m
    columns = round(2 * half_width / mask.settings.relief.spacing_m / MESH_STEP) + 1
    rows = round(2 * half_height / mask.settings.relief.spacing_m / MESH_STEP) + 1
    x, y = np.meshgrid(
        np.linspace(-half_width, half_width, columns), np.linspace(half_height, -half_height, rows)
    )
    points = np.stack([x, y, mask.height(x, y)], axis=-1).reshape(-1, 3)
    kept = mask.inside(x / within, y / within).ravel()
    triangles = _grid_triangles(rows, columns)
    return Mesh(points.astype(np.float32), triangles[kept[triangles].all(axis=1)])


def skin(mask: Mask) -> NDArray[np.uint8]:
    """(height, width, 4) over the relief's rectangle: normal x, y, tone, place in the outline.

    The tone is the white paint's, darker in hollows; the last band falls from 255 in the middle to
    64 on the outline, as smooth as the outline is.
    """
    half_width, half_height = mask.half_size_m
    size = (round(2 * half_width * TEXELS_PER_M), round(2 * half_height * TEXELS_PER_M))
    x = ((np.arange(size[0]) + 0.5) / size[0] * 2 - 1) * half_width
    y = (1 - (np.arange(size[1]) + 0.5) / size[1] * 2) * half_height
    xs, ys = np.meshgrid(x, y)
    z = cv2.GaussianBlur(mask.height(xs, ys), (0, 0), 2.0)
    down, along = np.gradient(z, 2 * half_height / size[1], 2 * half_width / size[0])
    normals = np.stack([-along, down, np.ones_like(z)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    hollow = cv2.GaussianBlur(z, (0, 0), 22.0) - z
    tone = np.clip(0.85 - hollow * 45, 0.25, 1)
    for led_x, led_y in mask.leds[:, :2]:
        tone *= 1 - 0.55 * _disc(xs, ys, led_x, led_y, 0.0025)
    for hole in mask.settings.eye_holes:
        for dx, dy in ((0, 0), (-3, 0), (3, 0), (-1.5, 2.6), (1.5, 2.6), (-1.5, -2.6), (1.5, -2.6)):
            tone *= 1 - 0.95 * _disc(
                xs, ys, hole.centre_m[0] + dx * 1e-3, hole.centre_m[1] + dy * 1e-3, 0.00075
            )
    outline = mask.settings.outline
    powers = np.abs(xs / outline.half_width_m) ** outline.exponent
    powers += np.abs(ys / outline.half_height_m) ** outline.exponent
    inside = np.clip((1 - powers) * 1.5 + 0.25, 0, 1)
    bands = [normals[..., 0] * 0.5 + 0.5, normals[..., 1] * 0.5 + 0.5, tone, inside]
    return np.round(np.stack(bands, axis=-1) * 255).astype(np.uint8)


def _disc(x: Array, y: Array, cx: float, cy: float, radius: float) -> Array:
    return np.asarray(np.clip((radius - np.hypot(x - cx, y - cy)) * TEXELS_PER_M + 0.5, 0, 1))


def mask_rim(mask: Mask, depth_m: float = 0.030) -> Mesh:
    """The mask's side: its outline drawn back towards the head."""
    outline = mask.settings.outline
    angle = np.linspace(0, 2 * np.pi, 145)
    power = 2 / outline.exponent
    cos, sin = np.cos(angle), np.sin(angle)
    x = outline.half_width_m * np.sign(cos) * np.abs(cos) ** power
    y = outline.half_height_m * np.sign(sin) * np.abs(sin) ** power
    front = np.stack([x, y, mask.height(x, y)], axis=-1) * [0.998, 0.998, 1]
    back = front * [0.94, 0.95, 1] - [0, 0, depth_m]
    return _smooth_mesh(np.stack([front, back]))


def hood(mask: Mask) -> Mesh:
    """A cloth hood round the head, in the mask frame; flat in front, where the mask sits."""
    outline = mask.settings.outline
    polar, turn = np.meshgrid(np.linspace(0, np.pi, 21), np.linspace(0, 2 * np.pi, 41))
    ring = np.sin(polar)
    x = (outline.half_width_m + 0.020) * ring * np.cos(turn)
    y = (outline.half_height_m + 0.026) * ring * np.sin(turn)
    across = np.cos(polar)
    z = np.where(across > 0, 0.045, 0.150) * across - 0.060
    crown = 1 + 0.05 * np.clip(y / outline.half_height_m, 0, 1) ** 2
    return _smooth_mesh(np.stack([x * crown, y * crown, z], axis=-1)[:, ::-1])


def cloak() -> Mesh:
    """A cowl that falls from the hood over shoulders and chest; origin at the neck, stage axes."""
    down = [-0.05, 0.0, 0.03, 0.06, 0.10, 0.14, 0.19, 0.26, 0.36, 0.50, 0.80]
    wide = [0.098, 0.104, 0.118, 0.146, 0.188, 0.216, 0.232, 0.243, 0.250, 0.262, 0.290]
    deep = [0.060, 0.066, 0.072, 0.080, 0.094, 0.110, 0.124, 0.136, 0.150, 0.165, 0.200]
    drop = np.linspace(-0.05, 0.8, 35)
    angle = np.linspace(0, 2 * np.pi, 81)
    width = cv2.GaussianBlur(np.interp(drop, down, wide)[None], (5, 1), 1.0)[0]
    depth = cv2.GaussianBlur(np.interp(drop, down, deep)[None], (5, 1), 1.0)[0]
    grown = np.clip((drop + 0.05) / 0.35, 0, 1)
    fold = 0.055 * np.sin(8 * angle + 0.8 * np.sin(angle)) + 0.025 * np.sin(19 * angle + 1.3)
    stretch = (
        1 + np.outer(grown, fold) + 0.012 * np.sin(drop / 0.021)[:, None] * (1 - grown)[:, None]
    )
    x = width[:, None] * np.cos(angle) * stretch
    z = depth[:, None] * np.sin(angle) * stretch - 0.01
    y = np.broadcast_to(-drop[:, None], x.shape)
    return _smooth_mesh(np.stack([x, y, z], axis=-1)[:, ::-1])


def shell(mask: Mask) -> Mesh:
    """A Mask-bot's head behind its screen, which holds the projector; in the mask frame."""
    outline = mask.settings.outline
    polar, turn = np.meshgrid(np.linspace(0, np.pi, 25), np.linspace(0, 2 * np.pi, 49))
    ring = np.sin(polar) ** 0.8
    x = (outline.half_width_m + 0.012) * ring * np.cos(turn)
    y = (outline.half_height_m + 0.012) * ring * np.sin(turn)
    across = np.cos(polar)
    z = np.where(across > 0, 0.012, 0.165) * across - 0.022
    return _smooth_mesh(np.stack([x, y, z], axis=-1)[:, ::-1])


def pedestal() -> Mesh:
    """What carries a Mask-bot's head: unit, collar, pole and foot; origin at the unit's axes."""
    down = [-0.045, -0.045, 0.0, 0.045, 0.05, 0.055, 0.075, 0.08, 0.085, 0.6, 0.62, 0.66, 0.67]
    wide = [0.0, 0.040, 0.052, 0.052, 0.050, 0.066, 0.066, 0.060, 0.024, 0.024, 0.10, 0.16, 0.17]
    angle = np.linspace(0, 2 * np.pi, 65)
    x = np.outer(wide, np.cos(angle))
    z = np.outer(wide, np.sin(angle))
    y = np.broadcast_to(-np.array(down)[:, None], x.shape)
    return _smooth_mesh(np.stack([x, y, z], axis=-1)[:, ::-1])


def curtain_mesh() -> Mesh:
    """Upright, its lower edge in the middle of the floor's far edge at the origin."""
    width, height = CURTAIN_SIZE_M
    corners = [[-0.5, 0, 0, 0, 1], [0.5, 0, 0, 1, 1], [-0.5, 1, 0, 0, 0], [0.5, 1, 0, 1, 0]]
    vertices = np.array(corners) * [width, height, 1, 1, 1]
    return Mesh(vertices.astype(np.float32), np.array([[0, 1, 2], [2, 1, 3]], np.int32))


def floor_mesh() -> Mesh:
    """From the curtain's lower edge towards the audience."""
    width, depth = CURTAIN_SIZE_M[0], FLOOR_DEPTH_M
    corners = [[-0.5, 0, 0, 0, 0], [0.5, 0, 0, 1, 0], [-0.5, 0, 1, 0, 1], [0.5, 0, 1, 1, 1]]
    vertices = np.array(corners) * [width, 1, depth, 1, 1]
    return Mesh(vertices.astype(np.float32), np.array([[0, 2, 1], [2, 3, 1]], np.int32))


def paint_curtain() -> NDArray[np.uint8]:
    """(height, width, 3) RGB, gamma 2: velvet in heavy folds, a pool of light from above."""
    columns, rows = CURTAIN_PIXELS
    rng = np.random.default_rng(7)
    x = np.linspace(0, 1, columns)[None, :] * CURTAIN_SIZE_M[0]
    y = np.linspace(1, 0, rows)[:, None] * CURTAIN_SIZE_M[1]
    sway = 0.02 * np.sin(1.3 * y + 0.7) + 0.008 * np.sin(4.1 * y)
    phase = (
        2 * np.pi * (x + sway) / 0.23 + 1.1 * np.sin(2 * np.pi * x / 1.1) + 0.5 * np.sin(5.3 * x)
    )
    fold = 0.5 + 0.5 * np.sin(phase + 0.7 * np.sin(phase))
    fine = 0.5 + 0.5 * np.sin(2.7 * phase + 1.0)
    cloth = 0.10 + 0.75 * fold**1.7 + 0.15 * fine * fold
    middle = CURTAIN_SIZE_M[0] / 2
    pool = np.exp(-(((x - middle + 0.25) / 1.15) ** 2) - ((y - 1.85) / 1.0) ** 2)
    light = (0.10 + pool) * cloth
    colour = light[..., None] * np.array([0.055, 0.0075, 0.011])
    colour += 0.0016 * np.array([0.6, 0.7, 1.2]) * (0.4 + fold[..., None])
    colour = cv2.GaussianBlur(colour, (0, 0), 2.2)
    noise = rng.uniform(-0.5, 0.5, colour.shape)
    painted = np.clip(np.sqrt(colour) * 255 + noise + 0.5, 0, 255)
    return np.asarray(painted, np.uint8)


def paint_floor() -> NDArray[np.uint8]:
    """(height, width, 3) RGB, gamma 2: dark boards that catch a little of the light."""
    columns, rows = 1024, 512
    x = np.linspace(0, 1, columns)[None, :] * CURTAIN_SIZE_M[0]
    z = np.linspace(0, 1, rows)[:, None] * FLOOR_DEPTH_M
    board = np.floor(x / 0.14)
    tone = 0.7 + 0.3 * np.sin(board * 12.9898) + 0.1 * np.sin(40 * z + board)
    gap = np.clip(np.abs(x / 0.14 - board - 0.5) * 2 - 0.94, 0, 1) / 0.06
    pool = np.exp(-(((x - CURTAIN_SIZE_M[0] / 2) / 1.2) ** 2) - ((z - 1.6) / 1.2) ** 2)
    light = (0.15 + pool) * tone * (1 - 0.8 * gap)
    colour = light[..., None] * np.array([0.018, 0.012, 0.009])
    return np.asarray(np.clip(np.sqrt(colour) * 255 + 0.5, 0, 255), np.uint8)
