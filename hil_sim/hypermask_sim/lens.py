"""Lenses of simulated projectors: pinhole and fisheye, from points to pixels and back.

Points and rays are in the projector's frame: x right, y down, z along its axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TURNS = 30


class Lens(Protocol):
    def image(self, points: Array) -> Array:
        """Pixels (..., 2) of points (..., 3)."""
        ...

    def rays(self, pixels: Array) -> Array:
        """Directions (N, 3), of any length, of the light of pixels (N, 2)."""
        ...

    def density(self, points: Array) -> Array:
        """(...) pixels per steradian in the directions of points (..., 3)."""
        ...


@dataclass(frozen=True)
class PinholeLens:
    """K: (3, 3)."""

    K: Array

    def image(self, points: Array) -> Array:
        image = points @ np.asarray(self.K).T
        flat: Array = image[..., :2] / image[..., 2:]
        return flat

    def rays(self, pixels: Array) -> Array:
        homogeneous = np.column_stack([pixels, np.ones(len(pixels))])
        return np.asarray(np.linalg.solve(np.asarray(self.K), homogeneous.T).T)

    def density(self, points: Array) -> Array:
        length = np.sqrt(np.sum(points * points, axis=-1))
        return np.asarray(self.K[0, 0] * self.K[1, 1] * (length / points[..., 2]) ** 3)


@dataclass(frozen=True)
class FisheyeLens:
    """Kannala and Brandt (2006): at the angle a from the axis the light is
    a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) focal lengths from the principal point.

    decentring: Brown's two tangential terms of elements that are not quite on the axis.
    """

    K: Array
    k: tuple[float, float, float, float]
    decentring: tuple[float, float] = (0.0, 0.0)

    def image(self, points: Array) -> Array:
        across = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2)
        angle = np.arctan2(across, points[..., 2])
        scale = self._radius(angle) / np.maximum(across, 1e-15)
        spot = self._decentred(points[..., :2] * scale[..., None])
        pixels: Array = spot * [self.K[0, 0], self.K[1, 1]] + self.K[:2, 2]
        return pixels

    def rays(self, pixels: Array) -> Array:
        seen = (np.asarray(pixels) - self.K[:2, 2]) / [self.K[0, 0], self.K[1, 1]]
        spot = seen
        for _ in range(_TURNS):
            spot = spot - (self._decentred(spot) - seen)
        radius = np.sqrt(np.sum(spot * spot, axis=-1))
        angle = radius
        for _ in range(_TURNS):
            angle = angle - (self._radius(angle) - radius) / self._slope(angle)
        outwards = spot / np.maximum(radius, 1e-15)[..., None]
        return np.concatenate(
            [outwards * np.sin(angle)[..., None], np.cos(angle)[..., None]], axis=-1
        )

    def density(self, points: Array) -> Array:
        across = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2)
        angle = np.maximum(np.arctan2(across, points[..., 2]), 1e-6)
        spread = self._radius(angle) * self._slope(angle) / np.sin(angle)
        return np.asarray(self.K[0, 0] * self.K[1, 1] * spread)

    def _radius(self, angle: Array) -> Array:
        square = angle * angle
        series = 1 + square * (
            self.k[0] + square * (self.k[1] + square * (self.k[2] + square * self.k[3]))
        )
        return np.asarray(angle * series)

    def _slope(self, angle: Array) -> Array:
        square = angle * angle
        k1, k2, k3, k4 = self.k
        series = 1 + square * (3 * k1 + square * (5 * k2 + square * (7 * k3 + square * 9 * k4)))
        return np.asarray(series)

    def _decentred(self, spot: Array) -> Array:
        p1, p2 = self.decentring
        x, y = spot[..., 0], spot[..., 1]
        square = x * x + y * y
        shift = [
            2 * p1 * x * y + p2 * (square + 2 * x * x),
            p1 * (square + 2 * y * y) + 2 * p2 * x * y,
        ]
        return np.asarray(spot + np.stack(shift, axis=-1))


def lens_of(optics: Any) -> Lens:
    """The lens of a projector; a pinhole with its K when it names none."""
    lens: Lens | None = getattr(optics, "lens", None)
    return PinholeLens(np.asarray(optics.K)) if lens is None else lens


def projector_from_mask(world: Any, time_s: float) -> tuple[Array, Array]:
    """R (3, 3), t (3,) at a clock time; `world.mounted` says it for a projector that is fixed to
    its screen and moves with it."""
    mounted = getattr(world, "mounted", None)
    if mounted is not None:
        return mounted[0], mounted[1]
    rotation, translation = world.camera_from_mask(time_s)
    optics = world.projector
    return optics.R @ rotation, optics.R @ translation + np.asarray(optics.t).reshape(3)
