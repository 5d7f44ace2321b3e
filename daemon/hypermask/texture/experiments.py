"""The paper's experiments on faces that were left out of the model (PAPERS B, their results)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hypermask.texture import regions
from hypermask.texture.estimate import PAPER_BASES, SOLVERS, SPACING, Solver, carried, forget, small
from hypermask.texture.morphable import MorphableModel, load_model
from hypermask.texture.morphable_train import FOLDS, SHIPPED, complete_again, folds, make_model

Map = NDArray[np.float32]

SPACINGS = (1, 2, 4, 8, 16)
COUNTS = (1, 2, 5, 10, 20, 32, 50, 100, 130)
"""The paper's, and what the program uses."""
BOTH: tuple[Solver, ...] = ("levenberg_marquardt", "ridge")
METHODS = ("mean", "mirror", "PCA", "mean + residual", "PCA + residual")


@dataclass(frozen=True)
class Faces:
    """textures, completed: (n, SIDE, SIDE, 3); weights: (n, SIDE, SIDE)."""

    textures: Map
    completed: Map
    weights: Map


@dataclass(frozen=True)
class Trial:
    """One estimation: seconds to solve, E over all believed texels, E over the hidden ones."""

    solver: Solver
    spacing: int
    count: int
    seconds: float
    error: float
    hidden_error: float


@dataclass(frozen=True)
class Fill:
    """E over the hidden texels of one face, its `part` hidden and filled by `method`."""

    part: str
    method: str
    error: float


def hidden_parts() -> dict[str, NDArray[np.bool_]]:
    """(SIDE, SIDE) True where each experiment hides the face."""
    x, y = (small(values) for values in regions.grid_mm())
    return {
        "side": x > 25,
        "half": x > 0,
        "forehead": y > 55,
        "eyes": np.abs(y - 27) < 16,
        "lower face": y < -30,
    }


def error(target: Map, estimated: Map, where: NDArray[np.bool_]) -> float:
    """E = 1/(3N) sum |T_target - T_estimated| over N texels, colours from 0 to 255."""
    return float(np.abs(target - estimated)[where].mean())


def fold_models(faces: Faces) -> Iterator[tuple[MorphableModel, NDArray[np.intp]]]:
    """(model of the others, faces left out) of each fold; as many bases as the paper's most."""
    noise = load_model().noise
    for known, unknown in folds(len(faces.textures), FOLDS):
        first = make_model(faces.completed[known], min(SHIPPED, 2 * len(known) - 1))
        textures, weights = faces.textures[known], faces.weights[known]
        completed = complete_again(textures, weights, replace(first, noise=noise))
        model = make_model(completed, min(COUNTS[-1], 2 * len(known) - 1))
        yield replace(model, noise=noise), unknown
        forget()


def trials(
    model: MorphableModel, faces: Faces, chosen: Sequence[int], done: Callable[[], None]
) -> list[Trial]:
    """Every solver over the spacings with the paper's bases, and over the bases with its spacing.

    Each face has one of the five parts hidden, in turn.
    """
    settings = [(spacing, PAPER_BASES) for spacing in SPACINGS]
    settings += [(SPACING, count) for count in COUNTS if count != PAPER_BASES]
    parts = list(hidden_parts().values())
    rows = []
    for spacing, count in settings:
        for solver in BOTH:
            for number, face in enumerate(chosen):
                hidden = parts[number % len(parts)]
                rows.append(_trial(model, faces, face, hidden, (solver, spacing, count)))
                done()
    return rows


def _trial(
    model: MorphableModel,
    faces: Faces,
    face: int,
    hidden: NDArray[np.bool_],
    setting: tuple[Solver, int, int],
) -> Trial:
    solver, spacing, count = setting
    count = min(count, model.count)
    target, believed = faces.textures[face], faces.weights[face]
    weight = np.where(hidden, 0, believed).astype(np.float32)
    SOLVERS[solver](model, target, weight * 0 + 1e-3, 16, 1)  # the first call is slower
    start = time.perf_counter()
    coefficients = SOLVERS[solver](model, target, weight, spacing, count)
    seconds = time.perf_counter() - start
    modelled = model.texture(coefficients)
    seen = believed > 0.5
    errors = error(target, modelled, seen), error(target, modelled, seen & hidden)
    return Trial(solver, spacing, setting[2], seconds, *errors)


def fills(model: MorphableModel, faces: Faces, chosen: Sequence[int]) -> list[Fill]:
    """Each part of each face hidden and filled by each method (ridge, spacing 8)."""
    rows = []
    for face in chosen:
        target, believed = faces.textures[face], faces.weights[face]
        for part, hidden in hidden_parts().items():
            weight = np.where(hidden, 0, believed).astype(np.float32)
            where = hidden & (believed > 0.5)
            filled = _filled(model, target, weight)
            rows += [Fill(part, name, error(target, filled[name], where)) for name in METHODS]
    return rows


def _filled(model: MorphableModel, target: Map, weight: Map) -> dict[str, Map]:
    count = min(SHIPPED, model.count)
    modelled = model.texture(SOLVERS["ridge"](model, target, weight, SPACING, count))
    share = np.ascontiguousarray(weight[:, ::-1])[..., None]
    mirrored = share * target[:, ::-1] + (1 - share) * model.mean
    return {
        "mean": model.mean,
        "mirror": mirrored,
        "PCA": modelled,
        "mean + residual": model.mean + carried(target - model.mean, weight),
        "PCA + residual": modelled + carried(target - modelled, weight),
    }
