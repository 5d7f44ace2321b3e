"""Fit the motion model to recorded heads: ``python -m hypermask.tracking.motion_train FOLDER``.

A linear predictor's error depends on a clip only through its second moments, so these are gathered
once and a candidate model is judged without running over the clips again: its Kalman filter is
unrolled into weights over the last frames, and the error follows from weights and moments. What is
minimised is the mean over clips of the log of the squared error (each clip counts alike, however
wild), for several frame rates and leads, at the best of three strengths of the movement, because
the filter adapts that strength by itself.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.progress import Progress

from hypermask.errors import HypermaskError
from hypermask.geometry import Array
from hypermask.storage import write_atomically
from hypermask.tracking.motion_clips import Clip, frame_times, measure, read_clips
from hypermask.tracking.motion_model import (
    AXES,
    PARAMETERS,
    Component,
    Drift,
    MotionModel,
    MotionParameters,
    Oscillator,
    axis_matrices,
)

DRIFT_TIME_S = 3.0
KALMAN_TIME_S = 5.0  # constant velocity, but for a slow decay that keeps it finite
STRENGTHS = (0.4, 1.0, 4.0)
SEED = 1
EFFORT = 80


@dataclass(frozen=True)
class Task:
    """One way the predictor is used: history of `frames` at `rate_hz`, prediction `lead_s` on."""

    rate_hz: float
    lead_s: float
    frames: int
    weight: float


TASKS = (Task(120, 0.0425, 48, 1.0), Task(240, 0.0215, 80, 1.0), Task(60, 0.080, 24, 0.3))


@dataclass(frozen=True)
class Moments:
    """Second moments of one clip and axis for one task, relative to the latest measured value.

    history: (frames, frames) of earlier values; cross: (frames,) with the future; future: its own;
    noise: variance of one measured value.
    """

    history: Array
    cross: Array
    future: float
    noise: float

    def error(self, weights: Array) -> float:
        """Mean squared error of predicting with `weights` (frames,)."""
        squared = weights @ self.history @ weights - 2 * weights @ self.cross + self.future
        return max(float(squared), 1e-12)


Fitting = list[list[Moments]]
"""Per task, per clip."""


def gather(clip: Clip, task: Task, rng: np.random.Generator) -> list[Moments]:
    """Moments of the six axes of a clip."""
    measured = measure(clip, frame_times(clip, task.rate_hz), rng)
    last = len(measured.times) - int(np.ceil(task.lead_s * task.rate_hz)) - 1
    latest = np.arange(task.frames, last)
    rotations, translations = measured.rotations, measured.translations
    back = [latest - k for k in range(1, task.frames + 1)]
    history = np.stack(
        [
            np.column_stack(
                [_turns(rotations[i], rotations[latest]), translations[i] - translations[latest]]
            )
            for i in back
        ],
        axis=1,
    )
    true_rotations, true_translations = clip.poses(measured.times[latest] + task.lead_s)
    future = np.column_stack(
        [_turns(true_rotations, rotations[latest]), true_translations - translations[latest]]
    )
    noise = np.mean(np.diagonal(measured.covariances, axis1=1, axis2=2), axis=0)
    count = len(latest)
    return [
        Moments(
            history[:, :, a].T @ history[:, :, a] / count,
            history[:, :, a].T @ future[:, a] / count,
            float(np.mean(future[:, a] ** 2)),
            float(noise[a]),
        )
        for a in range(6)
    ]


def _turns(rotations: Array, references: Array) -> Array:
    """Rotation vectors (k, 3) of rotations @ references^T; far from half a turn here."""
    relative = rotations @ references.transpose(0, 2, 1)
    sine = 0.5 * np.stack(
        [
            relative[:, 2, 1] - relative[:, 1, 2],
            relative[:, 0, 2] - relative[:, 2, 0],
            relative[:, 1, 0] - relative[:, 0, 1],
        ],
        axis=1,
    )
    length = np.linalg.norm(sine, axis=1)
    angle = np.arctan2(length, (np.trace(relative, axis1=1, axis2=2) - 1) / 2)
    ratio = np.divide(angle, length, out=np.ones_like(angle), where=length > 1e-9)
    return np.asarray(sine * ratio[:, None], float)


def unrolled_weights(
    matrices: tuple[Array, Array, Array], task: Task, noise: float, strength: float
) -> Array:
    """Weights (frames,) that the model's Kalman filter gives to earlier values, latest first."""
    model = _Single(matrices)
    transition, ahead = model.transition(1 / task.rate_hz), model.transition(task.lead_s)
    added = model.noise(1 / task.rate_hz) * strength
    covariance = matrices[2] * strength
    covariance[0, 0] = 1.0  # the resting place is unknown
    state = np.zeros((len(transition), task.frames + 1))
    for frame in range(task.frames + 1):
        if frame:
            covariance = transition @ covariance @ transition.T + added
            state = transition @ state
        gain = covariance[:, 0] / (covariance[0, 0] + noise)
        unit = -state[0]
        unit[frame] += 1
        state = state + np.outer(gain, unit)
        covariance = covariance - np.outer(gain, covariance[0])
    return np.asarray((ahead @ state)[0, -2::-1], float)


