"""Which blendshapes an exported face has, and what each is in units, mouth and gaze."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import UsageError
from hypermask.face.action_units import NAMES, NUMBERS, unit_weights
from hypermask.face.arkit import BLENDSHAPES, from_arkit
from hypermask.face.drive import Drive
from hypermask.face.emotions import EMOTIONS, emotion_units
from hypermask.face.mouth import MOUTH_SHAPES

Array = NDArray[np.float64]
Shapes = Literal["arkit", "units", "both"]
SHAPES: tuple[Shapes, ...] = ("arkit", "units", "both")

VISEMES = {
    "viseme_aa": "a",
    "viseme_E": "e",
    "viseme_I": "i",
    "viseme_O": "o",
    "viseme_U": "u",
}
"""Usual name of a viseme -> reference shape of the mouth."""


@dataclass(frozen=True)
class Target:
    """One blendshape at 1; eye: 1.0 the face's left eye alone, -1.0 its right one, 0.0 all."""

    name: str
    drive: Drive
    eye: float = 0.0


def targets(shapes: Shapes) -> tuple[Target, ...]:
    """ARKit's 52; or the 44 action units and the five visemes; or both.

    Raises `UsageError` GLTF-SHAPES.
    """
    if shapes not in SHAPES:
        raise UsageError(
            "GLTF-SHAPES", f"there is no set of blendshapes {shapes!r}", "arkit, units or both."
        )
    chosen: list[Target] = []
    if shapes != "units":
        chosen += [_arkit(name) for name in BLENDSHAPES]
    if shapes != "arkit":
        chosen += [Target(f"AU{n}", Drive(unit_weights({str(n): 1.0}))) for n in NUMBERS]
        chosen += [Target(n, Drive(mouth=MOUTH_SHAPES[shape])) for n, shape in VISEMES.items()]
    return tuple(chosen)


def _arkit(name: str) -> Target:
    """One eye's look is its share of both eyes' gaze, so it alone turns by the whole of it."""
    drive = from_arkit({name: 1.0})
    if not name.startswith("eyeLook"):
        return Target(name, drive)
    return Target(
        name,
        Drive(drive.units, drive.mouth, drive.gaze * 2),
        1.0 if name.endswith("Left") else -1.0,
    )


def emotion_clips(shapes: Shapes) -> dict[str, Array]:
    """Emotion -> weights of the targets (T,) that show it; none where units are not exported."""
    if shapes == "arkit":
        return {}
    names = [target.name for target in targets(shapes)]
    clips = {}
    for emotion, halves in zip(EMOTIONS, emotion_units("full"), strict=True):
        weights = np.zeros(len(names))
        for name, weight in zip(NAMES, halves, strict=True):
            row = names.index(f"AU{name[:-1]}")
            weights[row] = max(weights[row], float(weight))
        clips[emotion] = weights
    return clips
