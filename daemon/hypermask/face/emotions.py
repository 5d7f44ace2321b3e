"""Six emotions (PAPERS A4) as combinations of action units: `emotions.toml`."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.config import Settings, load
from hypermask.errors import UsageError
from hypermask.face.action_units import unit_weights

Array = NDArray[np.float64]
Variant = Literal["short", "full"]

EMOTIONS = ("anger", "happiness", "sadness", "disgust", "surprise", "fear")


class EmotionTable(Settings):
    """short, full: emotion -> action unit -> intensity."""

    version: Literal[1]
    short: dict[str, dict[str, float | str]]
    full: dict[str, dict[str, float | str]]


@functools.cache
def emotion_units(variant: Variant = "full") -> Array:
    """(6, 88) intensities of action units for each emotion at weight 1.

    variant: "short", the few units of EMFACS that name the emotion, or "full".
    Raises `ConfigError` CFG-*, `UsageError` FACE-AU, FACE-EMOTION.
    """
    if variant not in ("short", "full"):
        raise UsageError("FACE-EMOTION", f"there is no variant '{variant}'", "Known: short, full.")
    table = load(EmotionTable, Path(__file__).with_name("emotions.toml"))
    combinations = table.short if variant == "short" else table.full
    if set(combinations) != set(EMOTIONS):
        raise _wrong(f"emotions.toml, [{variant}] does not hold the six emotions")
    return np.array([unit_weights(combinations[name]) for name in EMOTIONS])


def emotion_weights(expression: Mapping[str, float] | ArrayLike | None) -> Array:
    """(6,) weights in `EMOTIONS` order, each held within 0 to 1.

    Raises `UsageError` FACE-EMOTION for an unknown name or another shape.
    """
    if expression is None:
        return np.zeros(len(EMOTIONS))
    if isinstance(expression, Mapping):
        unknown = sorted(set(expression) - set(EMOTIONS))
        if unknown:
            raise _wrong(f"there is no emotion '{unknown[0]}'")
        values = np.array([float(expression.get(name, 0.0)) for name in EMOTIONS])
    else:
        values = np.asarray(expression, float)
    if values.shape != (len(EMOTIONS),) or not np.isfinite(values).all():
        raise _wrong("an expression is not six finite weights")
    return np.asarray(np.clip(values, 0, 1))


def _wrong(what: str) -> UsageError:
    return UsageError("FACE-EMOTION", what, f"Known: {', '.join(EMOTIONS)}.")
