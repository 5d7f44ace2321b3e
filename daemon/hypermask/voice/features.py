"""What the recurrent network hears: a log-mel spectrum each 10 ms, made independent of gain.

Windows of 25 ms at 16 kHz. Two levels are followed for each stream: that of the voice and, band by
band, that of the noise behind it; the network gets the spectrum relative to both. All steps work on
a batch of streams at once, so that training and the show run the same code.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.voice.lpc import RATE_HZ

WINDOW = 400  # samples, 25 ms
HOP = 160  # samples, 10 ms
HOP_S = HOP / RATE_HZ
BANDS = 32
FEATURES = BANDS + BANDS // 2 + 4

_FFT = 1024
_CHUNK = 50
_LOWEST_HZ, _HIGHEST_HZ = 80.0, 7600.0
_LOWEST_PITCH_HZ, _HIGHEST_PITCH_HZ = 75.0, 420.0
_VOICE_BAND_HZ = (80.0, 1800.0)  # outside it are rumble and hiss
_MIDDLE_PITCH_HZ = 180.0
_VOICED = 0.3  # of `voicing`: below it a pitch means nothing
_FAINTEST = 1e-10  # mean square, -100 dB full scale

_FALL_S, _RISE_DB_S = 0.08, 4.0  # of the noise floor
_ATTACK_S, _DECAY_DB_S = 0.04, 3.0  # of the voice's level
_FIRST_FLOOR_DB, _FIRST_VOICE_DB = -50.0, -35.0
_LEAST_VOICE_DB = -62.0
_MARGIN_DB = 10.0  # a voice is at least so far above the floor

_Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Spectrum:
    """bands_db (..., 32): power in dB full scale; voicing (...,): 0 to 1; pitch_hz (...,)."""

    bands_db: _Floats
    voicing: _Floats
    pitch_hz: _Floats


class LogMel:
    """Mel filters of O'Shaughnessy 1987; voicing by autocorrelation (Boersma 1993)."""

    def __init__(self) -> None:
        window = np.hanning(WINDOW + 2)[1:-1]
        self._window = (window / np.sqrt(np.sum(window**2))).astype(np.float32)
        frequency = np.asarray(np.fft.rfftfreq(_FFT, 1 / RATE_HZ), np.float64)
        self._filters = _mel_filters(frequency)
        inside = (frequency >= _VOICE_BAND_HZ[0]) & (frequency <= _VOICE_BAND_HZ[1])
        self._band = slice(*np.flatnonzero(inside)[[0, -1]] + [0, 1])
        self._lags = slice(int(RATE_HZ / _HIGHEST_PITCH_HZ), int(RATE_HZ / _LOWEST_PITCH_HZ) + 1)
        taper = np.fft.irfft(np.abs(np.fft.rfft(window, _FFT)) ** 2)
        lags = np.arange(self._lags.start, self._lags.stop)
        bins = np.arange(self._band.start, self._band.stop)
        cosines = np.cos(2 * np.pi / _FFT * np.outer(bins, lags))
        self._correlate = (cosines * taper[0] / taper[lags]).astype(np.float32)

    def __call__(self, frames: NDArray[np.floating]) -> Spectrum:
        """frames (..., 400), finite."""
        if frames.ndim == 2 and len(frames) > _CHUNK:  # what fits the cache is twice as fast
            parts = [self(frames[at : at + _CHUNK]) for at in range(0, len(frames), _CHUNK)]
            return Spectrum(
                np.concatenate([part.bands_db for part in parts]),
                np.concatenate([part.voicing for part in parts]),
                np.concatenate([part.pitch_hz for part in parts]),
            )
        windowed = np.asarray(frames, np.float32) * self._window
        transform = np.fft.rfft(windowed, _FFT)
        power = (transform.real**2 + transform.imag**2).astype(np.float32)
        bands = power @ self._filters
        voice = power[..., self._band]
        lags = voice @ self._correlate  # the autocorrelation at the lags of a voice's pitch
        best = np.argmax(lags, axis=-1)
        peak = np.take_along_axis(lags, best[..., None], -1)[..., 0]
        voicing = peak / np.maximum(voice.sum(axis=-1), 1e-6)
        return Spectrum(
            10 * np.log10(bands + np.float32(_FAINTEST)),
            np.clip(voicing, 0, 1).astype(np.float32),
            (RATE_HZ / (self._lags.start + best)).astype(np.float32),
        )


def _mel_filters(frequency: NDArray[np.float64]) -> _Floats:
    """(bins, 32): triangles, of unit sum over white noise's power, so that bands are comparable."""
    edges_mel = np.linspace(_mel(_LOWEST_HZ), _mel(_HIGHEST_HZ), BANDS + 2)
    edges = 700 * (np.exp(edges_mel / 1127) - 1)
    rising = (frequency[:, None] - edges[:-2]) / (edges[1:-1] - edges[:-2])
    falling = (edges[2:] - frequency[:, None]) / (edges[2:] - edges[1:-1])
    filters = np.maximum(np.minimum(rising, falling), 0)
    return np.asarray(filters * 2 / _FFT, np.float32)


