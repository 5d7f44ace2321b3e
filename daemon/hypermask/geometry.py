"""Rigid transforms, pinhole and fisheye lenses. Units: metres, radians, seconds, pixels.

Frames
------
camera    OpenCV's: origin in the optical centre, x right, y down, z along the line of sight.
mask      origin in the centre of the four corner LEDs, x to the right as the audience sees it,
          y up, z out of the face towards the audience.
A mask that faces the camera upright has `camera_from_mask` rotation `FACING` = diag(1, -1, -1).
Attitudes (roll, pitch, yaw) are the rotation that remains after `FACING` is taken away.
Image points have the origin in the centre of the top left pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

FACING: Array = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Pose:
    """A rigid transform `x_to = rotation @ x_from + translation`.

    rotation: (3, 3); translation: (3,) metres.
    """

    rotation: Array
    translation: Array

    def apply(self, points: ArrayLike) -> Array:
        """Transform points (..., 3)."""
        return np.asarray(points, float) @ self.rotation.T + self.translation

    def compose(self, first: Pose) -> Pose:
        """The transform that applies `first`, then this one."""
        return Pose(
            self.rotation @ first.rotation, self.rotation @ first.translation + self.translation
        )

    def inverse(self) -> Pose:
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def matrix(self) -> Array:
        """(3, 4) matrix [R | t]."""
        return np.column_stack([self.rotation, self.translation])

    @staticmethod
    def identity() -> Pose:
        return Pose(np.eye(3), np.zeros(3))


@dataclass(frozen=True)
class Pinhole:
    """A camera or projector without distortion: K (3, 3), size (width, height) in pixels."""

    matrix: Array
    size: tuple[int, int]

    @staticmethod
    def from_focal(
        focal_px: float, centre_px: tuple[float, float], size: tuple[int, int]
    ) -> Pinhole:
        cx, cy = centre_px
        return Pinhole(np.array([[focal_px, 0, cx], [0, focal_px, cy], [0, 0, 1.0]]), size)

    def project(self, points: ArrayLike) -> Array:
        """Image points (..., 2) of points (..., 3) in the camera frame."""
        image = np.asarray(points, float) @ self.matrix.T
        projected: Array = image[..., :2] / image[..., 2:]
        return projected


@dataclass(frozen=True)
class Fisheye:
    """A fisheye lens: K (3, 3), coefficients k (4,) of Kannala and Brandt (2006) as in
    `cv2.fisheye`, size (width, height) in pixels.

    Light at the angle a from the axis goes a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) focal lengths
    from the principal point; a may be 90 degrees and more.
    """

    matrix: Array
    k: Array
    size: tuple[int, int]

    def project(self, points: ArrayLike) -> Array:
        """Image points (..., 2) of points (..., 3) in the lens's frame."""
        seen = np.asarray(points, float)
        across = np.hypot(seen[..., 0], seen[..., 1])
        angle = np.arctan2(across, seen[..., 2])
        square = angle * angle
        radius = angle * (1 + square * np.polynomial.polynomial.polyval(square, self.k))
        # On the axis itself radius and across are both 0.
        spot = seen[..., :2] * (radius / np.maximum(across, 1e-15))[..., None]
        image: Array = spot * np.diag(self.matrix)[:2] + self.matrix[:2, 2]
        return image


def rotation_from_vector(vector: ArrayLike) -> Array:
    """Rotation matrix (3, 3) of a rotation vector (3,) in radians (Rodrigues)."""
    x, y, z = np.asarray(vector, float).reshape(3).tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0:
        return np.eye(3)
    x, y, z = x / angle, y / angle, z / angle
    c, s = math.cos(angle), math.sin(angle)
    v = 1 - c
    return np.array(
        [
            [c + v * x * x, v * x * y - s * z, v * x * z + s * y],
            [v * x * y + s * z, c + v * y * y, v * y * z - s * x],
            [v * x * z - s * y, v * y * z + s * x, c + v * z * z],
        ]
    )


def vector_from_rotation(rotation: ArrayLike) -> Array:
    """Rotation vector (3,) in radians of a rotation matrix (3, 3), angle at most pi."""
    import cv2  # not above: half of a process's start, and most processes never need it

    return np.asarray(cv2.Rodrigues(np.asarray(rotation, float))[0], float).reshape(3)


def rotation_from_attitude(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation (3, 3) R = Ry(yaw) Rx(pitch) Rz(roll), radians, in axes x right, y up, z out.

    Positive yaw turns the nose to the audience's right, positive pitch turns it down, positive
    roll turns the head anti-clockwise as the audience sees it.
    """
    return (
        rotation_from_vector([0, yaw, 0])
        @ rotation_from_vector([pitch, 0, 0])
        @ rotation_from_vector([0, 0, roll])
    )


def attitude_from_rotation(rotation: ArrayLike) -> tuple[float, float, float]:
    """(roll, pitch, yaw) in radians; inverse of `rotation_from_attitude`."""
    r = np.asarray(rotation, float)
    pitch = float(np.arcsin(np.clip(-r[1, 2], -1, 1)))
    yaw = float(np.arctan2(r[0, 2], r[2, 2]))
    roll = float(np.arctan2(r[1, 0], r[1, 1]))
    return roll, pitch, yaw


def homogeneous_apply(matrix: ArrayLike, points: ArrayLike) -> Array:
    """Apply a projective map (m, n+1) to points (..., n); the last coordinate is divided out."""
    pts = np.asarray(points, float)
    mat = np.asarray(matrix, float)
    out = pts @ mat[:, :-1].T + mat[:, -1]
    applied: Array = out[..., :-1] / out[..., -1:]
    return applied
