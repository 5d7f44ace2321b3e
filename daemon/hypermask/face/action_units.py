"""The 44 action units of FACS (PAPERS A4): what each does to the 48 feature points.

The table is `action_units.toml`. A unit's two halves have names of their own: "12L" and "12R" for
the face's own left and right, as in FACS, ARKit and MPEG-4; the face's left is on the audience's
right. "12" is both. Intensities are numbers 0 to 1 or the manual's letters A to E.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from hypermask.config import Settings, parse, read_toml
from hypermask.errors import UsageError
from hypermask.face.features import MIDDLE, ORDER, PAIRS

Array = NDArray[np.float64]

NUMBERS = (1, 2, *range(4, 40), *range(41, 47))
NAMES: tuple[str, ...] = tuple(f"{n}{side}" for n in NUMBERS for side in "LR")
"""The 88 halves, in the order of all arrays here."""
COUNT = len(NAMES)
INTENSITIES = {"": 0.0, "A": 0.1, "B": 0.3, "C": 0.5, "D": 0.75, "E": 1.0}
"""FACS's letters: trace, slight, marked or pronounced, severe or extreme, maximum."""

_NAME = re.compile(r"(?:AU)?_?(\d{1,2})([LR]?)", re.IGNORECASE)
_INDEX = {name: k for k, name in enumerate(NAMES)}
_SIDES = {"L": ("right", 1.0), "R": ("left", -1.0)}
"""The face's own side -> where the audience sees it, and the sign of x there."""

Weights = Mapping[str, float | str]


class UnitTable(Settings):
    """One unit of the table; see the head of `action_units.toml`."""

    name: str
    text: str
    yields: float = Field(0.0, ge=0, le=1)
    lids: float = Field(0.0, ge=0, le=1)
    tongue: float = Field(0.0, ge=0, le=1)
    directed: bool = False
    moves: dict[str, tuple[float, float, float]]


class _Head(Settings):
    version: Literal[1]
    unit: Literal["mm"]


@dataclass(frozen=True)
class ActionUnits:
    """moves: (88, 48, 3) metres at intensity 1, x to the audience's right, y up, z forward;
    yields: (88,); lids: (88, 2) shares of closing, the audience's left eye first; tongue: (88,).
    """

    table: Mapping[int, UnitTable]
    moves: Array
    yields: Array
    lids: Array
    tongue: Array


@functools.cache
def load_action_units(path: Path | None = None) -> ActionUnits:
    """Raises `ConfigError` CFG-* naming the file, the unit and the key."""
    source = path or Path(__file__).with_name("action_units.toml")
    data = read_toml(source)
    head: dict[str, object] = {key: data.pop(key) for key in ("version", "unit") if key in data}
    parse(_Head, head, str(source))
    table = {
        number: parse(UnitTable, data.pop(f"AU{number}", {}), f"{source} [AU{number}]")
        for number in NUMBERS
    }
    parse(Settings, data, str(source))
    moves = np.zeros((COUNT, len(ORDER), 3))
    lids = np.zeros((COUNT, 2))
    for k, (number, side) in enumerate((n, s) for n in NUMBERS for s in "LR"):
        moves[k] = _half(table[number], side) / 1000
        lids[k, 1 if side == "L" else 0] = table[number].lids
    twice = np.repeat([[table[n].yields, table[n].tongue] for n in NUMBERS], 2, axis=0)
    return ActionUnits(table, moves, twice[:, 0], lids, twice[:, 1])


def _half(unit: UnitTable, side: str) -> Array:
    """(48, 3) mm of one half of a unit."""
    where, sign = _SIDES[side]
    given = np.zeros((len(ORDER), 3))
    for point, (out, up, forward) in unit.moves.items():
        if point in PAIRS:
            for place in ("left", "right") if unit.directed else (where,):
                given[ORDER[f"{point}_{place}"]] = sign * out, up, forward
        elif point in MIDDLE:
            share = 1.0 if unit.directed else 0.5
            given[ORDER[point]] = sign * out * share, up * share, forward * share
        else:
            raise UsageError(
                "FACE-POINT",
                f"action_units.toml: there is no feature point '{point}'",
                f"Known: {', '.join((*PAIRS, *MIDDLE))}.",
            )
    return given


def unit_name(name: str) -> tuple[str, ...]:
    """The halves that a name means: "12", "AU12", "au12" -> ("12L", "12R"); "12L" -> ("12L",).

    A unit that goes to one side ("30") means its left half. Raises `UsageError` FACE-AU.
    """
    match = _NAME.fullmatch(str(name).strip())
    if match is None or int(match[1]) not in NUMBERS:
        raise UsageError(
            "FACE-AU",
            f"there is no action unit '{name}'",
            "Known: 1, 2, 4 to 39 and 41 to 46, each also with L or R, as in 12L.",
        )
    number, side = int(match[1]), match[2].upper()
    if not side and number in DIRECTED:
        side = "L"
    return (f"{number}{side}",) if side else (f"{number}L", f"{number}R")


DIRECTED = (30,)
"""Units of which both halves at once would cancel each other."""


def intensity(value: float | str) -> float:
    """0 to 1 for a number or a letter A to E. Raises `UsageError` FACE-AU for any other."""
    number: object = value
    if isinstance(value, str):
        number = INTENSITIES.get(value.strip().upper())
    if isinstance(number, bool) or not isinstance(number, int | float | np.number):
        number = None
    if number is None or not 0 <= float(number) <= 1:
        raise UsageError(
            "FACE-AU",
            f"'{value}' is no intensity of an action unit",
            "Give a number from 0 to 1 or a letter from A to E.",
        )
    return float(number)


def unit_weights(units: Weights | ArrayLike | None) -> Array:
    """(88,) intensities in `NAMES` order, 0 to 1.

    units: by name; or (44,) in `NUMBERS` order, or (88,). A half named beside its whole goes before
    it. An array's values are held within 0 to 1. Raises `UsageError` FACE-AU.
    """
    if units is None:
        return np.zeros(COUNT)
    if isinstance(units, Mapping):
        values = np.zeros(COUNT)
        halves = {str(name): unit_name(str(name)) for name in units}
        for name in sorted(halves, key=lambda n: -len(halves[n])):
            for half in halves[name]:
                values[_INDEX[half]] = intensity(units[name])
        return values
    values = np.asarray(units, float)
    if values.shape == (len(NUMBERS),):
        values = _both(values)
    if values.shape != (COUNT,) or not np.isfinite(values).all():
        raise UsageError(
            "FACE-AU", "action units are not 44 or 88 finite numbers", "Give one for each unit."
        )
    return np.asarray(np.clip(values, 0, 1))


def _both(values: Array) -> Array:
    twice = np.repeat(values, 2)
    for number in DIRECTED:
        twice[_INDEX[f"{number}R"]] = 0
    return twice
