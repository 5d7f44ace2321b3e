"""Streams sound of any rate to 16 kHz with less than 2 ms of delay and no drift.

Windowed-sinc interpolation (Smith, "Digital Audio Resampling"); positions are exact integers, so
that an hour later sample k is still sample k.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.voice.lpc import RATE_HZ

_ZERO_CROSSINGS = 12
_PASS = 0.92  # of the lower Nyquist frequency
_MOST_PHASES = 512

_Floats = NDArray[np.float64]


class Resampler:
    """Sample k of the output is the sound k / 16000 s after the first sample of the input."""

    def __init__(self, rate_hz: float) -> None:
        """Raises `DataError` VOICE-RATE for a rate outside 4 to 768 kHz."""
        if not 4_000 <= rate_hz <= 768_000:
            raise DataError(
                "VOICE-RATE",
                f"a sampling rate of {rate_hz:g} Hz cannot be used",
                "Choose 8000 to 192000 Hz; 16000 and 48000 are best.",
            )
        ratio = Fraction(rate_hz).limit_denominator(1000) / RATE_HZ
        self._step, self._unit = ratio.numerator, ratio.denominator
        cutoff = 0.5 * _PASS * min(1.0, RATE_HZ / rate_hz)  # cycles per input sample
        self._half = 1 if ratio == 1 else int(np.ceil(_ZERO_CROSSINGS / (2 * cutoff)))
        self._phases = min(self._unit, _MOST_PHASES)
        self._kernels = _kernels(self._half, cutoff, self._phases)
        self.delay_s = 0.0 if ratio == 1 else self._half / rate_hz
        self.reset()

    def reset(self) -> None:
        self._given = 0  # output samples so far
        self._first = -self._half  # input position of the buffer's first sample
        self._buffer: _Floats = np.zeros(self._half)

    def process(self, samples: NDArray[np.floating]) -> _Floats:
        """Input (n,) to as many output samples (m,) as are certain now."""
        if self._step == self._unit:
            return np.asarray(samples, np.float64)
        self._buffer = np.concatenate([self._buffer, samples])
        last = self._first + len(self._buffer) - 1
        # Output k needs the input up to floor(k * step / unit) + half.
        count = ((last - self._half + 1) * self._unit - 1) // self._step + 1
        k = np.arange(self._given, max(count, self._given), dtype=np.int64)
        output = self._interpolate(k * self._step)
        self._given += len(k)
        keep = self._given * self._step // self._unit - self._half + 1
        self._buffer = self._buffer[max(keep - self._first, 0) :]
        self._first = max(keep, self._first)
        return output

    def _interpolate(self, positions: NDArray[np.int64]) -> _Floats:
        """positions: in units of 1 / unit input samples."""
        if len(positions) == 0:
            return np.zeros(0)
        rows = np.lib.stride_tricks.sliding_window_view(self._buffer, 2 * self._half)
        if self._unit == 1:  # 32, 48, 96 or 192 kHz: always the same kernel, no gathering
            first = int(positions[0]) - self._half + 1 - self._first
            return np.asarray(rows[first :: self._step][: len(positions)] @ self._kernels[0])
        whole, part = np.divmod(positions, self._unit)
        phase = (part * self._phases * 2 + self._unit) // (2 * self._unit)
        taken = rows[whole - self._half + 1 - self._first]
        return np.asarray(np.einsum("ij,ij->i", taken, self._kernels[phase]))


def _kernels(half: int, cutoff: float, phases: int) -> _Floats:
    """(phases + 1, 2 * half): taps for a point p / phases after the tap `half - 1`."""
    offsets = np.arange(-half + 1, half + 1)[None] - np.linspace(0, 1, phases + 1)[:, None]
    taper = np.cos(0.5 * np.pi * np.clip(offsets / half, -1, 1)) ** 2
    taps = np.sinc(2 * cutoff * offsets) * taper
    return np.asarray(taps / taps.sum(axis=1, keepdims=True))


def resample(samples: NDArray[np.floating], rate_hz: float) -> _Floats:
    """A whole recording at 16 kHz."""
    resampler = Resampler(rate_hz)
    tail = np.zeros(int(np.ceil(resampler.delay_s * rate_hz)) + 1)
    output = resampler.process(np.concatenate([np.asarray(samples, np.float64), tail]))
    return output[: int(np.ceil(len(samples) * RATE_HZ / rate_hz))]
