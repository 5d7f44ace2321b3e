"""How a performer's head moves: one linear stochastic model per axis, in continuous time.

Each of the six axes (rotation about, then translation along the camera's x, y, z) is an integrated
velocity, and the velocity is a sum of independent stationary processes: Ornstein-Uhlenbeck drifts
and noise-driven damped oscillators (a Matern-3/2 process is one with damping 1). Their spectra are
fitted to recorded heads (`motion_train`). In continuous time any frame rate, gap and lead is exact.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.geometry import Array

AXES = ("rotation_x", "rotation_y", "rotation_z", "x", "y", "z")
PARAMETERS = Path(__file__).with_name("motion_parameters.json")
DEFAULT_STATES = 6  # position, drift, two oscillators of two states each
KALMAN_STATES = 2  # position, velocity


@dataclass(frozen=True)
class Drift:
    """Ornstein-Uhlenbeck velocity: standard deviation `speed` (unit/s), correlation `time_s`."""

    speed: float
    time_s: float


@dataclass(frozen=True)
class Oscillator:
    """Damped oscillator driven by white noise: velocity of standard deviation `speed` (unit/s)."""

    speed: float
    frequency: float  # undamped, rad/s
    damping: float  # 1 = critical


Component = Drift | Oscillator

_TICK_S = 1e-6
_CACHED = 1024


def axis_matrices(components: tuple[Component, ...]) -> tuple[Array, Array, Array]:
    """A (n, n), driving noise density (n, n) and initial covariance (n, n) of `dx = A x dt + dw`.

    State 0 is the position (initial variance 0); each component adds its velocity and, for an
    oscillator, its acceleration.
    """
    n = 1 + sum(1 if isinstance(c, Drift) else 2 for c in components)
    a, density, initial = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    i = 1
    for c in components:
        a[0, i] = 1
        initial[i, i] = c.speed**2
        if isinstance(c, Drift):
            a[i, i] = -1 / c.time_s
            density[i, i] = 2 * c.speed**2 / c.time_s
            i += 1
        else:
            a[i, i + 1] = 1
            a[i + 1, i : i + 2] = -(c.frequency**2), -2 * c.damping * c.frequency
            density[i + 1, i + 1] = 4 * c.damping * c.frequency**3 * c.speed**2
            initial[i + 1, i + 1] = (c.speed * c.frequency) ** 2
            i += 2
    return a, density, initial


class MotionModel:
    """Models of the six axes, all with the same number of states n.

    Kept in modal form (A = V diag(l) V^-1), where transition and noise over any time are closed
    formulas. Raises `ValueError` if a model has a multiple eigenvalue (damping exactly 1).
    """

    def __init__(self, axes: tuple[tuple[Component, ...], ...]) -> None:
        matrices = [axis_matrices(components) for components in axes]
        self.axes = axes
        a = np.stack([m[0] for m in matrices])
        self.initial: Array = np.stack([m[2] for m in matrices])
        self.states: int = a.shape[1]
        self._values, self._vectors = np.linalg.eig(a.astype(complex))
        if not _distinct(self._values):
            raise ValueError("an axis model has a multiple eigenvalue")
        self._inverse = np.linalg.inv(self._vectors)
        density = np.stack([m[1] for m in matrices])
        self._modal_density = self._inverse @ density @ np.conj(self._inverse.transpose(0, 2, 1))
        self._sums = self._values[:, :, None] + np.conj(self._values[:, None, :])
        self._zero = np.abs(self._sums) < 1e-12
        self._divisor = np.where(self._zero, 1.0, self._sums)
        self._conjugate = np.ascontiguousarray(np.conj(self._vectors.transpose(0, 2, 1)))
        self._cache: dict[int, tuple[Array, Array]] = {}

    def transition(self, step_s: float) -> Array:
        """(6, n, n) state transition over `step_s`, to the nearest microsecond."""
        return self._over(step_s)[0]

    def noise(self, step_s: float) -> Array:
        """(6, n, n) covariance of what the driving noise adds over |step_s|, likewise."""
        return self._over(step_s)[1]

    def _over(self, step_s: float) -> tuple[Array, Array]:
        # A camera's frames are steady to some microseconds, so few steps are ever computed.
        ticks = round(step_s / _TICK_S)
        cached = self._cache.get(ticks)
        if cached is None:
            if len(self._cache) >= _CACHED:
                self._cache.clear()
            step_s = ticks * _TICK_S
            cached = self._cache[ticks] = self._transition(step_s), self._noise(abs(step_s))
        return cached

    def _transition(self, step_s: float) -> Array:
        growth = np.exp(self._values * step_s)
        moved: NDArray[np.complex128] = (self._vectors * growth[:, None, :]) @ self._inverse
        return np.ascontiguousarray(moved.real)

    def _noise(self, step_s: float) -> Array:
        integral = np.where(self._zero, step_s, np.expm1(self._sums * step_s) / self._divisor)
        added = self._vectors @ (self._modal_density * integral) @ self._conjugate
        return np.ascontiguousarray(added.real)


def _distinct(values: NDArray[np.complex128]) -> bool:
    apart = np.abs(values[:, :, None] - values[:, None, :])
    apart += np.where(np.eye(values.shape[1], dtype=bool), np.inf, 0)
    return bool(np.all(apart > 1e-5 * np.max(np.abs(values))))


def model_from_table(table: dict[str, list[dict[str, float]]]) -> MotionModel:
    """Model from a list of components per axis: {speed, time_s} or {speed, frequency, damping}."""
    return MotionModel(tuple(tuple(_component(c) for c in table[axis]) for axis in AXES))


def _component(values: dict[str, float]) -> Component:
    return Drift(**values) if "time_s" in values else Oscillator(**values)


@dataclass(frozen=True)
class MotionParameters:
    """What `motion_train` wrote: the default model and the constant-velocity reference."""

    default: MotionModel
    kalman: MotionModel


def read_parameters(path: Path = PARAMETERS) -> MotionParameters:
    """Raises `DataError` MOTION-PARAMETERS if the file is absent, damaged or of another version."""
    try:
        data: dict[str, Any] = json.loads(path.read_text("utf-8"))
        if data["version"] != 1:
            raise ValueError(f"version {data['version']}")
        models = MotionParameters(
            model_from_table(data["default"]), model_from_table(data["kalman"])
        )
        if (models.default.states, models.kalman.states) != (DEFAULT_STATES, KALMAN_STATES):
            raise ValueError("a model has the wrong number of components")
        return models
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(
            "MOTION-PARAMETERS",
            f"cannot use {path}: {error}",
            "Install the program again, or run the motion training.",
        ) from error


@lru_cache(maxsize=1)
def parameters() -> MotionParameters:
    """The parameters that came with the program, read once."""
    return read_parameters()
