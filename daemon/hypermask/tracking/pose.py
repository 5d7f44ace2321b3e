"""Pose of the mask from its LEDs' image points: Gauss-Newton on the reprojection error.

Small changes of a pose are six numbers (w, v): R' = exp(w) R, t' = t + v, w in radians in the
camera frame, v in metres. Covariances have the same order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.geometry import Array, Pinhole, Pose

if TYPE_CHECKING:
    from hypermask.tracking.motion import PredictedPose

POINT_SIGMA_PX = 0.05
"""Standard deviation of a centroid where the caller gives none."""

PRIOR_INFLATION = 9.0
"""The prediction's covariance is multiplied by this before it serves as a prior: it shall hold
what too few LEDs leave open, not smooth what the LEDs say (the motion filter does that, once)."""

_NO_TURN = np.zeros(3)
_ITERATIONS = 8
# Squared step (rad, m) after which the next would move no LED by 0.01 px: it is quadratic.
_CONVERGED = 1e-5


@dataclass(frozen=True)
class PoseEstimate:
    """pose: camera_from_mask; covariance: (6, 6), rotation first; rms_px: over the points used;
    residuals_px: distance of each point used from where the pose has it."""

    pose: Pose
    covariance: Array
    rms_px: float
    residuals_px: Array


def project_with_jacobian(
    rotation: Array, translation: Array, leds: Array, camera: Pinhole
) -> tuple[Array, Array]:
    """Image points (..., n, 2) and their derivative (..., n, 2, 6) by a small change of pose.

    rotation: (..., 3, 3); translation: (..., 3); leds: (n, 3) in the mask frame.
    """
    fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
    cx, cy = camera.matrix[0, 2], camera.matrix[1, 2]
    arm = leds @ rotation.swapaxes(-1, -2)
    qx, qy, qz = arm[..., 0], arm[..., 1], arm[..., 2]
    inverse_z = 1.0 / (qz + translation[..., 2, None])
    a = (qx + translation[..., 0, None]) * inverse_z
    b = (qy + translation[..., 1, None]) * inverse_z
    points = np.empty((*a.shape, 2))
    points[..., 0] = fx * a + cx
    points[..., 1] = fy * b + cy
    jacobian = np.empty((*a.shape, 2, 6))
    u, v = jacobian[..., 0, :], jacobian[..., 1, :]
    u[..., 0] = -a * qy
    u[..., 1] = qz + a * qx
    u[..., 2] = -qy
    u[..., 3] = 1.0
    u[..., 4] = 0.0
    u[..., 5] = -a
    v[..., 0] = -qz - b * qy
    v[..., 1] = b * qx
    v[..., 2] = qx
    v[..., 3] = 0.0
    v[..., 4] = 1.0
    v[..., 5] = -b
    u *= (fx * inverse_z)[..., None]
    v *= (fy * inverse_z)[..., None]
    return points, jacobian


def project_leds(pose: Pose, leds: Array, camera: Pinhole) -> tuple[Array, Array]:
    """Like `project_with_jacobian` for one pose: points (n, 2), derivative (2 n, 6).

    OpenCV does it in one call: its derivative by the rotation vector, taken at zero for points
    already turned, is the derivative by a small rotation.
    """
    arms = leds @ pose.rotation.T
    points, jacobian = cv2.projectPoints(arms, _NO_TURN, pose.translation, camera.matrix, None)
    return np.asarray(points, float).reshape(-1, 2), np.asarray(jacobian, float)[:, :6]


def small_rotation(w: NDArray[Any]) -> Array:
    """exp of the rotation vector w[:3], radians (Rodrigues), in plain floats: w is that small."""
    x, y, z = float(w[0]), float(w[1]), float(w[2])
    angle2 = x * x + y * y + z * z
    angle = math.sqrt(angle2)
    s, c = (math.sin(angle) / angle, (1 - math.cos(angle)) / angle2) if angle > 1e-6 else (1.0, 0.5)
    return np.array(
        [
            [1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
            [c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x],
            [c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)],
        ]
    )


def solve_pose(
    points: Array,
    leds: Array,
    camera: Pinhole,
    prior: PredictedPose | None,
    sigmas: Array | None = None,
) -> PoseEstimate | None:
    """Pose from the image points (5, 2) of the LEDs (5, 3), NaN where hidden.

    sigmas: (5,) standard deviation of each point in px, default `POINT_SIGMA_PX`.
    Without a prior: at least four points, SQPNP and refinement. With a prior: Gauss-Newton from
    the predicted pose; with fewer than five points the prediction's covariance takes part, so
    that three or two points give a pose. None when the points do not give one.
    """
    seen = ~np.isnan(points[:, 0])
    count = int(np.count_nonzero(seen))
    sigma = np.full(len(points), POINT_SIGMA_PX) if sigmas is None else sigmas
    if count < len(points):
        points, leds, sigma = points[seen], leds[seen], sigma[seen]
    weights = (1.0 / (sigma * sigma)).repeat(2)
    if prior is None:
        start = sqpnp(points, leds, camera) if count >= 4 else None
        return None if start is None else _refine(start, points, leds, camera, weights)
    if count == 0:
        return None
    information = None
    if count < 5:
        information = np.linalg.inv(PRIOR_INFLATION * prior.covariance)
    return _refine(prior.pose, points, leds, camera, weights, information)


def estimate_at(
    start: Pose, points: Array, leds: Array, camera: Pinhole, sigmas: Array
) -> PoseEstimate | None:
    """Pose by the points alone, from a start close to it; arguments as in `solve_pose`."""
    seen = ~np.isnan(points[:, 0])
    weights = (1.0 / np.square(sigmas[seen])).repeat(2)
    return _refine(start, points[seen], leds[seen], camera, weights)


def solve_all(
    start: Pose,
    projected: tuple[Array, Array],
    points: Array,
    leds: Array,
    camera: Pinhole,
    sigmas: Array,
) -> PoseEstimate | None:
    """Pose with every LED seen; `projected` is `project_leds` of the start, known already."""
    weights = (1.0 / (sigmas * sigmas)).repeat(2)
    return _refine(start, points, leds, camera, weights, None, projected)


def sqpnp(points: Array, leds: Array, camera: Pinhole) -> Pose | None:
    """Pose without a guess; None where OpenCV finds none in front of the camera."""
    try:
        found, rvec, tvec = cv2.solvePnP(
            leds, points, camera.matrix, None, flags=cv2.SOLVEPNP_SQPNP
        )
    except cv2.error:
        return None
    if not found or not np.isfinite(rvec).all() or tvec[2, 0] <= 0:
        return None
    return Pose(np.asarray(cv2.Rodrigues(rvec)[0], float), np.asarray(tvec, float).reshape(3))


def _refine(
    pose: Pose,
    points: Array,
    leds: Array,
    camera: Pinhole,
    weights: Array,
    information: NDArray[Any] | None = None,
    projected: tuple[Array, Array] | None = None,
) -> PoseEstimate | None:
    """Gauss-Newton from `pose`; with `information` (6, 6) that pose is also a measurement."""
    offset = np.zeros(6)  # from the start; small, so that rotation vectors may be added
    for _ in range(_ITERATIONS):
        place, jacobian = projected or project_leds(pose, leds, camera)
        projected = None
        residual = (points - place).reshape(-1)
        weighted = jacobian.T * weights
        normal = weighted @ jacobian
        gradient = weighted @ residual
        if information is not None:
            normal += information
            gradient -= information @ offset
        try:
            step = np.linalg.solve(normal, gradient)
        except np.linalg.LinAlgError:
            return None
        size2 = float(step @ step)
        if not size2 < 1.0:
            return None
        offset += step
        pose = Pose(small_rotation(step) @ pose.rotation, pose.translation + step[3:])
        if pose.translation[2] < 0.1:
            return None
        if size2 < _CONVERGED:
            break
    residual -= jacobian @ step  # exact enough: the last step was tiny
    squares = residual * residual
    residuals = np.sqrt(squares[0::2] + squares[1::2])
    rms = math.sqrt(float(squares.sum()) / len(points))
    return PoseEstimate(pose, np.asarray(np.linalg.inv(normal), float), rms, residuals)
