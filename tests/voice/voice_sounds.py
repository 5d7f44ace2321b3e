"""Sounds with known contents for the tests of the voice."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hypermask.voice.noise import coloured
from hypermask.voice.vowels import Vowel, read_table, read_vowel

DATA = Path(__file__).parents[2].parent / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the recordings in ../shared are absent")

WORDS = {"a": "ah", "i": "iy", "u": "uw", "e": "eh", "o": "oa"}
"""The vowels that a lesson asks for, and their names among the recordings."""

# Of each vowel's blocks of 60 ms those of even number teach and those of odd number examine.
BLOCK = 960

# Peterson and Barney 1952, men: frequencies of the first three formants in Hz.
FORMANTS = {"a": (730, 1090, 2440), "i": (270, 2290, 3010), "u": (300, 870, 2240)}


def spoken(vowel: str, duration_s: float, rate_hz: int = 16_000, level_db: float = -20.0):
    """A voice: pulses at 120 Hz through three resonances; (n,) float32 at `level_db` rms."""
    count = round(duration_s * rate_hz)
    sound = np.diff(np.floor(np.arange(count + 1) * 120.0 / rate_hz))
    for formant in FORMANTS[vowel]:
        sound = _resonance(sound, formant, 60 + 0.05 * formant, rate_hz)
    return at_level(sound, level_db)


def _resonance(sound, frequency_hz, width_hz, rate_hz):
    radius = np.exp(-np.pi * width_hz / rate_hz)
    one, two = 2 * radius * np.cos(2 * np.pi * frequency_hz / rate_hz), -(radius**2)
    output = np.zeros(len(sound) + 2)
    for n, x in enumerate(sound):
        output[n + 2] = x + one * output[n + 1] + two * output[n]
    return output[2:]


def noise(duration_s: float, level_db: float, slope: float = 1.0, seed: int = 0):
    rng = np.random.default_rng(seed)
    return at_level(coloured(rng, round(16_000 * duration_s), slope), level_db)


def silence(duration_s: float, rate_hz: int = 16_000):
    return np.zeros(round(duration_s * rate_hz), np.float32)


def at_level(sound, level_db):
    rms = np.sqrt(np.mean(np.square(sound)))
    return (sound / rms * 10 ** (level_db / 20)).astype(np.float32)


def recorded(speaker: str, vowel: str) -> Vowel:
    table = DATA / "vowels" / "vowels.csv"
    rows = [r for r in read_table(table) if (r["speaker"], r["vowel"]) == (speaker, vowel)]
    return read_vowel(table, rows[0])


@cache
def halves(who: str, vowel: str) -> tuple[np.ndarray, np.ndarray]:
    """What the actor says when asked, and what the mouth is judged by afterwards."""
    word = recorded(who, WORDS[vowel])
    nucleus = word.samples[word.start : word.end]
    even = np.arange(len(nucleus)) // BLOCK % 2 == 0
    return tuple(_held(nucleus[part]) for part in (even, ~even))  # type: ignore[return-value]


def _held(sound: np.ndarray) -> np.ndarray:
    """To and fro, as one who holds a vowel for a good half second."""
    fade = np.minimum(np.arange(9600) / 320, 1) * np.minimum(np.arange(9600)[::-1] / 320, 1)
    return np.resize(np.concatenate([sound, sound[::-1]]), 9600) * fade


def said(who: str, asked: str) -> np.ndarray:
    return np.zeros(0) if asked == "silence" else halves(who, asked)[0]
