"""Who speaks in the voice's measurement: a person who reads, and voices never trained on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.progress import Progress

from hypermask import paths
from hypermask.errors import DataError
from hypermask.voice import stage_noise, synthesis
from hypermask.voice.features import HOP
from hypermask.voice.lpc import RATE_HZ
from hypermask.voice.material import UNHEARD
from hypermask.voice.noise import ambient
from hypermask.voice.phones import read_phones
from hypermask.voice.resample import resample
from hypermask.voice.synthesis import Phone
from hypermask.voice.visemes import SILENCE
from hypermask.voice.wav import read_wav

READ = "a person reads"
PAUSES = "long pauses with breath and noise"

_VOICES = {"en": "en-us", "es": "es", "de": "de", "ja": "ja"}
_PAUSE_S = (0.4, 2.5)
_NOISE_DB = (-35.0, -12.0)  # of what is heard in a pause, below the voice


@dataclass(frozen=True)
class Spoken:
    """A recording at 16 kHz with its phones."""

    samples: NDArray[np.float64]
    phones: list[Phone]


@dataclass(frozen=True)
class Voice:
    """One voice: sentences to score, and others to calibrate with."""

    set_name: str
    scored: list[Spoken]
    calibration: list[Spoken]


def voices(bar: Progress) -> tuple[list[Voice], list[str]]:
    """Also the names of synthesisers that are not installed. Raises `DataError` BENCH-DATA."""
    found, absent = _read(), []
    makers: list[tuple[str, Callable[[], Iterable[Voice]]]] = [
        ("espeak-ng", _formants), ("flite", _flite), ("Festival", _festival),
    ]  # fmt: skip
    for name, make in bar.track(makers, description="speaking"):
        try:
            found += make()
        except DataError:
            absent.append(name)
    return found, absent


def _read() -> list[Voice]:
    """The read sentences: each calibrated with the others."""
    folder = paths.share().parent / "shared" / "data" / "speech"
    found = [
        Spoken(resample(*read_wav(wav)), read_phones(wav.with_suffix(".phone.json")))
        for wav in sorted(folder.glob("*.wav"))
    ]
    if not found:
        raise DataError(
            "BENCH-DATA",
            "there are no recordings in ../shared/data/speech",
            "Put them there, or choose another measurement.",
        )
    return [Voice(READ, [one], [other for other in found if other is not one]) for one in found]


def _formants() -> Iterable[Voice]:
    espeak = synthesis.espeak()

    def say(lines: Sequence[str], name: str) -> list[Spoken]:
        said = [espeak.say(line, name) for line in lines]
        return [Spoken(one.samples.astype(float), one.phones) for one in said]

    for language, base in _VOICES.items():
        lines = synthesis.sentences(language, "test")
        for k, variant in enumerate(name for name in UNHEARD if name.startswith("+")):
            name, scored = base + variant, lines[k::3]
            taught = say(synthesis.sentences(language, "train")[:6], name)
            yield Voice(f"espeak-ng, {language}", say(scored, name), taught)


def _flite() -> Iterable[Voice]:
    for name in (name for name in UNHEARD if name in synthesis.FLITE_VOICES):
        said = [
            [synthesis.flite(line, name) for line in lines]
            for lines in (synthesis.sentences("en", "test"), synthesis.sentences("en", "train")[:6])
        ]
        yield _joined("flite and Festival", *said)


def _festival() -> Iterable[Voice]:
    for name in (name for name in UNHEARD if name in synthesis.FESTIVAL_VOICES):
        scored = [*synthesis.sentences("es", "test"), *synthesis.sentences("ja-latin", "test")]
        taught = synthesis.sentences("es", "train")[:6]
        said = [synthesis.festival(lines, name) for lines in (scored, taught)]
        yield _joined("flite and Festival", *said)


def _joined(
    name: str, scored: list[synthesis.Utterance], taught: list[synthesis.Utterance]
) -> Voice:
    parts = [[Spoken(u.samples.astype(float), u.phones) for u in said] for said in (scored, taught)]
    return Voice(name, *parts)


# --- what is heard in pauses


def paused(found: Sequence[Voice]) -> list[Voice]:
    """The same synthesised sentences with a pause before and after each, in which somebody
    breathes, walks, claps, plays or touches the microphone."""
    rng = np.random.default_rng(0)
    return [
        Voice(PAUSES, [_with_pauses(one.scored, rng)], one.calibration)
        for one in found
        if one.set_name != READ
    ]


def _with_pauses(said: Sequence[Spoken], rng: np.random.Generator) -> Spoken:
    sounds, phones, at = [], [], 0
    for k, spoken in enumerate([*said, None]):
        level = float(np.sqrt(np.mean(said[min(k, len(said) - 1)].samples ** 2)))
        count = int(rng.uniform(*_PAUSE_S) * RATE_HZ) // HOP * HOP
        make = stage_noise.EVENTS[rng.integers(len(stage_noise.EVENTS))]
        event = make(rng, count) * level * 10 ** (rng.uniform(*_NOISE_DB) / 20)
        sounds.append(event)
        phones.append(Phone(at / RATE_HZ, (at + count) / RATE_HZ, "_", [SILENCE]))
        at += count
        if spoken is not None:
            sounds.append(spoken.samples)
            phones += [
                Phone(p.begin_s + at / RATE_HZ, p.end_s + at / RATE_HZ, p.label, p.classes)
                for p in spoken.phones
            ]
            at += len(spoken.samples)
    sound = np.concatenate(sounds)
    room = ambient(rng, len(sound)) * np.sqrt(np.mean(sound**2)) * 10 ** (-40 / 20)
    return Spoken(sound + room, phones)
