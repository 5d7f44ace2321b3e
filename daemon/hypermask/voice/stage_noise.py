"""Noises of a stage for training and measuring: nobody speaks in them, or others do far away."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hypermask.voice.lpc import RATE_HZ
from hypermask.voice.noise import ambient, coloured, unit

_Floats = NDArray[np.float64]


def applause(rng: np.random.Generator, count: int) -> _Floats:
    """Claps, each a burst of noise in a band of its own, a few to hundreds a second."""
    sound = np.zeros(count + RATE_HZ)
    for at in rng.integers(0, count, int(rng.uniform(3, 150) * count / RATE_HZ)):
        size = int(rng.uniform(0.01, 0.05) * RATE_HZ)
        burst = rng.standard_normal(size) * np.exp(-np.arange(size) / (0.2 * size))
        tone = np.cos(2 * np.pi * rng.uniform(700, 3000) * np.arange(size) / RATE_HZ)
        sound[at : at + size] += rng.uniform(0.2, 1) * burst * (1 + tone)
    return unit(sound[:count])


def footsteps(rng: np.random.Generator, count: int) -> _Floats:
    """Thumps on boards, with a click of the heel."""
    sound = np.zeros(count + RATE_HZ)
    at = int(rng.uniform(0, 0.6) * RATE_HZ)
    while at < count:
        size = int(rng.uniform(0.06, 0.2) * RATE_HZ)
        time_s = np.arange(size) / RATE_HZ
        thump = np.sin(2 * np.pi * rng.uniform(50, 180) * time_s) * np.exp(-time_s / 0.03)
        click = 0.3 * rng.uniform() * rng.standard_normal(size) * np.exp(-time_s / 0.004)
        sound[at : at + size] += thump + click
        at += int(rng.uniform(0.3, 0.9) * RATE_HZ)
    return unit(sound[:count])


def music(rng: np.random.Generator, count: int) -> _Floats:
    """Chords of struck or bowed tones."""
    sound = np.zeros(count)
    time_s = np.arange(count) / RATE_HZ
    at_s = 0.0
    while at_s < count / RATE_HZ:
        length_s = rng.uniform(0.15, 1.2)
        rise_s, fall_s = rng.uniform(0.004, 0.1), rng.uniform(0.1, 1.0)
        since_s = time_s - at_s
        shape = np.where(
            (since_s > 0) & (since_s < 3 * length_s),
            np.minimum(since_s / rise_s, 1) * np.exp(-np.maximum(since_s, 0) / fall_s),
            0,
        )
        for _ in range(rng.integers(1, 5)):
            pitch = 55 * 2 ** rng.uniform(0, 4)
            for harmonic in range(1, rng.integers(2, 9)):
                if harmonic * pitch < 7500:
                    phase = 2 * np.pi * (harmonic * pitch * time_s + rng.uniform())
                    sound += shape * np.sin(phase) / harmonic ** rng.uniform(0.7, 2)
        at_s += length_s
    return unit(sound)


def breath(rng: np.random.Generator, count: int) -> _Floats:
    """Breathing in and out: noise of the vocal tract without a voice, seconds apart."""
    sound = np.zeros(count)
    at = int(rng.uniform(0, 0.8) * RATE_HZ)
    while at < count:
        size = min(int(rng.uniform(0.2, 0.8) * RATE_HZ), count - at)
        swell = np.sin(np.pi * np.arange(size) / max(size, 1)) ** 2
        puff = coloured(rng, size, rng.uniform(-0.5, 1.0))
        lag = int(rng.integers(3, 12))
        echo = np.concatenate([np.zeros(lag), puff])[:size]
        sound[at : at + size] += swell * (puff + rng.uniform(-0.8, 0.8) * echo)
        at += size + int(rng.uniform(0.3, 2.0) * RATE_HZ)
    return unit(sound)


def clicks(rng: np.random.Generator, count: int) -> _Floats:
    """Cables, touches of the microphone, crackle."""
    sound = 0.01 * rng.standard_normal(count + RATE_HZ)
    for at in rng.integers(0, count, max(int(rng.uniform(1, 8) * count / RATE_HZ), 1)):
        size = int(10 ** rng.uniform(0.5, 3))
        sound[at : at + size] += (
            rng.uniform(0.3, 1)
            * rng.standard_normal(size)
            * np.exp(-np.arange(size) / (0.3 * size))
        )
    return unit(sound[:count])


EVENTS: tuple[Callable[[np.random.Generator, int], _Floats], ...] = (
    applause, footsteps, music, breath, clicks,
)  # fmt: skip


def stage(rng: np.random.Generator, count: int) -> _Floats:
    """A room, and often something that happens in it; unit rms."""
    sound = ambient(rng, count)
    if rng.uniform() < 0.5:
        event = EVENTS[rng.integers(len(EVENTS))](rng, count)
        sound = unit(sound * 10 ** rng.uniform(-1.5, 0.2) + event)
    return sound


def microphone(sound: _Floats, rng: np.random.Generator) -> _Floats:
    """A microphone in a mask: tilt, resonances of the cavity, a limited band, sometimes a room."""
    count = len(sound)
    size = 1 << (count - 1).bit_length()
    frequency = np.fft.rfftfreq(size, 1 / RATE_HZ)
    octaves = np.log2(np.maximum(frequency, 40) / 1000)
    gain_db = rng.uniform(-3, 3) * octaves
    for _ in range(rng.integers(0, 4)):
        centre = 2 ** rng.uniform(-2, 2.5)
        gain_db += rng.uniform(-8, 8) / (
            1 + ((octaves - np.log2(centre)) / rng.uniform(0.1, 0.6)) ** 2
        )
    if rng.uniform() < 0.25:
        gain_db -= 12 * np.maximum(octaves - np.log2(rng.uniform(3.2, 7)), 0)
    if rng.uniform() < 0.4:
        gain_db -= 12 * np.maximum(np.log2(rng.uniform(0.08, 0.3)) - octaves, 0)
    spectrum = np.fft.rfft(sound, size) * 10 ** (gain_db / 20)
    if rng.uniform() < 0.2:
        tail = int(rng.uniform(0.05, 0.35) * RATE_HZ)
        answer = rng.standard_normal(tail) * np.exp(-5 * np.arange(tail) / tail)
        answer *= 10 ** (rng.uniform(-22, -8) / 20) / np.sqrt(np.sum(answer**2))
        answer[0] = 1.0
        spectrum *= np.fft.rfft(answer, size)
    return np.asarray(np.fft.irfft(spectrum, size)[:count])
