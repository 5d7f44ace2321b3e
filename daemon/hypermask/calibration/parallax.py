"""Where a map between two images stops being right: the depth band of the planar calibration.

Camera and projector look along parallel axes; the projector stands at P, b = P's part across the
axis. The map is right for the mask's plane at depth Z0. The camera sees a point of the mask at
depth Z in the direction c; the map sends the light to where that direction meets the plane Z0,
along the projector's ray through (c Z0, Z0). At depth Z that ray is at b + (c Z0 - b) Z/Z0 and the
point at c Z: the light misses by -b u, with u = (Z - Z0)/Z0, whatever c is.

The map knows only the LEDs' plane. A point (x, y) of the surface at height h over it is lit by the
ray meant for the plane below, which runs in the direction d = R^T (C - P) + (x, y, 0) in mask axes
(C the mask's centre) and has shifted by l = h (d_x, d_y)/d_z when it meets the surface.

With b in mask axes, the mean m and the mean square q of l over the mask, and the aiming's own rms
error a, the mean squared error on the mask is

    e^2 = |b|^2 u^2 - 2 (b.m) u + q + a^2.

It is least at u = (b.m)/|b|^2, where relief and aiming are all that is left. The band is where the
distance adds no more than the tolerance t to that, e^2 <= e_least^2 + t^2: t Z0/|b| to either side,
27 mm for 2 mm at 2 m with 150 mm. For a mask proud by h all over, on the camera's axis,
l = b h/Z0: e = b |Z - Z0 - h|/Z0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hypermask.geometry import Array, Pose
from hypermask.mask import Mask


@dataclass(frozen=True)
class Parallax:
    """distance_m: Z0; baseline_m: b and lean_m: m, both (x, y) in mask axes; lean_rms_m: sqrt(q);
    aim_m: a."""

    distance_m: float
    baseline_m: tuple[float, float]
    lean_m: tuple[float, float]
    lean_rms_m: float
    aim_m: float

    @staticmethod
    def of(camera_from_mask: Pose, projector_m: Array, mask: Mask, aim_m: float) -> Parallax:
        """projector_m: (3,) the projector's place in the camera frame."""
        into_mask = camera_from_mask.rotation.T
        across = into_mask @ np.array([projector_m[0], projector_m[1], 0.0])
        points = surface(mask)
        rays = into_mask @ (camera_from_mask.translation - projector_m) + points * (1, 1, 0)
        leans = points[:, 2:] * rays[:, :2] / rays[:, 2:]
        mean = leans.mean(axis=0)
        return Parallax(
            float(camera_from_mask.translation[2]),
            (float(across[0]), float(across[1])),
            (float(mean[0]), float(mean[1])),
            float(np.sqrt(np.mean(np.sum(leans**2, axis=1)))),
            aim_m,
        )

    def error_m(self, distance_m: float) -> float:
        """rms error on the mask at a distance."""
        square, linear, constant = self._quadratic()
        u = distance_m / self.distance_m - 1
        return float(np.sqrt(max(square * u**2 + linear * u + constant, 0.0)))

    @property
    def least_error_m(self) -> float:
        """rms error at the best distance: what relief and aiming leave."""
        square, linear, constant = self._quadratic()
        best = constant - linear**2 / (4 * square) if square >= 1e-12 else constant
        return float(np.sqrt(max(best, 0.0)))

    def band_m(self, tolerance_m: float) -> tuple[float, float]:
        """(near, far) within which the distance adds at most the tolerance to the least error."""
        square, linear, _ = self._quadratic()
        if square < 1e-12:
            return 0.0, float("inf")
        best, half = -linear / (2 * square), tolerance_m / square**0.5
        return self.distance_m * (1 + best - half), self.distance_m * (1 + best + half)

    def _quadratic(self) -> tuple[float, float, float]:
        b, m = np.array(self.baseline_m), np.array(self.lean_m)
        return float(b @ b), float(-2 * (b @ m)), self.lean_rms_m**2 + self.aim_m**2


def surface(mask: Mask) -> Array:
    """Points (m, 3) of the relief inside the outline, evenly spread."""
    outline = mask.settings.outline
    x, y = np.meshgrid(
        np.linspace(-outline.half_width_m, outline.half_width_m, 41),
        np.linspace(-outline.half_height_m, outline.half_height_m, 55),
    )
    inside = mask.inside(x, y)
    x, y = x[inside], y[inside]
    return np.column_stack([x, y, mask.height(x, y)])
