"""The paper's way: a Kalman filter for each LED's image point."""

from __future__ import annotations

import numpy as np
import pytest

from hypermask.tracking.paper import PaperSettings, PointKalman, predict_points

START = np.array([[600.0, 300.0], [680, 300], [680, 410], [600, 410], [640, 366]])
SPEED = np.array([120.0, -60.0])
STEP = 1 / 120


def at(t: float) -> np.ndarray:
    return START + SPEED * t


def followed(frames: int = 60) -> PointKalman:
    kalman = PointKalman()
    for j in range(frames):
        kalman.update(j * STEP, at(j * STEP))
    return kalman


def test_steady_motion_is_predicted_exactly() -> None:
    kalman = followed()
    for lead in (0.0, 0.02, 0.039):
        assert np.allclose(kalman.predict(59 * STEP + lead), at(59 * STEP + lead), atol=0.05)


def test_prediction_beats_holding_the_last_point_and_noise_is_smoothed() -> None:
    rng = np.random.default_rng(1)
    kalman = PointKalman(PaperSettings(acceleration_density=1e4, measurement_sigma_px=0.3))
    for j in range(80):
        kalman.update(j * STEP, at(j * STEP) + rng.normal(0, 0.3, (5, 2)))
    now = 79 * STEP
    filtered = np.abs(kalman.predict(now) - at(now)).mean()
    held = predict_points(kalman.record(), now + 0.039, "off")
    assert filtered < 0.2
    ahead = np.abs(kalman.predict(now + 0.039) - at(now + 0.039)).mean()
    assert ahead < 0.4 * np.abs(held - at(now + 0.039)).mean()


def test_a_hidden_point_goes_on_for_a_while_and_the_others_do_not_care() -> None:
    kalman, reference = followed(), followed()
    for j in range(60, 72):
        points = at(j * STEP)
        reference.update(j * STEP, points)
        points[2] = np.nan
        kalman.update(j * STEP, points)
    predicted = kalman.predict(71 * STEP)
    assert np.allclose(predicted[2], at(71 * STEP)[2], atol=0.5)
    others = [0, 1, 3, 4]
    assert np.array_equal(predicted[others], reference.predict(71 * STEP)[others])


def test_a_point_hidden_for_long_is_not_predicted_and_comes_back_at_once() -> None:
    kalman = followed()
    for j in range(60, 100):
        points = at(j * STEP)
        points[2] = np.nan
        kalman.update(j * STEP, points)
    assert (
        np.isnan(kalman.predict(100 * STEP)).any(axis=1).tolist()
        == [False] * 2 + [True] + [False] * 2
    )
    jumped = at(100 * STEP)
    jumped[2] += 200
    kalman.update(100 * STEP, jumped)
    assert np.allclose(kalman.predict(100 * STEP)[2], jumped[2])


def test_the_record_alone_predicts_the_same() -> None:
    kalman = followed()
    record = kalman.record()
    copy = np.frombuffer(record.tobytes(), record.dtype)[0]
    assert np.array_equal(predict_points(copy, 0.55), kalman.predict(0.55))
    assert np.array_equal(predict_points(record, 0.55, "kalman"), kalman.predict(0.55))
    assert np.allclose(predict_points(record, 0.55, "off"), at(59 * STEP))


def test_a_late_frame_is_ignored_and_nothing_known_is_an_error() -> None:
    kalman = followed()
    before = kalman.record().tobytes()
    kalman.update(10 * STEP, at(0))
    assert kalman.record().tobytes() == before
    kalman.reset()
    with pytest.raises(ValueError, match="no points"):
        kalman.predict(1.0)
    with pytest.raises(ValueError, match="unknown"):
        predict_points(followed().record(), 1.0, "guess")
