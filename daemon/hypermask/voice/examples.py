"""From one speaker's recordings to training examples of the paper's network."""

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

# An eighth of a frame's period of the paper; neighbours differ enough to be worth learning from.
_HOP = 64
_NOISE_FRAMES = 800
# "haid" glides from /e/ towards /i/: only its beginning teaches /e/.
_STEADY_PART = {"ei": 0.6}


@dataclass(frozen=True)
class Examples:
    """cepstra (n, 20) and shape (n,), an index into `SHAPE_NAMES`."""

    cepstra: NDArray[np.float64]
    shape: NDArray[np.intp]


def examples(vowels: Sequence[Vowel], rng: np.random.Generator) -> Examples:
    """PAPERS A6: the vowels with their shapes, ambient noise with the closed mouth."""
    return _join([_ambient(vowels, rng), *(_taught(vowel) for vowel in vowels)])


def _taught(vowel: Vowel) -> Examples:
    frames = vowel.frames(_HOP)
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
