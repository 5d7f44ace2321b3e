"""The paper's calibration: four points, one map from the camera's to the projector's image.

The operator lays four projected points on the mask's four corner LEDs, which the camera sees
(PAPERS.md A1). No intrinsics enter the map; it is right near the distance at which it was made,
and `parallax` says how near.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from hypermask.calibration.parallax import Parallax, surface
from hypermask.errors import DataError
from hypermask.geometry import Array, Pose, homogeneous_apply
from hypermask.mask import Mask

Kind = Literal["affine", "projective"]
CORNERS = 4
TOLERANCE_M = 0.002


def projective(camera_points: Array, projector_points: Array) -> tuple[Array, float]:
    """H (3, 3) with h9 = 1 from four points, the paper's 8x8 system S h = z, and cond(S).

    camera_points, projector_points: (4, 2) pixels. Raises `DataError` CAL-PLANAR where three of
    the points lie on a line.
    """
    x, y = np.asarray(camera_points, float).T
    u, v = np.asarray(projector_points, float).T
    one, zero = np.ones(CORNERS), np.zeros(CORNERS)
    for_u = np.column_stack([x, y, one, zero, zero, zero, -u * x, -u * y])
    for_v = np.column_stack([zero, zero, zero, x, y, one, -v * x, -v * y])
    system = np.concatenate([for_u, for_v])
    condition = float(np.linalg.cond(system))
    if not np.isfinite(condition) or condition > 1e14 or _collinear(camera_points):
        raise _unsolvable()
    h = np.linalg.solve(system, np.concatenate([u, v]))
    return np.append(h, 1.0).reshape(3, 3), condition


def affine(camera_points: Array, projector_points: Array) -> tuple[Array, float]:
    """H = P C^T (C C^T)^-1 by least squares from four (or more) points, and cond(C C^T).

    P, C: (3, 4) homogeneous columns; H's last row is (0, 0, 1). Raises `DataError` CAL-PLANAR
    where all points lie on a line.
    """
    c = np.column_stack([camera_points, np.ones(len(camera_points))]).T
    p = np.column_stack([projector_points, np.ones(len(projector_points))]).T
    gram = c @ c.T
    condition = float(np.linalg.cond(gram))
    if not np.isfinite(condition) or condition > 1e14 or np.linalg.matrix_rank(c) < 3:
        raise _unsolvable()
    homography: Array = p @ c.T @ np.linalg.inv(gram)
    homography[2] = 0.0, 0.0, 1.0
    return homography, condition


def _collinear(points: Array) -> bool:
    """Whether three of the four points lie on a line (to a thousandth of their extent)."""
    pts = np.asarray(points, float)
    extent = float(np.max(np.ptp(pts, axis=0))) ** 2
    for left_out in range(CORNERS):
        a, b, c = np.delete(pts, left_out, axis=0)
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) <= 1e-3 * extent:
            return True
    return False


def _unsolvable() -> DataError:
    return DataError(
        "CAL-PLANAR",
        "the four points lie on a line or on one another",
        "Lay the four cross-hairs on the four corner LEDs, each on its own.",
    )


@dataclass(frozen=True)
class Planar:
    """homography: (3, 3) camera image -> projector image, made at `distance_m`; within
    `band_m` = (near, far) the distance adds at most the tolerance (2 mm) to its error.

    parallax: what the band follows from; condition: of the linear system that was solved.
    """

    homography: Array
    kind: Kind
    distance_m: float
    band_m: tuple[float, float]
    parallax: Parallax
    condition: float

    def expected_error_m(self, distance_m: float) -> float:
        """rms registration error to expect at another distance."""
        return self.parallax.error_m(distance_m)

    def projector_from_mask(self, points: Array, mask: Mask) -> Array:
        """(3, 4) map from mask metres to projector pixels; the column of z is zero.

        points: the LEDs in the camera image, (5, 2) or only the four corners. The four corner
        LEDs land on H(c); the rest of the mask's plane follows by the homography of those four.
        Raises `DataError` CAL-PLANAR where the corners are degenerate.
        """
        lit = homogeneous_apply(self.homography, np.asarray(points, float)[:CORNERS])
        plane, _ = projective(mask.leds[:CORNERS, :2] / _SCALE_M, lit)
        plane = plane @ np.diag([1 / _SCALE_M, 1 / _SCALE_M, 1.0])
        return np.column_stack([plane[:, :2], np.zeros(3), plane[:, 2]])


_SCALE_M = 0.1
"""Mask coordinates in decimetres: near 1, so that the 8x8 system is well conditioned."""


def calibrate(
    kind: Kind,
    camera_points: Array,
    projector_points: Array,
    camera_from_mask: Pose,
    projector_m: Array,
    mask: Mask,
    aim_m: float,
    tolerance_m: float = TOLERANCE_M,
) -> Planar:
    """The paper's calibration from the corner LEDs in the camera image and the aligned points.

    camera_points, projector_points: (4, 2) px; camera_from_mask: the mask's pose then;
    projector_m: (3,) the projector's place in the camera frame, from a tape measure; aim_m: the
    operator's error an axis on the mask, sigma. Raises `DataError` CAL-PLANAR.
    """
    solve = affine if kind == "affine" else projective
    homography, condition = solve(camera_points, projector_points)
    reach = (affine_reach if kind == "affine" else projective_reach)(mask)
    parallax = Parallax.of(camera_from_mask, projector_m, mask, reach * aim_m)
    distance = float(camera_from_mask.translation[2])
    return Planar(homography, kind, distance, parallax.band_m(tolerance_m), parallax, condition)


def affine_reach(mask: Mask) -> float:
    """rms error over the mask, both axes together, for an aim of sigma 1 an axis at the corners:
    the map is fitted to the corners, the mask reaches beyond them."""
    corners, points = mask.leds[:CORNERS, :2], surface(mask)[:, :2]
    design = np.column_stack([corners, np.ones(CORNERS)])
    rows = np.column_stack([points, np.ones(len(points))]) @ np.linalg.pinv(design)
    return float(np.sqrt(2 * np.mean(np.sum(rows**2, axis=1))))


def projective_reach(mask: Mask) -> float:
    """As `affine_reach`, for the projective form: finite differences of the 8x8 system."""
    corners, points = mask.leds[:CORNERS, :2], surface(mask)[:, :2]
    step, squares = 1e-4, np.zeros(len(points))
    for corner, axis in np.ndindex(CORNERS, 2):
        moved = corners.copy()
        moved[corner, axis] += step
        plane, _ = projective(corners / _SCALE_M, moved / _SCALE_M)
        shift = homogeneous_apply(plane, points / _SCALE_M) * _SCALE_M - points
        squares += np.sum((shift / step) ** 2, axis=1)
    return float(np.sqrt(np.mean(squares)))
