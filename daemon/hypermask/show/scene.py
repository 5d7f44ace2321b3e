"""The scene record: what should be on the mask, as targets with start times.

The stage works the fades out for the moment of the light by itself, so a fade goes on smoothly
when the show process stalls or dies.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hypermask.blackboard import Record
from hypermask.face.action_units import COUNT
from hypermask.face.expressions import Expression
from hypermask.face.life import Life
from hypermask.show.fades import brightness_at, characters_at, ease, progress

__all__ = ["brightness_at", "characters_at", "ease", "progress"]

Array = NDArray[np.float64]

CHARACTERS = 4
KEYFRAMES = 16
"""The longest expression that a show can play."""
USUAL_AROUSAL = 0.25
_PER_AROUSAL = 1.6
FADE_FIELDS = [("start_s", "<f8"), ("duration_s", "<f8")]

SCENE = np.dtype(
    [
        # The characters of a cross-fade, even of one that interrupts another, and their opacity
        # before and after it.
        ("characters", "S64", (CHARACTERS,)),
        ("previous_opacity", "<f8", (CHARACTERS,)),
        ("opacity", "<f8", (CHARACTERS,)),
        ("character_fade", FADE_FIELDS),
        # The face that was there fades out while the new one's keyframes run from the fade's start.
        ("mood", "S64"),
        ("previous_units", "<f4", (COUNT,)),
        ("frames", "<i4"),
        ("frame_times", "<f4", (KEYFRAMES,)),
        ("frame_units", "<f4", (KEYFRAMES, COUNT)),
        ("expression_fade", FADE_FIELDS),
        ("voice_intensity", "<f8"),
        ("life", [("blinks", "?"), ("gaze", "?"), ("breath", "?")]),
        ("brightness", "<f8"),
        ("previous_brightness", "<f8"),
        ("brightness_fade", FADE_FIELDS),
    ]
)


def show_expression(scene: Record, face: Expression, fade_s: float, time_s: float) -> None:
    """From `time_s` on `face` comes, and what was there goes within `fade_s`."""
    count = len(face.times)
    scene["previous_units"] = units_at(scene, time_s)
    scene["mood"] = face.name.encode()
    scene["frames"] = count
    scene["frame_times"][:count] = face.times
    scene["frame_units"][:count] = face.units
    scene["expression_fade"] = (time_s, fade_s)


def units_at(scene: Record, time_s: float) -> Array:
    """(88,) intensities of the action units at `time_s`, in `face.action_units.NAMES` order."""
    gone = progress(scene["expression_fade"], time_s)
    units = scene["previous_units"].astype(float) * (1 - gone)
    come = _come(scene, time_s - float(scene["expression_fade"]["start_s"]))
    # A face that is there from its first moment on comes as the other one goes, not at a blow.
    share = 1.0 if scene["frames"] and scene["frame_times"][0] > 0 else gone
    return np.asarray(np.minimum(units + share * come, 1))


def intensity(scene: Record, arousal: float) -> float:
    """What the voice makes of an expression's intensity: 1 for a voice as usual or a show that does
    not ask for it, 0.6 at the least in calm and silence, 2 at the most for an excited voice.

    arousal: 0 to 1, `USUAL_AROUSAL` as usual (`voice.arousal`). PAPERS A6: announced next.
    """
    share = float(scene["voice_intensity"])
    above = max(arousal, 0.0) - USUAL_AROUSAL
    return 1 - share + share * min(1 + above * _PER_AROUSAL, 2.0)


def _come(scene: Record, since_s: float) -> Array:
    """What of the new face is there: its keyframes, eased between, before the first from none."""
    count = int(scene["frames"])
    times, units = scene["frame_times"][:count], scene["frame_units"][:count]
    after = int(np.searchsorted(times, since_s, side="right"))
    if not count or after == count:
        return units[-1].astype(float) if count else np.zeros(COUNT)
    end_s, end = float(times[after]), units[after]
    start_s, start = (float(times[after - 1]), units[after - 1]) if after else (0.0, 0 * end)
    share = ease((since_s - start_s) / (end_s - start_s)) if end_s > start_s else 1.0
    return np.asarray(start + share * (end - start), float)


def life_of(scene: Record) -> Life:
    """What a face does by itself while nothing is asked of it."""
    return Life(*(bool(scene["life"][name]) for name in ("blinks", "gaze", "breath")))


def describe(scene: Record, time_s: float) -> str:
    """The scene in words: who plays, with which expression."""
    if brightness_at(scene, time_s) <= 0:
        return "blackout"
    name = max(characters_at(scene, time_s), key=lambda item: item[1], default=("", 0.0))[0]
    return f"{name}, {bytes(scene['mood'].item()).decode() or 'neutral'}"
