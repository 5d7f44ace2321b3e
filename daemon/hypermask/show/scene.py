"""The scene record: what should be on the mask, as targets with start times.

The stage works the fades out for the moment of the light by itself, so a fade goes on smoothly
when the show process stalls or dies.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hypermask.blackboard import Record
from hypermask.show.showfile import Expression

Array = NDArray[np.float64]

CHARACTERS = 4
EMOTIONS = tuple(Expression.model_fields)
FADE_FIELDS = [("start_s", "<f8"), ("duration_s", "<f8")]

SCENE = np.dtype(
    [
        # The characters of a cross-fade, even of one that interrupts another, and their opacity
        # before and after it.
        ("characters", "S64", (CHARACTERS,)),
        ("previous_opacity", "<f8", (CHARACTERS,)),
        ("opacity", "<f8", (CHARACTERS,)),
        ("character_fade", FADE_FIELDS),
        ("expression", "<f8", (6,)),
        ("previous_expression", "<f8", (6,)),
        ("expression_fade", FADE_FIELDS),
        ("brightness", "<f8"),
        ("previous_brightness", "<f8"),
        ("brightness_fade", FADE_FIELDS),
    ]
)


def progress(fade: Record, time_s: float) -> float:
    """How far a fade has gone at `time_s`: 0 to 1, with a soft start and end (smoothstep)."""
    duration = float(fade["duration_s"])
    if duration <= 0:
        return 1.0
    x = min(max((time_s - float(fade["start_s"])) / duration, 0.0), 1.0)
    return x * x * (3 - 2 * x)


def expression_at(scene: Record, time_s: float) -> Array:
    """(6,) emotion weights at `time_s`."""
    done = progress(scene["expression_fade"], time_s)
    mixed: Array = scene["previous_expression"] * (1 - done) + scene["expression"] * done
    return mixed


def brightness_at(scene: Record, time_s: float) -> float:
    """Brightness 0 to 1 at `time_s`."""
    done = progress(scene["brightness_fade"], time_s)
    return float(scene["previous_brightness"] * (1 - done) + scene["brightness"] * done)


def characters_at(scene: Record, time_s: float) -> list[tuple[str, float]]:
    """(name, opacity) of every character to draw at `time_s`; opacities sum to 1."""
    done = progress(scene["character_fade"], time_s)
    opacities = scene["previous_opacity"] * (1 - done) + scene["opacity"] * done
    named = zip(scene["characters"].tolist(), opacities.tolist(), strict=True)
    return [(name.decode(), opacity) for name, opacity in named if name and opacity > 0]


def describe(scene: Record, time_s: float) -> str:
    """The scene in words: who plays, with which expression."""
    if brightness_at(scene, time_s) <= 0:
        return "blackout"
    name = max(characters_at(scene, time_s), key=lambda item: item[1], default=("", 0.0))[0]
    weights = expression_at(scene, time_s)
    strongest = int(np.argmax(weights))
    mood = EMOTIONS[strongest] if weights[strongest] > 0.3 else "neutral"
    return f"{name}, {mood}"