class _Single:
    """Transition and noise of one axis by its eigenvectors, as `MotionModel` for six."""

    def __init__(self, matrices: tuple[Array, Array, Array]) -> None:
        self.values, self.vectors = np.linalg.eig(matrices[0].astype(complex))
        self.inverse = np.linalg.inv(self.vectors)
        self.density = self.inverse @ matrices[1] @ self.inverse.conj().T

    def transition(self, step_s: float) -> Array:
        moved = (self.vectors * np.exp(self.values * step_s)) @ self.inverse
        return np.asarray(moved.real, float)

    def noise(self, step_s: float) -> Array:
        sums = self.values[:, None] + self.values.conj()
        zero = np.abs(sums) < 1e-12
        integral = np.where(zero, step_s, np.expm1(sums * step_s) / np.where(zero, 1, sums))
        added = self.vectors @ (self.density * integral) @ self.vectors.conj().T
        return np.asarray(added.real, float)


def rotation_components(logs: Array) -> tuple[Component, ...]:
    """A drift and two oscillators from the logarithms of the oscillators' six values."""
    return _with_drift(Drift(0.4, DRIFT_TIME_S), logs)


def translation_components(logs: Array) -> tuple[Component, ...]:
    return _with_drift(Drift(0.08, DRIFT_TIME_S), logs)


def _with_drift(drift: Drift, logs: Array) -> tuple[Component, ...]:
    # The drift is given, not fitted: the recorded heads neither travel nor turn round and round,
    # but an actor may, and a steady movement must be followed without lag.
    v = [float(x) for x in np.exp(logs)]
    return drift, Oscillator(*v[:3]), Oscillator(*v[3:])


def kalman_components(logs: Array) -> tuple[Component, ...]:
    """White acceleration alone, from the logarithm of the speed it reaches."""
    return (Drift(float(np.exp(logs[0])), KALMAN_TIME_S),)


# The search starts here and is drawn back here a little, so that few clips cannot bend it far:
# speed, frequency, damping of the slow, then of the quick oscillator.
START = {
    "rotation": np.log([0.4, 10.0, 0.7, 0.15, 45.0, 0.7]),
    "translation": np.log([0.2, 8.0, 0.7, 0.04, 45.0, 0.7]),
}
COMPONENTS = {"rotation": rotation_components, "translation": translation_components}
KALMAN_START = {"rotation": np.log([9.0]), "translation": np.log([7.0])}
PULL = 2e-3


def fit(
    moments: Fitting,
    components: Callable[[Array], tuple[Component, ...]],
    start: Array,
    strengths: Sequence[float],
    effort: int,
) -> tuple[Component, ...]:
    """Best components for one axis (Nelder-Mead over logarithms, `effort` steps per value)."""
    try:
        from scipy.optimize import minimize
    except ImportError:
        raise HypermaskError(
            "MOTION-SCIPY", "fitting motion models needs scipy", "Install scipy (python3-scipy)."
        ) from None

    def cost(logs: Array) -> float:
        away = float(np.sum((logs - start) ** 2))
        if away > 100:
            return 1e3 + away
        return _log_error(moments, components(logs), strengths) + PULL * away

    simplex = start + np.vstack([np.zeros(len(start)), 0.3 * np.eye(len(start))])
    options = {
        "maxiter": effort * len(start),
        "xatol": 0.02,
        "fatol": 1e-4,
        "initial_simplex": simplex,
    }
    best = minimize(cost, start, method="Nelder-Mead", options=options)
    return components(np.asarray(best.x, float))


