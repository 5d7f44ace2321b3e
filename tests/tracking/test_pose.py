"""Pose from LED points: right, with an honest covariance, and with few LEDs when predicted."""

from __future__ import annotations

import numpy as np
import pytest
from led_frames import CAMERA, LEDS, camera_from_mask

from hypermask.geometry import Pose, rotation_from_vector, vector_from_rotation
from hypermask.tracking.motion import PredictedPose
from hypermask.tracking.pose import project_with_jacobian, small_rotation, solve_pose

POSE = camera_from_mask(0.2, -0.1, 1.8, roll=130, pitch=12, yaw=-25)
POINTS = CAMERA.project(POSE.apply(LEDS))
PRIOR_COVARIANCE = np.diag([0.005**2] * 3 + [0.002**2] * 3)


def moved(pose: Pose, change: np.ndarray) -> Pose:
    return Pose(rotation_from_vector(change[:3]) @ pose.rotation, pose.translation + change[3:])


def difference(pose: Pose, other: Pose) -> np.ndarray:
    """(6,) small rotation and translation from `other` to `pose`."""
    turn = vector_from_rotation(pose.rotation @ other.rotation.T)
    return np.concatenate([turn, pose.translation - other.translation])


def prior(rng) -> PredictedPose:
    change = rng.normal(0, np.sqrt(np.diag(PRIOR_COVARIANCE)))
    return PredictedPose(moved(POSE, change), PRIOR_COVARIANCE)


def led_error_mm(pose: Pose) -> float:
    return float(np.linalg.norm(pose.apply(LEDS) - POSE.apply(LEDS), axis=1).max() * 1e3)


def test_the_jacobian_is_the_derivative_of_the_projection() -> None:
    points, jacobian = project_with_jacobian(POSE.rotation, POSE.translation, LEDS, CAMERA)
    assert np.allclose(points, POINTS)
    for k in range(6):
        change = np.zeros(6)
        change[k] = 1e-6
        ahead = CAMERA.project(moved(POSE, change).apply(LEDS))
        behind = CAMERA.project(moved(POSE, -change).apply(LEDS))
        assert np.allclose(jacobian[..., k], (ahead - behind) / 2e-6, atol=1e-3)


def test_small_rotation_is_rodrigues() -> None:
    for vector in ([0.3, -0.2, 0.5], [1e-9, 0, 0], [0, 0, 3.0]):
        assert np.allclose(small_rotation(np.array(vector)), rotation_from_vector(vector))


def test_exact_points_give_the_exact_pose() -> None:
    for guess in (None, prior(np.random.default_rng(1))):
        estimate = solve_pose(POINTS, LEDS, CAMERA, guess)
        assert estimate is not None
        assert led_error_mm(estimate.pose) < 0.01
        assert estimate.rms_px < 1e-3


def test_four_leds_with_the_label_need_no_prior() -> None:
    points = POINTS.copy()
    points[1] = np.nan
    estimate = solve_pose(points, LEDS, CAMERA, None)
    assert estimate is not None
    assert led_error_mm(estimate.pose) < 0.01


def test_too_few_leds_give_no_pose() -> None:
    points = np.full((5, 2), np.nan)
    assert solve_pose(points, LEDS, CAMERA, prior(np.random.default_rng(2))) is None
    points[:3] = POINTS[:3]
    assert solve_pose(points, LEDS, CAMERA, None) is None


def test_the_covariance_is_that_of_many_noisy_trials() -> None:
    rng = np.random.default_rng(3)
    sigma = 0.1
    trials, stated = [], None
    for _ in range(800):
        noisy = POINTS + rng.normal(0, sigma, POINTS.shape)
        stated = solve_pose(noisy, LEDS, CAMERA, prior(rng), np.full(5, sigma))
        assert stated is not None
        trials.append(difference(stated.pose, POSE))
    assert stated is not None
    measured = np.std(trials, axis=0)
    assert np.allclose(measured, np.sqrt(np.diag(stated.covariance)), rtol=0.12)
    # Whitened by the stated covariance the trials are white.
    white = np.linalg.solve(np.linalg.cholesky(stated.covariance), np.array(trials).T)
    assert np.allclose(np.cov(white), np.eye(6), atol=0.25)


@pytest.mark.parametrize("hidden", [(0, 1), (0, 2), (1, 4), (3, 4)])
def test_three_leds_and_a_prediction_hold_the_pose(hidden: tuple[int, int]) -> None:
    """Across the line of sight as well as with all LEDs; in depth better than the prediction."""
    rng = np.random.default_rng(4)
    across, errors, before = [], [], []
    for _ in range(100):
        points = POINTS + rng.normal(0, 0.03, POINTS.shape)
        points[list(hidden)] = np.nan
        guess = prior(rng)
        estimate = solve_pose(points, LEDS, CAMERA, guess, np.full(5, 0.03))
        assert estimate is not None
        offsets = (estimate.pose.apply(LEDS) - POSE.apply(LEDS))[:, :2]
        across.append(1e3 * np.linalg.norm(offsets, axis=1).max())
        errors.append(led_error_mm(estimate.pose))
        before.append(led_error_mm(guess.pose))
    assert np.percentile(across, 95) < 2.0
    assert np.percentile(errors, 95) < 4.0
    assert np.median(errors) < np.median(before)


def test_two_leds_pull_the_prediction_towards_them() -> None:
    rng = np.random.default_rng(5)
    points = POINTS.copy()
    points[[1, 2, 4]] = np.nan
    before, after = [], []
    for _ in range(60):
        guess = prior(rng)
        estimate = solve_pose(points, LEDS, CAMERA, guess)
        assert estimate is not None
        seen = [0, 3]
        before.append(np.abs(CAMERA.project(guess.pose.apply(LEDS)) - POINTS)[seen].max())
        after.append(np.abs(CAMERA.project(estimate.pose.apply(LEDS)) - POINTS)[seen].max())
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0
    assert np.median(after) < 0.1 < np.median(before)


def test_a_point_of_less_trust_moves_the_pose_less() -> None:
    points = POINTS.copy()
    points[0] += [0.5, 0.0]
    alike = solve_pose(points, LEDS, CAMERA, None)
    doubted = solve_pose(points, LEDS, CAMERA, None, np.array([1.0, 0.03, 0.03, 0.03, 0.03]))
    assert alike is not None
    assert doubted is not None
    assert led_error_mm(doubted.pose) < 0.5 * led_error_mm(alike.pose)
