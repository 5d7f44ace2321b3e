"""The show file: which characters play, which cues there are, and which key calls which cue."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from hypermask.config import Settings, load
from hypermask.errors import ConfigError

KEY_NAMES = (
    *"0123456789",
    "dot",
    "enter",
    "plus",
    "minus",
    "star",
    "slash",
    "backspace",
    "numlock",
)

Weight = float


class Expression(Settings):
    """Weights 0 to 1 of the six basic emotions (PAPERS A4); all 0 is neutral."""

    anger: Weight = Field(0.0, ge=0, le=1)
    happiness: Weight = Field(0.0, ge=0, le=1)
    sadness: Weight = Field(0.0, ge=0, le=1)
    disgust: Weight = Field(0.0, ge=0, le=1)
    surprise: Weight = Field(0.0, ge=0, le=1)
    fear: Weight = Field(0.0, ge=0, le=1)

    def weights(self) -> tuple[float, ...]:
        """In the order of the fields above."""
        return tuple(float(getattr(self, name)) for name in type(self).model_fields)


class Life(Settings):
    """What a face does by itself."""

    blinks: bool = True
    gaze: bool = True
    breath: bool = True


class Cue(Settings):
    """What a cue changes; what it does not name stays as it is."""

    expression: Expression | str | None = None
    """Weights of emotions, or the name or path of an expression's file."""
    units: dict[str, float | str] | None = None
    """Action units by name, such as `12L = 0.6` or `4 = "B"`: added to the expression, or alone."""
    life: Life | None = None
    character: str | None = None
    """A name from `characters`, or `next` or `previous`."""
    brightness: float | None = Field(None, ge=0, le=1)
    brightness_step: float | None = Field(None, ge=-1, le=1)
    blackout: Literal["on", "off", "toggle"] | None = None
    gesture: Literal["nod", "shake", "park"] | None = None
    """What the head does, where the mask sits on a pan-tilt unit."""
    look: tuple[float, float] | None = None
    """Where the head looks, pan to the left and tilt up, degrees; a gesture ends there."""
    fade_s: float | None = Field(None, ge=0, le=60)

    @field_validator("look")
    @classmethod
    def _in_range(cls, look: tuple[float, float] | None) -> tuple[float, float] | None:
        if look is not None and not (abs(look[0]) <= 180 and abs(look[1]) <= 90):
            raise ValueError("pan goes from -180 to 180 degrees, tilt from -90 to 90")
        return look


class Fades(Settings):
    """Default cross-fade times in seconds."""

    expression_s: float = Field(0.35, ge=0, le=60)
    character_s: float = Field(0.8, ge=0, le=60)
    brightness_s: float = Field(0.3, ge=0, le=60)
    blackout_s: float = Field(0.25, ge=0, le=60)


class ShowFile(Settings):
    """emotions: which combinations of action units they are, the short ones of EMFACS or the full;
    guests: whether a character made while the show runs joins it; voice_intensity: how far the
    voice drives the expressions' intensity, 0 not at all, 1 from 0.6 (calm) to twice (excited).
    """

    version: Literal[1]
    name: str
    characters: tuple[str, ...] = Field(min_length=1)
    guests: bool = True
    voice_intensity: float = Field(0.0, ge=0, le=1)
    emotions: Literal["full", "short"] = "full"
    life: Life = Life()
    brightness: float = Field(1.0, ge=0, le=1)
    fades: Fades = Fades()
    cues: dict[str, Cue] = Field(default_factory=dict)
    keys: dict[str, str] = Field(default_factory=dict)

    @field_validator("characters")
    @classmethod
    def _distinct(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(names)) != len(names):
            raise ValueError("a character is named twice")
        return names


def load_show(path: Path) -> ShowFile:
    """Raises `ConfigError` CFG-* or SHOW-KEY, SHOW-CUE, SHOW-CHARACTER for a dangling name."""
    show = load(ShowFile, path)
    for key, cue in show.keys.items():
        _require(key, KEY_NAMES, "SHOW-KEY", f"{path}: there is no key '{key}'")
        _require(cue, tuple(show.cues), "SHOW-CUE", f"{path}: key '{key}' calls no cue '{cue}'")
    for name, item in show.cues.items():
        if item.character not in (None, "next", "previous"):
            text = f"{path}: cue '{name}' names no character of this show: '{item.character}'"
            _require(str(item.character), show.characters, "SHOW-CHARACTER", text)
    return show


def _require(name: str, known: tuple[str, ...], code: str, what: str) -> None:
    if name in known:
        return
    near = difflib.get_close_matches(name, known, n=1)
    raise ConfigError(
        code, what, f"Did you mean '{near[0]}'?" if near else f"Known: {', '.join(known)}."
    )
