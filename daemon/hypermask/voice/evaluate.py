"""How well a model hears the five vowels, on recordings whose vowels are known."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import UsageError
from hypermask.voice import noise, paper_base, recurrent
from hypermask.voice.calibrate import Take, adapt, halves, heard_shapes
from hypermask.voice.features import HOP
from hypermask.voice.hearing import decided
from hypermask.voice.listening import listen
from hypermask.voice.lpc import FRAME, cepstra
from hypermask.voice.paper_base import PaperBase
from hypermask.voice.recurrent import Recurrent
from hypermask.voice.shapes import SHAPE_NAMES, nearest_shape
from hypermask.voice.speaker import Speaker
from hypermask.voice.visemes import basis_shapes, class_weights
from hypermask.voice.vowels import Vowel, cepstra_of, one_each, read_table, read_vowel

MODELS = ("default", "paper")
_GROUPS = {"m": "men", "w": "women", "b": "boys", "g": "girls"}
_AT_ONCE = 50
_NOTES = {
    "default": "the recurrent network, not calibrated; each recording is heard from its first "
    "sample, and every 10 ms of its nucleus is judged",
    "paper": "the paper's 20-20-13 networks of 100 speakers; for each speaker the one of somebody "
    "else that fits his five vowels best, every 32 ms of the nucleus judged",
}


def evaluate(
    csv_path: Path, model: str = "default", pink_db: float | None = None
) -> dict[str, Any]:
    """Judges every frame of each nucleus by the reference shape nearest to its mouth.

    pink_db: signal-to-noise ratio at which pink noise is added. The mouth is the one before
    loudness scales it. Returns `frame_accuracy` (0 to 1), `groups` (the same for each group of
    speakers), `confusion` ({spoken: {heard: frames}}, "closed" can be heard too), `frames`,
    `recordings`, `speakers`, `model` and a `note` that says what the model is; of the default also
    `to_the_edges`: accuracy and groups over all frames whose middle lies in the nucleus, where the
    others count those that lie in it with 16 ms to either side.

    Raises `UsageError` VOICE-MODEL, `DataError` VOICE-CSV, VOICE-WAV or VOICE-NET.
    """
    if model not in MODELS:
        raise UsageError(
            "VOICE-MODEL", f"there is no voice model '{model}'", f"Use {' or '.join(MODELS)}."
        )
    rows = one_each(read_table(csv_path))
    vowels = [read_vowel(csv_path, row) for row in rows]
    if pink_db is not None:
        rng = np.random.default_rng(0)
        vowels = [in_pink_noise(vowel, pink_db, rng) for vowel in vowels]
    if model == "paper":
        return evaluate_paper(vowels, paper_base.shipped())
    return evaluate_default(vowels, recurrent.shipped())


def evaluate_default(vowels: Sequence[Vowel], network: Recurrent) -> dict[str, Any]:
    scores = _scored("default", vowels, heard_by_default(vowels, network))
    whole = _scored("default", vowels, heard_by_default(vowels, network, to_the_edges=True))
    return scores | {"to_the_edges": {key: whole[key] for key in ("frame_accuracy", "groups")}}


def heard_by_default(
    vowels: Sequence[Vowel], network: Recurrent, to_the_edges: bool = False
) -> list[NDArray[np.intp]]:
    """For each recording the shapes (n,) heard in its nucleus, each 10 ms; see `nucleus`."""
    mouths, shapes = class_weights(), basis_shapes()
    heard = []
    for at in range(0, len(vowels), _AT_ONCE):
        part = vowels[at : at + _AT_ONCE]
        for vowel, one in zip(part, listen(network, [v.samples for v in part]), strict=True):
            chances = one.posteriors(network)[nucleus(vowel, len(one.hidden), to_the_edges)]
            parameters = decided(chances.astype(np.float64), mouths) @ shapes
            heard.append(nearest_shape(parameters, shapes[: len(SHAPE_NAMES)]))
    return heard


def evaluate_calibrated(vowels: Sequence[Vowel], network: Recurrent) -> dict[str, Any]:
    """Every speaker calibrated with half of each of his vowels (blocks of 60 ms by turns) and
    judged by the other half, both ways round; silence is what was recorded before the word."""
    judged: list[Vowel] = []
    shapes: list[NDArray[np.intp]] = []
    for speaker in dict.fromkeys(vowel.speaker for vowel in vowels):
        own = [vowel for vowel in vowels if vowel.speaker == speaker]
        heard = listen(network, [vowel.samples for vowel in own])
        hops = [
            np.arange(len(one.hidden))[nucleus(v, len(one.hidden))]
            for v, one in zip(own, heard, strict=True)
        ]
        parts = [halves(at) for at in hops]
        for learnt in (0, 1):
            takes = {
                vowel.mouth: Take(vowel.mouth, vowel.samples, one, half[learnt], None)
                for vowel, one, half in zip(own, heard, parts, strict=True)
            }
            before = np.arange(2, max(own[0].start // HOP - 12, 5))
            takes["silence"] = Take("silence", own[0].samples, heard[0], before, None)
            correction = adapt(takes, network)[2]
            adapted = (
                network if correction is None else Speaker("", None, correction).adapted(network)
            )
            for vowel, one, half in zip(own, heard, parts, strict=True):
                judged.append(vowel)
                shapes.append(heard_shapes(adapted.posteriors(one.hidden[half[1 - learnt]])))
    return _scored("default", judged, shapes)


def evaluate_paper(vowels: Sequence[Vowel], base: PaperBase) -> dict[str, Any]:
    chosen = {
        speaker: base.network(
            base.choose(cepstra_of([v for v in vowels if v.speaker == speaker]), without=speaker)
        )
        for speaker in {vowel.speaker for vowel in vowels}
    }
    heard = [
        nearest_shape(chosen[vowel.speaker](cepstra(vowel.frames())), base.shapes)
        for vowel in vowels
    ]
    return _scored("paper", vowels, heard)


def nucleus(vowel: Vowel, count: int, to_the_edges: bool = False) -> slice:
    """Hops around whose middle 32 ms lie in the nucleus, the span that paper mode is judged on too,
    or (`to_the_edges`) all whose middle does; at least one of the `count` there are."""
    inset = 0 if to_the_edges else FRAME // 2
    begin = -(-(vowel.start + inset - HOP // 2) // HOP)
    end = (vowel.end - inset - HOP // 2) // HOP + 1
    if end <= begin:
        begin = (vowel.start + vowel.end) // 2 // HOP
        end = begin + 1
    begin = min(begin, count - 1)
    return slice(begin, min(max(end, begin + 1), count))


def in_pink_noise(vowel: Vowel, snr_db: float, rng: np.random.Generator) -> Vowel:
    """The ratio is that of the nucleus to the noise."""
    level = float(np.sqrt(np.mean(vowel.samples[vowel.start : vowel.end] ** 2)))
    pink = noise.coloured(rng, len(vowel.samples), 1.0)
    return Vowel(**{**vars(vowel), "samples": noise.add(vowel.samples, pink, snr_db, level)})


def _scored(
    model: str, vowels: Sequence[Vowel], heard: Sequence[NDArray[np.intp]]
) -> dict[str, Any]:
    right: dict[str, list[bool]] = defaultdict(list)
    confusion = {spoken: dict.fromkeys(SHAPE_NAMES, 0) for spoken in SHAPE_NAMES[1:]}
    for vowel, frames in zip(vowels, heard, strict=True):
        for name in (SHAPE_NAMES[index] for index in frames):
            confusion[vowel.mouth][name] += 1
        right[vowel.group] += (frames == SHAPE_NAMES.index(vowel.mouth)).tolist()
    everything = [frame for frames in right.values() for frame in frames]
    return {
        "model": model,
        "note": _NOTES[model],
        "frame_accuracy": float(np.mean(everything)),
        "groups": _groups(right),
        "confusion": confusion,
        "frames": len(everything),
        "recordings": len(vowels),
        "speakers": len({vowel.speaker for vowel in vowels}),
    }


def _groups(right: dict[str, list[bool]]) -> dict[str, float]:
    named = {_GROUPS.get(group, group): frames for group, frames in sorted(right.items())}
    children = named.get("boys", []) + named.get("girls", [])
    if children:
        named["children"] = children
    return {name: float(np.mean(frames)) for name, frames in named.items()}
