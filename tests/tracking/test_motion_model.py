"""The stochastic model of a head's motion, against what defines it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.tracking.motion_model import (
    AXES,
    DEFAULT_STATES,
    KALMAN_STATES,
    Drift,
    MotionModel,
    Oscillator,
    axis_matrices,
    parameters,
    read_parameters,
)

COMPONENTS = (Drift(0.3, 2.0), Oscillator(0.2, 8.0, 0.7), Oscillator(0.05, 50.0, 0.3))


@pytest.fixture(scope="module")
def model() -> MotionModel:
    return MotionModel((COMPONENTS,) * 6)


def test_transition_and_noise_agree_with_small_euler_steps(model: MotionModel) -> None:
    a, density, _ = axis_matrices(COMPONENTS)
    steps, total = 20000, 0.05
    dt = total / steps
    transition, noise = np.eye(len(a)), np.zeros_like(a)
    for _ in range(steps):
        transition = transition + dt * a @ transition
        noise = noise + dt * (a @ noise + noise @ a.T + density)
    np.testing.assert_allclose(model.transition(total)[0], transition, atol=2e-2, rtol=1e-3)
    scale = np.sqrt(np.outer(np.diag(noise), np.diag(noise)))
    assert np.max(np.abs(model.noise(total)[0] - noise) / scale) < 1e-3


def test_two_steps_are_one_of_their_sum(model: MotionModel) -> None:
    first, second = model.transition(0.01), model.transition(0.03)
    np.testing.assert_allclose(second @ first, model.transition(0.04), atol=1e-9)
    noise = second @ model.noise(0.01) @ second.transpose(0, 2, 1) + model.noise(0.03)
    np.testing.assert_allclose(noise, model.noise(0.04), rtol=1e-6, atol=1e-12)


def test_the_velocity_is_stationary(model: MotionModel) -> None:
    step = model.transition(0.1)
    later = step @ model.initial @ step.transpose(0, 2, 1) + model.noise(0.1)
    np.testing.assert_allclose(later[:, 1:, 1:], model.initial[:, 1:, 1:], rtol=1e-6, atol=1e-9)


def test_no_time_changes_nothing(model: MotionModel) -> None:
    np.testing.assert_allclose(model.transition(0.0), np.tile(np.eye(6), (6, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(model.noise(0.0), 0, atol=1e-15)


def test_a_multiple_eigenvalue_is_refused() -> None:
    with pytest.raises(ValueError, match="eigenvalue"):
        MotionModel(((Oscillator(0.2, 8.0, 1.0),),) * 6)


def test_the_parameters_that_ship_fit_the_record() -> None:
    shipped = parameters()
    assert shipped.default.states == DEFAULT_STATES
    assert shipped.kalman.states == KALMAN_STATES


@pytest.mark.parametrize(
    "text", ["", "[]", '{"version": 2}', json.dumps({"version": 1, "default": {}, "kalman": {}})]
)
def test_unusable_parameters_are_one_clear_error(tmp_path: Path, text: str) -> None:
    file = tmp_path / "parameters.json"
    file.write_text(text)
    with pytest.raises(DataError, match=r"MOTION-PARAMETERS.*parameters\.json"):
        read_parameters(file)
    with pytest.raises(DataError, match="MOTION-PARAMETERS"):
        read_parameters(tmp_path / "absent.json")


def test_a_wrong_number_of_states_is_refused(tmp_path: Path) -> None:
    table = {axis: [{"speed": 1.0, "time_s": 1.0}] for axis in AXES}
    file = tmp_path / "parameters.json"
    file.write_text(json.dumps({"version": 1, "default": table, "kalman": table}))
    with pytest.raises(DataError, match="MOTION-PARAMETERS"):
        read_parameters(file)
