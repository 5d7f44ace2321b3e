"""How well a network hears the five vowels, on recordings whose vowels are known."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from hypermask.errors import UsageError
from hypermask.voice import network
from hypermask.voice.examples import RECIPES
from hypermask.voice.lpc import cepstra
from hypermask.voice.shapes import SHAPE_NAMES, nearest_shape
from hypermask.voice.vowels import one_each, read_table, read_vowel

_GROUPS = {"m": "men", "w": "women", "b": "boys", "g": "girls"}


def evaluate(csv_path: Path, model: str = "default") -> dict[str, Any]:
    """Judges every 32 ms frame of each nucleus by the reference shape nearest to its mouth.

    Returns `frame_accuracy` (0 to 1), `groups` (the same for each group of speakers), `confusion`
    ({spoken: {heard: frames}}, "closed" can be heard too), `frames`, `recordings`, `model` and a
    `note` that says what the model is.

    Raises `UsageError` VOICE-MODEL, `DataError` VOICE-CSV, VOICE-WAV or VOICE-NET.
    """
    if model not in RECIPES:
        raise UsageError(
            "VOICE-MODEL", f"there is no voice model '{model}'", f"Choose {' or '.join(RECIPES)}."
        )
    net = network.shipped(model)
    rows = one_each(read_table(csv_path))
    right: dict[str, list[bool]] = defaultdict(list)
    confusion = {spoken: dict.fromkeys(SHAPE_NAMES, 0) for spoken in SHAPE_NAMES[1:]}
    for row in rows:
        vowel = read_vowel(csv_path, row)
        heard = nearest_shape(net(cepstra(vowel.frames())), net.shapes)
        for name in (SHAPE_NAMES[index] for index in heard):
            confusion[vowel.mouth][name] += 1
        right[vowel.group] += (heard == SHAPE_NAMES.index(vowel.mouth)).tolist()
    everything = [frame for frames in right.values() for frame in frames]
    return {
        "model": model,
        "note": RECIPES[model].note,
        "frame_accuracy": float(np.mean(everything)),
        "groups": _groups(right),
        "confusion": confusion,
        "frames": len(everything),
        "recordings": len(rows),
    }


def _groups(right: dict[str, list[bool]]) -> dict[str, float]:
    named = {_GROUPS.get(group, group): frames for group, frames in sorted(right.items())}
    children = named.get("boys", []) + named.get("girls", [])
    if children:
        named["children"] = children
    return {name: float(np.mean(frames)) for name, frames in named.items()}