def _mel(hertz: float) -> float:
    return float(1127 * np.log1p(hertz / 700))


class Normaliser:
    """Follows the level of the voice and of the noise; one for a batch of streams.

    Both levels are bounded, so an hour of silence ends where a minute of it does.
    """

    def __init__(self, streams: int = 1) -> None:
        self._floor_db = np.full((streams, BANDS), np.nan, np.float32)
        self._voice_db = np.full(streams, np.nan, np.float32)

    @property
    def voice_db(self) -> _Floats:
        return self._voice_db

    def start(self, floor_db: _Floats, voice_db: _Floats) -> None:
        """Go on from levels (streams, 32) and (streams,) known before."""
        self._floor_db[:], self._voice_db[:] = floor_db, voice_db

    def reset(self) -> None:
        self._floor_db[:], self._voice_db[:] = np.nan, np.nan

    def __call__(self, spectrum: Spectrum) -> tuple[_Floats, _Floats]:
        """A frame of every stream: features (streams, FEATURES) and level_db (streams,)."""
        bands = spectrum.bands_db
        level = _sum_db(bands)
        self._follow(bands, level)
        floor, voice = self._floor_db, self._voice_db[:, None]
        above = np.clip((bands - floor) / 15, 0, 3)
        features = np.concatenate(
            [
                np.clip((bands - voice + 30) / 15, -2.5, 3),
                0.5 * (above[:, ::2] + above[:, 1::2]),
                np.clip((level[:, None] - voice + 10) / 15, -3, 2),
                np.clip((_sum_db(floor)[:, None] - voice + 30) / 15, -3, 3),
                2 * spectrum.voicing[:, None] - 1,
                _pitch(spectrum)[:, None],
            ],
            axis=1,
            dtype=np.float32,
        )
        return features, level

    def _follow(self, bands: _Floats, level: _Floats) -> None:
        if np.isnan(self._voice_db[0]):
            self.start(*first_levels(bands))
        floor = self._floor_db
        down = (bands - floor) * np.float32(HOP_S / _FALL_S)
        floor += np.where(bands < floor, down, np.minimum(bands - floor, _RISE_DB_S * HOP_S))
        voice = self._voice_db
        up = (level - voice) * np.float32(HOP_S / (_ATTACK_S + HOP_S))
        voice += np.where(level > voice, up, -_DECAY_DB_S * HOP_S)
        least = np.maximum(_sum_db(floor) + _MARGIN_DB, _LEAST_VOICE_DB)
        np.maximum(voice, least, out=voice)


def _pitch(spectrum: Spectrum) -> _Floats:
    """Octaves from the middle of all voices, 0 without a voice: whose formants these are."""
    octaves = np.log2(np.maximum(spectrum.pitch_hz, _LOWEST_PITCH_HZ) / _MIDDLE_PITCH_HZ)
    return np.asarray(octaves * np.clip(2 * (spectrum.voicing - _VOICED), 0, 1), np.float32)


def warped(bands_db: NDArray[np.floating], factor: float) -> _Floats:
    """Spectra (..., 32) with all frequencies `factor` times as high, the pitch as it was: the same
    voice out of another vocal tract."""
    centres_mel = np.linspace(_mel(_LOWEST_HZ), _mel(_HIGHEST_HZ), BANDS + 2)[1:-1]
    wanted = 1127 * np.log1p((np.exp(centres_mel / 1127) - 1) / factor)
    at = np.clip((wanted - centres_mel[0]) / (centres_mel[1] - centres_mel[0]), 0, BANDS - 1)
    below = np.minimum(at.astype(int), BANDS - 2)
    part = (at - below).astype(np.float32)
    return np.asarray(bands_db[..., below] * (1 - part) + bands_db[..., below + 1] * part)


def first_levels(bands_db: _Floats) -> tuple[_Floats, _Floats]:
    """Floor (streams, 32) and voice (streams,) before anything is known: the first sound may be
    a voice already."""
    voice = np.full(len(bands_db), _FIRST_VOICE_DB, np.float32)
    return np.minimum(bands_db, np.float32(_FIRST_FLOOR_DB)), voice


def _sum_db(bands_db: _Floats) -> _Floats:
    return np.asarray(10 * np.log10(np.sum(10 ** (bands_db / 10), axis=-1) + _FAINTEST), np.float32)


def framed(sound: NDArray[np.floating]) -> NDArray[np.floating]:
    """Samples (..., n) to frames (..., count, 400), a hop apart, without a copy."""
    return np.lib.stride_tricks.sliding_window_view(sound, WINDOW, axis=-1)[..., ::HOP, :]
