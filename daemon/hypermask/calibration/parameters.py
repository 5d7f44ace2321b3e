"""The calibrated projector, its nine free parameters, and their derivatives.

Parameters, in this order: focal length (px), principal point x and y (px; free because of lens
shift), a small rotation vector (rad) multiplied from the left on to the rotation of
`projector_from_camera`, and its translation (m). Pixels' aspect ratio is fixed; no distortion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hypermask.geometry import (
    Array,
    Pinhole,
    Pose,
    rotation_from_attitude,
    rotation_from_vector,
    vector_from_rotation,
)

PARAMETERS = 9


@dataclass(frozen=True)
class ProCam:
    """A projector seen from the camera: its pinhole and `projector_from_camera`."""

    projector: Pinhole
    projector_from_camera: Pose

    def projector_from_mask(self, camera_from_mask: Pose) -> Array:
        """(3, 4) K [R | t] from mask metres to projector pixels."""
        matrix: Array = (
            self.projector.matrix @ self.projector_from_camera.compose(camera_from_mask).matrix()
        )
        return matrix

    def project(self, points: ArrayLike) -> Array:
        """Projector pixels (..., 2) of points (..., 3) in the camera frame."""
        return self.projector.project(self.projector_from_camera.apply(points))

    @property
    def baseline_m(self) -> float:
        """Distance of the projector from the camera, across the camera's line of sight."""
        return float(np.linalg.norm(self.projector_from_camera.inverse().translation[:2]))


@dataclass(frozen=True)
class ProjectorPrior:
    """How far the nominal projector may be off, one sigma."""

    focal_fraction: float = 0.05
    centre_fraction: float = 0.03  # of the picture's width
    rotation_rad: float = 0.05
    translation_m: float = 0.02

    def information(self, nominal: ProCam) -> Array:
        """(9, 9) inverse covariance of the parameters."""
        focal = self.focal_fraction * nominal.projector.matrix[0, 0]
        centre = self.centre_fraction * nominal.projector.size[0]
        sigmas = [focal, centre, centre, *[self.rotation_rad] * 3, *[self.translation_m] * 3]
        return np.diag(np.array(sigmas) ** -2.0)


def nominal_procam(
    size: tuple[int, int],
    throw_ratio: float,
    lens_shift: tuple[float, float] = (0.0, 0.0),
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    attitude_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> ProCam:
    """What a data sheet and a tape measure know of the projector, the start of a calibration.

    size: picture (width, height) in px. throw_ratio: distance over width of the picture.
    lens_shift: how far the axis lies right of and below the picture's centre, in widths and
    heights ((0, 0.5) = at the lower edge). position_m: of the projector in the camera frame.
    attitude_deg: roll, pitch, yaw of the camera frame as the projector sees it.
    """
    width, height = size
    centre = ((width - 1) / 2 + lens_shift[0] * width, (height - 1) / 2 + lens_shift[1] * height)
    rotation = rotation_from_attitude(*np.radians(attitude_deg))
    pinhole = Pinhole.from_focal(throw_ratio * width, centre, size)
    return ProCam(pinhole, Pose(rotation, -rotation @ np.array(position_m)))


def updated(procam: ProCam, step: Array) -> ProCam:
    """`procam` moved by `step` (9,) in its parameters."""
    aspect = procam.projector.matrix[1, 1] / procam.projector.matrix[0, 0]
    focal = procam.projector.matrix[0, 0] + step[0]
    matrix = procam.projector.matrix.copy()
    matrix[0, 0], matrix[1, 1] = focal, focal * aspect
    matrix[:2, 2] += step[1:3]
    pose = procam.projector_from_camera
    moved = Pose(rotation_from_vector(step[3:6]) @ pose.rotation, pose.translation + step[6:])
    return ProCam(Pinhole(matrix, procam.projector.size), moved)


def difference(procam: ProCam, reference: ProCam) -> Array:
    """The parameters (9,) that lead from `reference` to `procam`."""
    matrix, other = procam.projector.matrix, reference.projector.matrix
    here, there = procam.projector_from_camera, reference.projector_from_camera
    turn = vector_from_rotation(here.rotation @ there.rotation.T)
    return np.concatenate(
        [
            [matrix[0, 0] - other[0, 0]],
            matrix[:2, 2] - other[:2, 2],
            turn,
            here.translation - there.translation,
        ]
    )


def parameter_jacobian(procam: ProCam, points: Array) -> Array:
    """(n, 2, 9) derivatives of the pixels of `points` (n, 3) in the camera frame."""
    turned = points @ procam.projector_from_camera.rotation.T
    seen = turned + procam.projector_from_camera.translation
    by_point = _pixel_by_point(procam.projector.matrix, seen)
    aspect = procam.projector.matrix[1, 1] / procam.projector.matrix[0, 0]
    jacobian = np.zeros((len(points), 2, PARAMETERS))
    jacobian[:, 0, 0] = seen[:, 0] / seen[:, 2]
    jacobian[:, 1, 0] = aspect * seen[:, 1] / seen[:, 2]
    jacobian[:, 0, 1] = jacobian[:, 1, 2] = 1.0
    jacobian[:, :, 3:6] = by_point @ -skew(turned)
    jacobian[:, :, 6:] = by_point
    return jacobian


def point_jacobian(procam: ProCam, points: Array) -> Array:
    """(n, 2, 3) derivatives of the pixels by `points` (n, 3) in the camera frame, px/m."""
    seen = procam.projector_from_camera.apply(points)
    by_point = _pixel_by_point(procam.projector.matrix, seen)
    jacobian: Array = by_point @ procam.projector_from_camera.rotation
    return jacobian


def pose_jacobian(procam: ProCam, camera_from_mask: Pose, leds: Array) -> Array:
    """(n, 2, 6) derivatives by the mask's pose: small left rotation first, then translation."""
    turned = leds @ camera_from_mask.rotation.T
    motion = np.concatenate([-skew(turned), np.broadcast_to(np.eye(3), (len(leds), 3, 3))], axis=2)
    jacobian: Array = point_jacobian(procam, camera_from_mask.apply(leds)) @ motion
    return jacobian


def skew(vectors: Array) -> Array:
    """(n, 3, 3) matrices S(v) with S(v) w = v x w."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    return np.moveaxis(rows, 2, 0)


def _pixel_by_point(matrix: Array, seen: Array) -> Array:
    x, y, z = seen.T
    fx, fy = matrix[0, 0], matrix[1, 1]
    zero = np.zeros_like(x)
    rows = np.array([[fx / z, zero, -fx * x / z**2], [zero, fy / z, -fy * y / z**2]])
    return np.moveaxis(rows, 2, 0)
