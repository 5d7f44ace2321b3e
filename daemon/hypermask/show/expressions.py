"""What a cue does to the face: emotions, an expression's file or action units, as timed units."""

from __future__ import annotations

import difflib

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import ConfigError, HypermaskError
from hypermask.face.action_units import unit_weights
from hypermask.face.emotions import EMOTIONS, emotion_units, emotion_weights
from hypermask.face.expressions import (
    Expression,
    find_expression,
    known_expressions,
    load_expression,
)
from hypermask.show.scene import KEYFRAMES
from hypermask.show.showfile import Cue, ShowFile

Array = NDArray[np.float64]

NEUTRAL = "neutral"
_NAMED = 0.3
"""Weight from which a mixture is called by its strongest emotion."""


def expressions_of(show: ShowFile, where: str = "the show") -> dict[str, Expression]:
    """By cue: the face that the cue calls; a cue that leaves the face alone is not there.

    Raises `ConfigError` SHOW-EXPRESSION for an unknown expression or action unit, EXPR-READ and
    CFG-* for an expression's file that cannot be used.
    """
    return {
        name: _expression(cue, show, f"{where}: cue '{name}'")
        for name, cue in show.cues.items()
        if cue.expression is not None or cue.units is not None
    }


def _expression(cue: Cue, show: ShowFile, where: str) -> Expression:
    try:
        added = unit_weights(cue.units)
    except HypermaskError as error:
        raise ConfigError("SHOW-EXPRESSION", f"{where}: {error.what}", error.remedy) from error
    if isinstance(cue.expression, str):
        return _from_file(cue.expression, added, where)
    weights = emotion_weights(None if cue.expression is None else cue.expression.weights())
    units = np.minimum(weights @ emotion_units(show.emotions) + added, 1)
    rise_s = show.fades.expression_s if cue.fade_s is None else cue.fade_s
    return Expression(_mood(weights, added), "", np.array([rise_s]), units[None])


def _from_file(name: str, added: Array, where: str) -> Expression:
    try:
        path = find_expression(name)
    except HypermaskError as error:
        near = difflib.get_close_matches(name, known_expressions(), n=1)
        hint = f"Did you mean '{near[0]}'?" if near else error.remedy
        raise ConfigError("SHOW-EXPRESSION", f"{where}: {error.what}", hint) from error
    found = load_expression(path)
    if len(found.times) > KEYFRAMES:
        raise ConfigError(
            "SHOW-EXPRESSION",
            f"{where}: the expression '{name}' has {len(found.times)} frames",
            f"A show can play at most {KEYFRAMES}.",
        )
    units = np.minimum(found.units + added, 1)
    return Expression(found.name, found.text, found.times, units)


def _mood(weights: Array, added: Array) -> str:
    strongest = int(np.argmax(weights))
    if weights[strongest] > _NAMED:
        return EMOTIONS[strongest]
    return "units" if added.any() else NEUTRAL
