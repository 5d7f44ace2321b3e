"""LPC cepstrum: the spectral envelope of a short frame of speech as a few numbers.

PAPERS.md A6: 16 kHz, frames of 512 samples, order 20. Autocorrelation method with Levinson-Durbin
recursion and the LPC-to-cepstrum recursion (Markel and Gray 1976; Atal 1974), as in SPTK.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

RATE_HZ = 16_000
FRAME = 512  # samples, 32 ms
ORDER = 20

# Mean square below which a frame is silence: far under the last bit of a 16-bit recording.
_SILENCE = 1e-14
# A predictor that leaves less than this part of the power is at the end of the arithmetic.
_LEAST_ERROR = 1e-12

_Floats = NDArray[np.float64]


def window(length: int = FRAME) -> _Floats:
    """Hamming window (length,)."""
    return np.hamming(length)


def autocorrelation(frames: _Floats, order: int = ORDER) -> _Floats:
    """Lags 0 to `order` of each windowed frame: (n, length) -> (n, order + 1)."""
    length = frames.shape[-1]
    lags = [
        np.einsum("ij,ij->i", frames[:, : length - lag], frames[:, lag:])
        for lag in range(order + 1)
    ]
    return np.stack(lags, axis=-1)


def levinson_durbin(correlation: _Floats) -> tuple[_Floats, _Floats]:
    """Linear prediction from autocorrelations (n, order + 1).

    Returns the polynomials (n, order + 1) of 1 + a1 z^-1 + ... and the error powers (n,). Where
    prediction is perfect to rounding (a pure tone) the recursion stops early, so that the result
    stays finite; where lag 0 is silence the polynomial is 1.
    """
    count, order = correlation.shape[0], correlation.shape[1] - 1
    polynomial = np.zeros((count, order + 1))
    polynomial[:, 0] = 1.0
    power = correlation[:, 0].copy()
    least = _LEAST_ERROR * power
    for m in range(1, order + 1):
        alive = power > least
        residual = np.einsum("ij,ij->i", polynomial[:, :m], correlation[:, m:0:-1])
        reflection = np.where(alive, -residual / np.where(alive, power, 1.0), 0.0)
        reflection[np.abs(reflection) >= 1.0] = 0.0
        polynomial[:, 1 : m + 1] += reflection[:, None] * polynomial[:, m - 1 :: -1][:, :m]
        power *= 1.0 - reflection**2
    return polynomial, power


def lpc_to_cepstrum(polynomial: _Floats) -> _Floats:
    """Cepstrum c1 to c_order of 1 / A(z): (n, order + 1) -> (n, order)."""
    order = polynomial.shape[1] - 1
    weighted = np.zeros_like(polynomial)  # column k is k * c_k
    for m in range(1, order + 1):
        product = np.einsum("ij,ij->i", weighted[:, 1:m], polynomial[:, m - 1 : 0 : -1])
        weighted[:, m] = -m * polynomial[:, m] - product
    return weighted[:, 1:] / np.arange(1, order + 1)


def cepstra(frames: ArrayLike, order: int = ORDER) -> _Floats:
    """LPC cepstra (n, order) of frames (n, length); the gain c0 is left out, so level is too.

    Samples that are not finite count as 0. A silent frame gives zeros, a flat spectrum.
    """
    samples = np.nan_to_num(np.asarray(frames, np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    correlation = autocorrelation(samples * window(samples.shape[-1]), order)
    correlation[correlation[:, 0] <= _SILENCE * samples.shape[-1]] = 0.0
    return lpc_to_cepstrum(levinson_durbin(correlation)[0])


class FrameAnalyser:
    """The same cepstrum for one frame at a time, without the overhead of small numpy calls."""

    def __init__(self, length: int = FRAME, order: int = ORDER) -> None:
        self._window = window(length)
        self._order = order
        self._padded = np.zeros(length + order)
        strides = (self._padded.itemsize, self._padded.itemsize)
        self._shifted = np.lib.stride_tricks.as_strided(
            self._padded, (order + 1, length), strides, writeable=False
        )
        self._length = length

    def __call__(self, frame: NDArray[np.floating]) -> _Floats:
        """Cepstrum (order,) of a finite frame (length,)."""
        windowed = self._padded[: self._length]
        np.multiply(frame, self._window, out=windowed)
        correlation = (self._shifted @ windowed).tolist()
        if correlation[0] <= _SILENCE * self._length:
            return np.zeros(self._order)
        return np.array(_cepstrum(_predictor(correlation)))


def _predictor(correlation: list[float]) -> list[float]:
    polynomial = [1.0]
    power = correlation[0]
    least = _LEAST_ERROR * power
    for m in range(1, len(correlation)):
        residual = sum(a * r for a, r in zip(polynomial, correlation[m:0:-1], strict=True))
        reflection = -residual / power if power > least else 0.0
        if abs(reflection) >= 1.0:
            reflection = 0.0
        extended = [*polynomial, 0.0]
        backwards = [0.0, *polynomial[::-1]]
        polynomial = [a + reflection * b for a, b in zip(extended, backwards, strict=True)]
        power *= 1.0 - reflection * reflection
    return polynomial


def _cepstrum(polynomial: list[float]) -> list[float]:
    weighted: list[float] = []
    for m in range(1, len(polynomial)):
        product = sum(c * a for c, a in zip(weighted, polynomial[m - 1 : 0 : -1], strict=True))
        weighted.append(-m * polynomial[m] - product)
    return [value / (m + 1) for m, value in enumerate(weighted)]
