"""Gestures are smooth, keep to the neck's limits, and end where they should."""

import math

import numpy as np
import pytest

from hypermask.errors import UsageError
from hypermask.neck.gestures import GESTURES, movement, waypoints
from hypermask.neck.record import beat, new_neck, order
from hypermask.neck.trajectory import NeckLimits, Trajectory, through

LIMITS = NeckLimits((-1.0, -0.5), (1.0, 0.4), speed=1.5, acceleration=6.0)
REST = np.zeros(2)


def sampled(way: Trajectory, step_s: float = 0.001) -> np.ndarray:
    """(n, 2) places from its start to a little after its end."""
    times = np.arange(way.stretches[0].start_s, way.end_s + 0.1, step_s)
    return np.array([way.at(time)[0] for time in times])


def of(gesture: str, **changes: object) -> Trajectory:
    neck = order(new_neck(0.0), 10.0, gesture, vigour=1.0, **changes)  # type: ignore[arg-type]
    return movement(neck, REST, REST, 10.0, LIMITS)


@pytest.mark.parametrize("gesture", GESTURES)
def test_speed_and_acceleration_stay_within_the_limits(gesture: str) -> None:
    places = sampled(of(gesture, look=(0.6, -0.2), amplitude_rad=0.3, cycles=3))
    speeds = np.diff(places, axis=0) / 0.001
    assert np.abs(speeds).max() <= LIMITS.speed * 1.01
    assert np.abs(np.diff(speeds, axis=0) / 0.001).max() <= LIMITS.acceleration * 1.03


@pytest.mark.parametrize("gesture", GESTURES)
def test_every_gesture_ends_at_rest_where_it_looks(gesture: str) -> None:
    way = of(gesture, look=(0.3, 0.1))
    place, speed = way.at(way.end_s + 5)
    goal = (0, 0) if gesture == "park" else (0.3, 0.1)
    assert place == pytest.approx(goal) and speed.tolist() == [0, 0]


def test_a_look_is_as_quick_as_the_limits_allow() -> None:
    way = of("look", look=(0.9, 0.0))
    speeds = np.abs(np.diff(sampled(way), axis=0)).max() / 0.001
    assert speeds == pytest.approx(LIMITS.speed, rel=0.06)


def test_a_nod_goes_down_first_and_moves_nothing_else() -> None:
    places = sampled(of("nod", amplitude_rad=0.2, cycles=2))
    assert np.abs(places[:, 0]).max() == 0
    assert places[:, 1].min() == pytest.approx(-0.2, abs=1e-3)
    assert 0.05 < places[:, 1].max() < 0.1
    assert np.argmin(places[:, 1]) < np.argmax(places[:, 1])


def test_a_shake_goes_both_ways_and_dies_away() -> None:
    places = sampled(of("shake", amplitude_rad=0.4, cycles=2))[:, 0]
    assert places.max() == pytest.approx(0.4, abs=1e-3)
    assert places.min() == pytest.approx(-0.4, abs=1e-3)
    assert np.abs(places[np.argmin(places) + 400 :]).max() <= 0.3 + 1e-3


def test_a_gesture_beyond_the_soft_limits_is_cut_to_them() -> None:
    places = sampled(of("nod", look=(0.0, -0.45), amplitude_rad=0.4))
    assert places[:, 1].min() >= -0.5 - 1e-9


def test_a_movement_is_a_pure_function_of_time() -> None:
    way = of("shake")
    times = np.random.default_rng(1).uniform(9, 15, 50)
    forward = [way.at(t)[0].tolist() for t in np.sort(times)]
    backward = [way.at(t)[0].tolist() for t in np.sort(times)[::-1]]
    assert forward == backward[::-1]


def test_an_interrupted_movement_goes_on_without_a_jerk() -> None:
    first = of("look", look=(0.9, 0.0))
    middle_s = (first.stretches[0].start_s + first.end_s) / 2
    place, speed = first.at(middle_s)
    second = through(place, speed, [np.array([-0.5, 0.2])], middle_s, LIMITS)
    start, start_speed = second.at(middle_s)
    assert start == pytest.approx(place) and start_speed == pytest.approx(speed)
    places = sampled(second)
    assert np.abs(np.diff(places, axis=0)).max() / 0.001 <= LIMITS.speed * 1.01
    assert places[-1] == pytest.approx((-0.5, 0.2))


def test_less_vigour_is_the_same_movement_only_slower() -> None:
    neck = order(new_neck(0.0), 0.0, "nod", vigour=1.0)
    gentle = order(new_neck(0.0), 0.0, "nod", vigour=0.5)
    quick, slow = (movement(n, REST, REST, 0.0, LIMITS) for n in (neck, gentle))
    assert slow.end_s == pytest.approx(2 * quick.end_s, rel=0.02)
    for share in (0.1, 0.4, 0.8):
        assert slow.at(share * slow.end_s)[0] == pytest.approx(
            quick.at(share * quick.end_s)[0], abs=0.01
        )


def test_a_gesture_given_long_ago_is_not_made_again() -> None:
    neck = order(new_neck(0.0), 0.0, "shake", look=(0.2, 0.0))
    way = movement(neck, REST, REST, 60.0, LIMITS, late=True)
    assert sampled(way)[:, 0].max() == pytest.approx(0.2)


def test_an_unknown_gesture_is_refused() -> None:
    with pytest.raises(UsageError) as caught:
        waypoints("wave", REST, 0.1, 1)
    assert caught.value.code == "NECK-GESTURE"


def test_orders_count_and_beats_do_not() -> None:
    neck = new_neck(1.0)
    nod = order(neck, 2.0, "nod")
    assert int(nod["order"]) == int(neck["order"]) + 1 == int(beat(nod, 3.0)["order"])
    assert (float(beat(nod, 3.0)["time_s"]), float(nod["start_s"])) == (3.0, 2.0)


def test_two_axes_arrive_together() -> None:
    way = through(REST, REST, [np.array([0.8, 0.1])], 0.0, LIMITS)
    half = way.at(way.end_s / 2)[0]
    assert half == pytest.approx((0.4, 0.05)) and math.isfinite(way.end_s)
