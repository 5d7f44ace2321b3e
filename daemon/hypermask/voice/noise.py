"""Noise for training and measuring: what a microphone hears when nobody speaks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hypermask.voice.lpc import RATE_HZ

_Floats = NDArray[np.float64]


def coloured(rng: np.random.Generator, count: int, slope: float) -> _Floats:
    """Noise (count,) of unit rms whose power falls as 1 / f^slope: 0 white, 1 pink, 2 brown."""
    size = max(count, 2)
    spectrum = np.fft.rfft(rng.standard_normal(size))
    frequency = np.fft.rfftfreq(size, 1 / RATE_HZ)
    spectrum *= np.maximum(frequency, 30.0) ** (-slope / 2)
    return unit(np.fft.irfft(spectrum, size)[:count])


def hum(rng: np.random.Generator, count: int) -> _Floats:
    """Mains hum and fans: a low tone with harmonics, unit rms."""
    base = rng.choice([50.0, 60.0, 100.0, 120.0]) * rng.uniform(0.95, 1.05)
    time_s = np.arange(count) / RATE_HZ
    tones = [
        rng.uniform(0, 1) / k * np.sin(2 * np.pi * (k * base * time_s + rng.uniform()))
        for k in range(1, 8)
    ]
    return unit(np.sum(tones, axis=0))


def ambient(rng: np.random.Generator, count: int) -> _Floats:
    """A random stage: coloured noise, now and then with a broad resonance or with hum."""
    sound = coloured(rng, count, rng.uniform(0.0, 2.2))
    if rng.uniform() < 0.3:
        sound = unit(sound + rng.uniform(0.2, 1.0) * hum(rng, count))
    if rng.uniform() < 0.3:
        sound = unit(_resonance(sound, rng.uniform(300, 5000), rng.uniform(800, 3000)))
    return sound


def add(sound: _Floats, noise: _Floats, snr_db: float, level: float) -> _Floats:
    """`sound` with unit-rms `noise` at `snr_db` below the rms `level` of its speech."""
    return np.asarray(sound + noise * level * 10.0 ** (-snr_db / 20))


def unit(sound: _Floats) -> _Floats:
    return np.asarray(sound / max(float(np.sqrt(np.mean(sound**2))), 1e-12))


def _resonance(sound: _Floats, centre_hz: float, width_hz: float) -> _Floats:
    frequency = np.fft.rfftfreq(len(sound), 1 / RATE_HZ)
    gain = 0.1 + 1.0 / (1.0 + ((frequency - centre_hz) / (0.5 * width_hz)) ** 2)
    return np.fft.irfft(np.fft.rfft(sound) * gain, len(sound))
