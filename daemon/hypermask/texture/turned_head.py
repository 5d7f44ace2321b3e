"""A photograph as it would look with the head turned: the ground truth for turned photographs.

The frontal photograph is laid on an analytic head (an ellipsoid with nose, eye sockets, lips, chin
and neck of usual human size, placed by a few landmarks in the picture plane) and seen by a camera
with perspective. Its proportions are set so that the average is near people's, as the landmark
model sees them on frontal photographs. Otherwise nothing of it is shared with the way back
(`hypermask.texture.pose`): no person's depth by the landmark model, no mesh, another projection.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Map = NDArray[np.float32]

PUPILS_MM = 63.0
_DISTANCE_MM = 1500.0
"""Of the camera from the eyes."""
_AXIS_MM = 70.0
"""The head turns about a point so far behind the eyes."""
_DEPTH_MM = 106.0
_FULLER = 1.05
_WALL_MM = -150.0
_NEAR_MM, _FAR_MM = 60.0, -160.0
_STEPS = 56
_HALVINGS = 7
_CORNERS = {"root": 168, "tip": 4, "base": 2, "wing_left": 129, "wing_right": 358}
_LIPS, _CHIN, _SIDES = (61, 291, 0, 17), 152, (234, 454)
_INNER, _CHEEKS = (133, 362), (50, 280)


@dataclass(frozen=True)
class Head:
    """height: (h, w) mm towards the camera, 0 at the pupils' plane, of each pixel of `photo`."""

    photo: Image
    height: Map
    scale: float
    centre: Array

    def turned(self, yaw_deg: float, pitch_deg: float = 0.0) -> Image:
        """The photograph (h, w, 3) with the head turned; yaw > 0 to the picture's right,
        pitch > 0 upwards.
        """
        rotation = _rotation(np.radians(yaw_deg), np.radians(pitch_deg))
        size = self.photo.shape[1], self.photo.shape[0]
        small = tuple(n // 2 for n in size)
        origin, rays = self._rays(small, 2.0, rotation)
        low, high = self._march(origin, rays)
        low, high = (np.asarray(cv2.resize(t, size), np.float32) for t in (low, high))
        origin, rays = self._rays(size, 1.0, rotation)
        margin = np.float32(1.5 * (_NEAR_MM - _FAR_MM) / _STEPS)
        low, high = low - margin, high + margin
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            below = self._below(origin, rays, middle)
            low, high = np.where(below, low, middle), np.where(below, middle, high)
        x, y = self._place(origin, rays, (low + high) / 2)
        seen = cv2.remap(self.photo, x, y, cv2.INTER_CUBIC, None, cv2.BORDER_REPLICATE)
        return np.asarray(seen, np.uint8)

    def project(self, places: Array, yaw_deg: float, pitch_deg: float = 0.0) -> Array:
        """(n, 2) pixels of the turned photograph where places (n, 2) of the frontal one are."""
        flat = np.asarray(places[:, :2], np.float32)
        height = cv2.remap(self.height, flat[:, :1], flat[:, 1:], cv2.INTER_LINEAR)
        frontal = np.column_stack([(places[:, :2] - self.centre) / self.scale, height])
        axis = np.array([0.0, 0.0, -_AXIS_MM])
        rotation = _rotation(np.radians(yaw_deg), np.radians(pitch_deg))
        turned = (frontal - axis) @ rotation.T + axis
        nearer = _DISTANCE_MM / (_DISTANCE_MM - turned[:, 2:])
        return np.asarray(turned[:, :2] * nearer * self.scale + self.centre)

    def _rays(self, size: tuple[int, int], step: float, rotation: Array) -> tuple[Array, Map]:
        """(the camera's place, a direction for each pixel) in the frontal head's frame, mm."""
        xs, ys = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
        x = ((xs + 0.5) * step - 0.5 - self.centre[0]) / self.scale
        y = ((ys + 0.5) * step - 0.5 - self.centre[1]) / self.scale
        towards = np.stack([x, y, np.full(x.shape, -_DISTANCE_MM)], -1)
        axis = np.array([0.0, 0.0, -_AXIS_MM])
        origin = rotation.T @ (np.array([0.0, 0.0, _DISTANCE_MM]) - axis) + axis
        return origin, np.asarray(towards @ rotation / _DISTANCE_MM, np.float32)

    def _march(self, origin: Array, rays: Map) -> tuple[Map, Map]:
        """Distances before and after the first crossing of each ray with the surface."""
        steps = np.linspace(_DISTANCE_MM - _NEAR_MM, _DISTANCE_MM - _FAR_MM, _STEPS)
        before = np.full(rays.shape[:2], steps[0], np.float32)
        after = np.full(rays.shape[:2], steps[-1], np.float32)
        found = np.zeros(rays.shape[:2], bool)
        for step, last in zip(steps[1:], steps[:-1], strict=True):
            below = self._below(origin, rays, np.float32(step)) & ~found
            before[below], after[below] = last, step
            found |= below
        before[~found] = steps[-2]
        return before, after

    def _below(
        self, origin: Array, rays: Map, distance: NDArray[Any] | np.float32
    ) -> NDArray[np.bool_]:
        x, y = self._place(origin, rays, distance)
        height = cv2.remap(self.height, x, y, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
        return np.asarray(origin[2] + rays[..., 2] * distance < height)

    def _place(
        self, origin: Array, rays: Map, distance: NDArray[Any] | np.float32
    ) -> tuple[Map, Map]:
        x = (origin[0] + rays[..., 0] * distance) * self.scale + self.centre[0]
        y = (origin[1] + rays[..., 1] * distance) * self.scale + self.centre[1]
        return x.astype(np.float32), y.astype(np.float32)


def _rotation(yaw: float, pitch: float) -> Array:
    """Frame: x right, y down, z to the camera."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    c, s = np.cos(pitch), np.sin(pitch)
    nod = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return np.asarray(nod @ turn)


def head(photo: Image, landmarks: Array, pupils: Array) -> Head:
    """The head for a frontal photograph (h, w, 3), its landmarks (468, 2 or more) and pupils."""
    scale = float(np.hypot(*(pupils[1] - pupils[0]))) / PUPILS_MM
    centre = pupils.mean(axis=0)
    xs, ys = np.meshgrid(np.arange(photo.shape[1]), np.arange(photo.shape[0]))
    x, y = (xs - centre[0]) / scale, (ys - centre[1]) / scale
    places = (landmarks[:, :2] - centre) / scale
    eyes = (pupils - centre) / scale
    half_width = float(places[_SIDES[1], 0] - places[_SIDES[0], 0]) / 2
    height = _skull(x, y, half_width) + _nose(x, y, places) + _details(x, y, places, eyes)
    return Head(photo, height.astype(np.float32), scale, centre)


def _skull(x: Array, y: Array, half_width: float) -> Array:
    """Face and, further back, skull and neck, before a far wall."""
    along = np.where(y < 0, np.abs(y / 118) ** 2.4, np.abs(y / 142) ** 6)
    face = _dome(1 - (x / (_FULLER * half_width)) ** 2 - along, _DEPTH_MM)
    skull = _dome(1 - (x / 88) ** 2 - ((y + 10) / 125) ** 2, 95) - 45
    neck = _dome(np.where(y > 60, 1 - (x / 62) ** 2, -1), 55) - 70
    return np.asarray(np.maximum(np.maximum(face, skull), np.maximum(neck, _WALL_MM)))


def _dome(square: Array, depth: float) -> Array:
    """0 in the middle, -depth at the edge, far behind outside."""
    inside = depth * np.sqrt(np.maximum(square, 0)) - depth
    return np.asarray(np.where(square > 0, inside, 10 * _WALL_MM))


def _bump(x: Array, y: Array, middle: Array, wide: float, tall: float, height: float) -> Array:
    away = ((x - middle[0]) / wide) ** 2 + ((y - middle[1]) / tall) ** 2
    return np.asarray(height * np.exp(-away))


def _nose(x: Array, y: Array, places: Array) -> Array:
    root, tip, base, left, right = (places[i] for i in _CORNERS.values())
    along = np.clip((y - root[1]) / (tip[1] - root[1]), 0, 1)
    middle = root[0] + (tip[0] - root[0]) * along
    rise = 3 + 22 * along**1.3
    above = np.exp(-((np.minimum(y - root[1], 0) / 12) ** 2))
    below = np.exp(-((np.maximum(y - tip[1], 0) / (0.9 * (base[1] - tip[1]) + 1)) ** 2))
    wide = 8 + 0.16 * (right[0] - left[0]) * along
    ridge = rise * above * below * np.exp(-(((x - middle) / wide) ** 2))
    wings = [_bump(x, y, wing, 5.5, 7, 5) for wing in (left * (0.85, 1), right * (0.85, 1))]
    return np.asarray(np.maximum(ridge, np.max(wings, axis=0)))


def _details(x: Array, y: Array, places: Array, eyes: Array) -> Array:
    """Eye sockets, deepest at the inner corners, eyeballs, cheeks, lips, hollows beside, chin."""
    parts = [_bump(x, y, eye, 17, 11, -6) + _bump(x, y, eye, 9, 7, 4) for eye in eyes]
    parts += [_bump(x, y, places[i], 8, 9, -9) for i in _INNER]
    parts += [_bump(x, y, places[i], 20, 20, 8) for i in _CHEEKS]
    left, right, upper, lower = (places[i] for i in _LIPS)
    middle, wide = (upper + lower) / 2, 0.45 * (right[0] - left[0])
    parts.append(_bump(x, y, middle, wide, 0.6 * (lower[1] - upper[1]) + 6, 8))
    parts += [_bump(x, y, corner, 9, 9, -5) for corner in (left, right)]
    parts.append(_bump(x, y, places[_CHIN] - (0, 12), 18, 14, 8))
    return np.asarray(np.sum(parts, axis=0))
