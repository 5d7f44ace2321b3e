"""Smooth ways from place to place: pure functions of time, within speed and acceleration.

Each stretch is a quintic polynomial an axis, the minimum-jerk movement of Flash and Hogan (1985),
here from any speed to a standstill. Both axes arrive together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PEAK_SPEED, PEAK_ACCELERATION = 1.875, 10 / math.sqrt(3)
"""Of a rest-to-rest quintic over distance 1 in time 1."""
_SAMPLES = np.linspace(0.0, 1.0, 41)
_POWERS = np.stack([_SAMPLES**n for n in range(6)])
_SLACK = 1.001


@dataclass(frozen=True)
class NeckLimits:
    """low, high: (pan, tilt) in rad; speed in rad/s, acceleration in rad/s^2, of each axis."""

    low: tuple[float, float]
    high: tuple[float, float]
    speed: float
    acceleration: float

    def clamp(self, place: Array) -> Array:
        """(2,) the nearest place inside."""
        return np.asarray(np.clip(place, self.low, self.high))

    def scaled(self, vigour: float) -> NeckLimits:
        """The same range with a share of speed and, squared, of acceleration: the same movement,
        only slower."""
        share = min(max(vigour, 0.05), 1.0)
        return NeckLimits(
            self.low, self.high, self.speed * share, self.acceleration * share * share
        )


@dataclass(frozen=True)
class Stretch:
    """coefficients: (2, 6) of the polynomials in seconds since `start_s`."""

    start_s: float
    duration_s: float
    coefficients: Array

    @property
    def end_s(self) -> float:
        return self.start_s + self.duration_s

    def at(self, time_s: float) -> tuple[Array, Array]:
        """(2,) place and (2,) speed, those of its ends outside its time."""
        t = min(max(time_s - self.start_s, 0.0), self.duration_s)
        powers = t ** np.arange(6)
        slopes = np.arange(1, 6) * powers[:5]
        return self.coefficients @ powers, self.coefficients[:, 1:] @ slopes


@dataclass(frozen=True)
class Trajectory:
    stretches: tuple[Stretch, ...]

    @property
    def end_s(self) -> float:
        return self.stretches[-1].end_s

    def at(self, time_s: float) -> tuple[Array, Array]:
        """(2,) place in rad and (2,) speed in rad/s; at rest after its end."""
        for stretch in self.stretches:
            if time_s < stretch.end_s:
                return stretch.at(time_s)
        return self.stretches[-1].at(self.end_s)[0], np.zeros(2)


def through(
    place: Array, speed: Array, waypoints: list[Array], start_s: float, limits: NeckLimits
) -> Trajectory:
    """From a place and a speed, (2,) each, to a rest at each waypoint, (2,), in turn.

    Waypoints outside the limits are moved to them.
    """
    stretches: list[Stretch] = []
    for waypoint in waypoints:
        stretch = _reach(place, speed, limits.clamp(waypoint), start_s, limits)
        stretches.append(stretch)
        place, speed, start_s = limits.clamp(waypoint), np.zeros(2), stretch.end_s
    return Trajectory(tuple(stretches))


def _reach(
    place: Array, speed: Array, target: Array, start_s: float, limits: NeckLimits
) -> Stretch:
    """The quickest quintic that keeps to the limits, within 5 per cent."""
    distance = np.abs(target - place)
    duration = max(
        float(np.max(PEAK_SPEED * distance)) / limits.speed,
        math.sqrt(float(np.max(PEAK_ACCELERATION * distance)) / limits.acceleration),
        1e-3,
    )
    while not _keeps(place, speed, target, duration, limits):
        duration *= 1.05
    return Stretch(start_s, duration, _quintic(place, speed, target, duration))


def _quintic(place: Array, speed: Array, target: Array, duration: float) -> Array:
    """(2, 6): place and speed at the start without acceleration, at rest in `target`."""
    way, run = target - place, speed * duration
    zero = np.zeros(2)
    scaled = np.stack(
        [place, run, zero, 10 * way - 6 * run, -15 * way + 8 * run, 6 * way - 3 * run], axis=1
    )
    return np.asarray(scaled / duration ** np.arange(6))


def _keeps(place: Array, speed: Array, target: Array, duration: float, limits: NeckLimits) -> bool:
    scaled = _quintic(place, speed, target, duration) * duration ** np.arange(6)
    first = scaled[:, 1:] * np.arange(1, 6) @ _POWERS[:5] / duration
    second = scaled[:, 2:] * [2, 6, 12, 20] @ _POWERS[:4] / duration**2
    top = max(limits.speed, float(np.max(np.abs(speed))))
    return bool(
        np.max(np.abs(first)) <= top * _SLACK
        and np.max(np.abs(second)) <= limits.acceleration * _SLACK
    )
