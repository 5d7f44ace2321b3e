"""Extended Kalman filter of a rigid pose under a `MotionModel`.

The pose is a rotation and a translation; the filter's states are small changes of it, so the
position states (a rotation vector in the camera frame, left-multiplied, and metres) are folded into
the pose after every correction, and any attitude and any number of turns is right.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hypermask.geometry import Array, Pose, rotation_from_vector, vector_from_rotation
from hypermask.tracking.motion_model import MotionModel

Record = NDArray[np.void]


def estimate_dtype(states: int) -> np.dtype[np.void]:
    """Layout of an estimate with `states` states on each of six axes."""
    return np.dtype(
        [
            ("rotation", np.float64, (3, 3)),
            ("translation", np.float64, (3,)),
            ("state", np.float64, (6, states)),  # [:, 0] is 0: it is in the pose
            ("covariance", np.float64, (6 * states, 6 * states)),
        ]
    )


def begin(estimate: Record, model: MotionModel, pose: Pose, covariance: Array) -> None:
    """Start at a measured pose with covariance (6, 6), at rest as likely as the model has it."""
    n = model.states
    estimate["rotation"], estimate["translation"] = pose.rotation, pose.translation
    estimate["state"] = 0
    spread = np.zeros((6, n, 6, n))
    spread[_EACH, :, _EACH, :] = model.initial
    spread[:, 0, :, 0] += covariance
    estimate["covariance"] = spread.reshape(6 * n, 6 * n)


def advance(estimate: Record, model: MotionModel, step_s: float, drive: Array) -> None:
    """Move the estimate `step_s` on; `drive` (6,) scales the model's noise density per axis."""
    transition = model.transition(step_s)
    n = model.states
    half = (transition @ estimate["covariance"].reshape(6, n, 6 * n)).reshape(6 * n, 6 * n)
    covariance = (transition @ half.T.reshape(6, n, 6 * n)).reshape(6, n, 6, n)
    own = np.einsum("aiaj->aij", covariance)  # a view of the six diagonal blocks
    own += model.noise(step_s) * drive[:, None, None]
    estimate["covariance"] = covariance.reshape(6 * n, 6 * n)
    _fold(estimate, (transition @ estimate["state"][:, :, None])[:, :, 0])


def correct(estimate: Record, pose: Pose, measured: Array) -> tuple[Array, Array]:
    """Take in a measured pose with covariance (6, 6) at the estimate's time.

    Returns the innovation (6,) and the variances (6,) that were predicted for it without the
    measurement's own.
    """
    import cv2  # not above: who only reads predictions starts without it

    covariance = estimate["covariance"]
    n = estimate["state"].shape[1]
    innovation = np.concatenate(
        [
            vector_from_rotation(pose.rotation @ estimate["rotation"].T),
            pose.translation - estimate["translation"],
        ]
    )
    rows = covariance[::n].copy()
    prior = rows[:, ::n]
    if measured[0, 0] + measured[1, 1] + measured[2, 2] > _VAGUE_RAD**2:
        measured, innovation = _tempered(measured, innovation, prior)
    # cv2.solve takes a quarter of numpy's time for so small a system.
    gain = cv2.solve(prior + measured, rows, flags=cv2.DECOMP_CHOLESKY)[1].T
    posterior = covariance - gain @ rows
    posterior += posterior.T
    posterior *= 0.5
    estimate["covariance"] = posterior
    _fold(estimate, estimate["state"] + (gain @ innovation).reshape(6, n))
    return innovation, np.diagonal(prior).copy()


def extrapolate(
    estimate: Record, model: MotionModel, step_s: float, drive: Array
) -> tuple[Pose, Array]:
    """Pose and its covariance (6, 6) `step_s` later; the estimate stays as it is."""
    n = model.states
    output = model.transition(step_s)[:, 0, :]
    rows = np.zeros((6, 6, n))
    rows[_EACH, _EACH] = output
    flat = rows.reshape(6, 6 * n)
    covariance = flat @ estimate["covariance"] @ flat.T
    covariance[_EACH, _EACH] += model.noise(step_s)[:, 0, 0] * drive
    move = (output * estimate["state"]).sum(1)
    return moved_pose(estimate, move), covariance


def moved_pose(estimate: Record, move: Array) -> Pose:
    """The estimate's pose moved by a small rotation vector (camera frame) and metres, (6,)."""
    return Pose(
        rotation_from_vector(move[:3]) @ estimate["rotation"], estimate["translation"] + move[3:]
    )


def _fold(estimate: Record, state: Array) -> None:
    pose = moved_pose(estimate, state[:, 0])
    estimate["rotation"], estimate["translation"] = pose.rotation, pose.translation
    state[:, 0] = 0
    estimate["state"] = state


def _tempered(measured: Array, innovation: Array, prior: Array) -> tuple[Array, Array]:
    """A measurement whose attitude is so vague that small-angle algebra fails.

    Rotation vectors do not add: a vague one of angle r leaks r/2 of the prediction's error across
    its own direction, which is added to the noise. Beyond a radian only the position counts.
    """
    angle = float(np.linalg.norm(innovation[:3]))
    measured = measured.copy()
    if angle < _TURNED_RAD:
        measured[:3, :3] += np.eye(3) * (angle / 2) ** 2 * np.trace(prior[:3, :3])
        return measured, innovation
    measured[:3, :] = measured[:, :3] = 0
    measured[:3, :3] = np.eye(3) * 1e6
    return measured, np.concatenate([np.zeros(3), innovation[3:]])


_EACH = np.arange(6)
_VAGUE_RAD = 0.1
_TURNED_RAD = 1.0
