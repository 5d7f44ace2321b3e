"""From recordings to training examples: cepstra and the mouth shape each belongs to."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.voice import noise
from hypermask.voice.lpc import FRAME, cepstra
from hypermask.voice.shapes import CLOSED, SHAPE_NAMES
from hypermask.voice.vowels import Vowel

# A quarter of a frame's period of the paper; neighbours differ enough to be worth learning from.
_HOP = 64
_NOISE_FRAMES = 4000
_NOISY_COPIES = 3
# "haid" glides from /e/ towards /i/: only its beginning teaches /e/.
_STEADY_PART = {"ei": 0.6}


@dataclass(frozen=True)
class Recipe:
    """What a network is taught with."""

    noisy: bool  # vowels in noise and with coloured microphones too, not in silence only
    note: str


RECIPES = {
    "paper": Recipe(
        noisy=False,
        note="the paper's 20-20-13 network on LPC cepstra of clean vowels and ambient noise, "
        "but one for all speakers instead of the best of 100 speakers' own",
    ),
    "default": Recipe(
        noisy=True,
        note="the 20-20-13 network on LPC cepstra, one for all speakers, taught with vowels in "
        "many noises and microphones",
    ),
}


@dataclass(frozen=True)
class Examples:
    """cepstra (n, 20) and shape (n,), an index into `SHAPE_NAMES`."""

    cepstra: NDArray[np.float64]
    shape: NDArray[np.intp]


def examples(vowels: Sequence[Vowel], recipe: Recipe, rng: np.random.Generator) -> Examples:
    parts = [_ambient(vowels, rng)]
    for vowel in vowels:
        parts.append(_taught(vowel, _HOP))
        if recipe.noisy:
            parts += [_noisy(vowel, rng) for _ in range(_NOISY_COPIES)]
    return _join(parts)


def _taught(vowel: Vowel, hop: int) -> Examples:
    frames = vowel.frames(hop)
    steady = math.ceil(_STEADY_PART.get(vowel.vowel, 1.0) * len(frames))
    return _of(frames[:steady], SHAPE_NAMES.index(vowel.mouth))


def _of(frames: NDArray[np.float64], shape: int) -> Examples:
    return Examples(cepstra(frames), np.full(len(frames), shape))


def _join(parts: Iterable[Examples]) -> Examples:
    parts = list(parts)
    return Examples(
        np.concatenate([part.cepstra for part in parts]),
        np.concatenate([part.shape for part in parts]),
    )


def _ambient(vowels: Sequence[Vowel], rng: np.random.Generator) -> Examples:
    """Synthetic noise, and the rooms of the recordings before anybody speaks."""
    synthetic = [noise.ambient(rng, 4 * FRAME).reshape(4, FRAME) for _ in range(_NOISE_FRAMES // 4)]
    rooms = [vowel.samples[:FRAME] for vowel in vowels if vowel.start >= 2 * FRAME]
    frames = np.concatenate([*synthetic, np.array(rooms).reshape(-1, FRAME)])
    return _of(frames, CLOSED)


def _noisy(vowel: Vowel, rng: np.random.Generator) -> Examples:
    sound = _microphone(vowel.samples, rng)
    level = float(np.sqrt(np.mean(sound[vowel.start : vowel.end] ** 2)))
    snr_db = rng.uniform(5, 35)
    mixed = noise.add(sound, noise.ambient(rng, len(sound)), snr_db, level)
    heard = Vowel(
        vowel.speaker, vowel.group, vowel.vowel, vowel.mouth, mixed, vowel.start, vowel.end
    )
    return _taught(heard, 2 * _HOP)


def _microphone(sound: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """A mild tilt of the spectrum, as another microphone or a mask would give."""
    tilt = rng.uniform(-0.25, 0.25)
    return np.asarray(sound + tilt * np.concatenate([[0.0], sound[:-1]]))
