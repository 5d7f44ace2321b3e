"""A user's own expressions: files with action units and, if they move, with times (PAPERS A4).

    version = 1
    name = "wry-smile"
    text = "one corner of the mouth knows better"
    rise_s = 0.4
    [units]
    12L = 0.7
    14R = "B"

or, instead of `units`, any number of `[[frames]]` with `time_s` and `units`. Between frames the
units ease over; the last frame stays. They lie in the user's folder or in `configs/expressions`.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hypermask import paths
from hypermask.config import Settings, load
from hypermask.errors import ConfigError, DataError, HypermaskError
from hypermask.face.action_units import COUNT, NAMES, unit_weights
from hypermask.storage import write_atomically

Array = NDArray[np.float64]

VERSION = 1
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


class Frame(Settings):
    time_s: float = Field(ge=0, le=3600)
    units: dict[str, float | str]


class ExpressionFile(Settings):
    version: int
    name: str
    text: str = ""
    rise_s: float = Field(0.35, ge=0, le=60)
    units: dict[str, float | str] | None = None
    frames: tuple[Frame, ...] = ()


@dataclass(frozen=True)
class Expression:
    """times: (n,) seconds, rising; units: (n, 88) intensities in `action_units.NAMES` order."""

    name: str
    text: str
    times: Array
    units: Array

    def at(self, time_s: float) -> Array:
        """(88,) intensities `time_s` after the expression was called; before that none."""
        if time_s >= self.times[-1]:
            return self.peak
        k = int(np.searchsorted(self.times, time_s, side="right"))
        before = self.units[k - 1] if k else np.zeros(COUNT)
        start = self.times[k - 1] if k else 0.0
        share = float(np.clip((time_s - start) / max(self.times[k] - start, 1e-9), 0, 1))
        eased = share * share * (3 - 2 * share)
        return np.asarray(before + eased * (self.units[k] - before))

    @property
    def peak(self) -> Array:
        """(88,) the last frame's intensities: what the expression comes to."""
        return np.asarray(self.units[-1])


def load_expression(path: Path) -> Expression:
    """Raises `ConfigError` CFG-* and EXPR-READ, which name the file and what is wrong in it."""
    data = load(ExpressionFile, path)
    if data.version != VERSION:
        raise _wrong(path, f"its version is {data.version}, known is {VERSION}")
    if not _NAME.fullmatch(data.name):
        raise _wrong(path, f"'{data.name}' cannot be an expression's name")
    if (data.units is None) == (not data.frames):
        raise _wrong(path, "it needs either units or frames")
    frames = data.frames or (Frame(time_s=data.rise_s, units=data.units or {}),)
    times = np.array([frame.time_s for frame in frames])
    if (np.diff(times) <= 0).any():
        raise _wrong(path, "the frames' times do not rise")
    return Expression(data.name, data.text, times, np.array([_units(path, f) for f in frames]))


def _units(path: Path, frame: Frame) -> Array:
    try:
        return unit_weights(frame.units)
    except HypermaskError as error:
        raise ConfigError("EXPR-READ", f"{path}: {error.what}", error.remedy) from error


def save_expression(expression: Expression, folder: Path) -> Path:
    """Write `folder`/NAME.toml whole or not at all. Raises `ConfigError` EXPR-READ, DISK-WRITE."""
    path = folder / f"{expression.name}.toml"
    if not _NAME.fullmatch(expression.name):
        raise _wrong(path, f"'{expression.name}' cannot be an expression's name")
    lines = [f"version = {VERSION}"]
    lines += [f"{key} = {json.dumps(getattr(expression, key))}" for key in ("name", "text")]
    for time_s, units in zip(expression.times, expression.units, strict=True):
        pairs = [f"{NAMES[k]} = {round(float(units[k]), 4)}" for k in np.flatnonzero(units)]
        lines += ["", "[[frames]]", f"time_s = {round(float(time_s), 4)}"]
        lines += [f"units = {{ {', '.join(pairs)} }}" if pairs else "units = {}"]
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(path, ("\n".join(lines) + "\n").encode())
    return path


def _shelves() -> tuple[Path, Path]:
    return paths.home() / "expressions", paths.configs() / "expressions"


def known_expressions() -> list[str]:
    """Names of all expressions, the user's and the built-in ones."""
    return sorted({file.stem for shelf in _shelves() for file in shelf.glob("*.toml")})


def find_expression(name: str | Path) -> Path:
    """The file of an expression by name (the user's first) or by its path.

    Raises `DataError` EXPR-ABSENT, which names the known ones.
    """
    given = Path(name)
    if given.suffix == ".toml" and paths.is_file(given):
        return given
    for shelf in _shelves() if _NAME.fullmatch(str(name)) else ():
        if paths.is_file(shelf / f"{name}.toml"):
            return shelf / f"{name}.toml"
    raise DataError(
        "EXPR-ABSENT",
        f"there is no expression '{name}'",
        f"Known: {', '.join(known_expressions()) or 'none'}.",
    )


def _wrong(path: Path, why: str) -> ConfigError:
    return ConfigError(
        "EXPR-READ",
        f"the expression {path} cannot be used: {why}",
        "Mend the file; configs/expressions holds examples.",
    )