def _log_error(
    moments: Fitting, components: tuple[Component, ...], strengths: Sequence[float]
) -> float:
    matrices = axis_matrices(components)
    total = 0.0
    for task, clips in zip(TASKS, moments, strict=True):
        noise = float(np.mean([m.noise for m in clips]))
        weights = [unrolled_weights(matrices, task, noise, s) for s in strengths]
        errors = [min(m.error(w) for w in weights) for m in clips]
        total += task.weight * float(np.mean(np.log(errors)))
    return total


Gathered = list[list[list[Moments]]]
"""Per task, per clip, per axis."""


def gather_all(clips: Sequence[Clip], done: Callable[[], None] = lambda: None) -> Gathered:
    """Moments of all clips for all `TASKS`; `done` is called after each clip and task."""
    gathered: Gathered = []
    for task in TASKS:
        rng = np.random.default_rng(SEED)
        per_clip = []
        for clip in clips:
            per_clip.append(gather(clip, task, rng))
            done()
        gathered.append(per_clip)
    return gathered


FITS = 2 * len(AXES)


def fit_all(
    gathered: Gathered,
    chosen: Sequence[int],
    done: Callable[[], None] = lambda: None,
    effort: int = EFFORT,
) -> MotionParameters:
    """Both models from the clips with the indices `chosen`; `done` after each of `FITS` fits."""
    models: dict[str, list[tuple[Component, ...]]] = {"default": [], "kalman": []}
    for axis, name in enumerate(AXES):
        kind = "rotation" if name.startswith("rotation") else "translation"
        moments = [[task[clip][axis] for clip in chosen] for task in gathered]
        models["default"].append(fit(moments, COMPONENTS[kind], START[kind], STRENGTHS, effort))
        done()
        models["kalman"].append(fit(moments, kalman_components, KALMAN_START[kind], (1.0,), effort))
        done()
    return MotionParameters(
        MotionModel(tuple(models["default"])), MotionModel(tuple(models["kalman"]))
    )


def parameters_text(parameters: MotionParameters, clips: Sequence[Clip]) -> str:
    """The JSON that `read_parameters` reads."""
    tables = {
        name: {
            axis: [_rounded(c) for c in components]
            for axis, components in zip(AXES, model.axes, strict=True)
        }
        for name, model in (("default", parameters.default), ("kalman", parameters.kalman))
    }
    source = "fitted to heads of the CMU Graphics Lab Motion Capture Database"
    names = [clip.name for clip in clips]
    return json.dumps({"version": 1, "source": source, "clips": names, **tables}, indent=1) + "\n"


def _rounded(component: Component) -> dict[str, float]:
    return {key: float(f"{value:.5g}") for key, value in vars(component).items()}


def train(folder: Path, output: Path = PARAMETERS) -> None:
    """Fit to all clips of `folder` and write the parameter file. Raises `HypermaskError`."""
    clips = read_clips(folder)
    with Progress() as progress:
        gathering = progress.add_task("clips", total=len(clips) * len(TASKS))
        fitting = progress.add_task("models", total=FITS)
        gathered = gather_all(clips, lambda: progress.advance(gathering))
        chosen = range(len(clips))
        fitted = fit_all(gathered, chosen, lambda: progress.advance(fitting))
    write_atomically(output, parameters_text(fitted, clips).encode())


def main() -> int:
    parser = argparse.ArgumentParser(description="Fit the motion model to recorded heads.")
    parser.add_argument("folder", type=Path, help="folder with the motion clips (CSV)")
    parser.add_argument("--output", type=Path, default=PARAMETERS)
    arguments = parser.parse_args()
    try:
        train(arguments.folder, arguments.output)
    except HypermaskError as error:
        print(error)
        return error.exit_code
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
