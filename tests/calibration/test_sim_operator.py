"""The simulated human: imprecise in aim, and no more informed than an eye and a handbook."""

from __future__ import annotations

import numpy as np
import pytest

from hypermask_drivers.keypad import KEYS
from hypermask_sim.operator import Operator, true_look

STEPS = (32, 8, 1)


def aim(operator: Operator, start: tuple[float, float], step: int = 0) -> tuple[np.ndarray, int]:
    """Let him press keys on a cross-hair until he accepts: where it is, and presses."""
    moves = {"8": (0, -1), "2": (0, 1), "4": (-1, 0), "6": (1, 0)}
    at, presses = np.array(start, float), 0
    while True:
        key = operator.key((float(at[0]), float(at[1])), 0)
        presses += 1
        assert key in KEYS
        if key == "enter":
            return at, presses
        if key == "5":
            step = (step + 1) % 3
        else:
            at += np.array(moves[key]) * STEPS[step]


def looking_at(led: tuple[float, float]):  # type: ignore[no-untyped-def]
    return lambda cross_hair, _: np.array(led) - cross_hair


@pytest.mark.parametrize("step", [0, 1, 2])
@pytest.mark.parametrize("start", [(100, 80), (103, 77), (400, 300), (141, 113)])
def test_a_perfect_eye_comes_to_the_nearest_pixel(step: int, start: tuple[int, int]) -> None:
    at, presses = aim(Operator(looking_at((100.2, 79.7)), 0.0), start, step)
    np.testing.assert_array_equal(at, [100, 80])
    assert presses < 40 if step < 2 else presses < 500


@pytest.mark.parametrize("sigma", [1.0, 3.0])
def test_his_aim_has_the_asked_spread(sigma: float) -> None:
    operator = Operator(looking_at((300.0, 200.0)), sigma, seed=1)
    ends = np.array([aim(operator, (310, 190))[0] for _ in range(400)])
    np.testing.assert_allclose(ends.mean(axis=0), [300, 200], atol=0.2 * sigma)
    np.testing.assert_allclose(ends.std(axis=0), np.hypot(sigma, 0.29), rtol=0.1)


def test_the_same_seed_is_the_same_hand() -> None:
    def hand(seed: int) -> np.ndarray:
        operator = Operator(looking_at((300.0, 200.0)), 1.0, seed)
        return np.array([aim(operator, (310, 190))[0] for _ in range(10)])

    np.testing.assert_array_equal(hand(5), hand(5))
    assert np.any(hand(5) != hand(6))


def test_an_led_that_cannot_be_reached_is_skipped() -> None:
    operator = Operator(looking_at((-50.0, 20.0)), 0.0)
    keys = [operator.key((0.0, 20.0), 0) for _ in range(2)]
    assert keys == ["4", "0"]


def test_he_sees_the_gap_between_the_light_and_the_led_in_pixels() -> None:
    matrix = np.array([[1000.0, 0, 500], [0, 1000, 400], [0, 0, 1]])
    shift = np.array([-0.1, 0.0, 0.0])
    leds = np.array([[0.02, 0.01, 0.0], [0.0, 0.0, 0.03]])
    facing = np.diag([1.0, -1, -1])
    place = np.array([0.3, -0.2, 2.0])
    look = true_look(matrix, (np.eye(3), shift), leds, lambda: (facing, place))
    for led in (0, 1):
        seen = matrix @ (facing @ leds[led] + place + shift)
        pixel = seen[:2] / seen[2]
        np.testing.assert_allclose(look((pixel[0] - 7, pixel[1] + 4), led), [7, -4], atol=1e-9)


def test_he_places_the_mask_about_where_he_was_asked() -> None:
    operator = Operator(looking_at((0.0, 0.0)), seed=3)
    placed = [operator.place((0.1, -0.2, 1.8), (0.0, 0.2, -0.4)) for _ in range(200)]
    where = np.array([p for p, _ in placed])
    np.testing.assert_allclose(where.mean(axis=0), [0.1, -0.2, 1.8], atol=0.01)
    assert 0.01 < where[:, 0].std() < 0.04
    assert 1 < np.degrees(np.std([a[1] for _, a in placed])) < 5
