"""Level, voicing, and the gate that tells the actor's voice from silence and from the stage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hypermask.config import Settings
from hypermask.voice.lpc import FRAME, RATE_HZ

_QUIETEST_DB = -100.0
_LOWEST_PITCH_HZ, _HIGHEST_PITCH_HZ = 75.0, 420.0
# The band of the first formants; outside it are rumble and hiss, which have no pitch of interest.
_VOICE_BAND_HZ = (80.0, 1800.0)
_LOWEST_FLOOR_DB = -80.0
# The first sound may be a voice already; then its level is not that of the stage's noise.
_HIGHEST_FIRST_FLOOR_DB = -45.0

_Floats = NDArray[np.float64]


class Meter:
    """Level in dB full scale and degree of voicing of one frame."""

    def __init__(self) -> None:
        self._window = np.hanning(FRAME)
        self._power = float(np.sum(self._window**2))
        frequency = np.fft.rfftfreq(2 * FRAME, 1 / RATE_HZ)
        self._band = (frequency >= _VOICE_BAND_HZ[0]) & (frequency <= _VOICE_BAND_HZ[1])
        self._lags = slice(int(RATE_HZ / _HIGHEST_PITCH_HZ), int(RATE_HZ / _LOWEST_PITCH_HZ) + 1)
        taper = np.fft.irfft(np.abs(np.fft.rfft(self._window, 2 * FRAME)) ** 2)
        self._taper = taper[self._lags] / taper[0]

    def __call__(self, frame: _Floats) -> tuple[float, float]:
        """Level of a frame (512,) in dB full scale (a square wave has 0), and voicing, 0 to 1.

        Voicing is the highest peak of the autocorrelation at the lags of a voice's pitch, relative
        to lag 0 and corrected for the window (Boersma 1993).
        """
        windowed = frame * self._window
        level = 10.0 * np.log10(float(windowed @ windowed) / self._power + 1e-10)
        spectrum = np.fft.rfft(windowed, 2 * FRAME)
        power = (spectrum.real**2 + spectrum.imag**2) * self._band
        correlation = np.fft.irfft(power)
        if correlation[0] <= 1e-12:
            return max(level, _QUIETEST_DB), 0.0
        peak = float(np.max(correlation[self._lags] / self._taper)) / float(correlation[0])
        return max(level, _QUIETEST_DB), min(max(peak, 0.0), 1.0)


class GateSettings(Settings):
    """When sound counts as the actor's voice."""

    open_db: float = Field(10.0, ge=1, le=40)  # above the noise floor
    close_db: float = Field(6.0, ge=0, le=40)
    range_db: float = Field(24.0, ge=10, le=60)  # below the usual voice the mouth is shut
    least_db: float = Field(-62.0, ge=-95, le=-10)  # full scale; never opens below
    hold_s: float = Field(0.12, ge=0, le=1)  # a voice may miss its pitch so long
    whisper: float = Field(0.45, ge=0, le=1)  # how far sound without pitch may open the mouth


@dataclass(frozen=True)
class Heard:
    """opening: 0 (shut) to 1 (usual voice) and a little beyond for a shout."""

    opening: float
    voiced: bool
    level_db: float


class Gate:
    """Follows the noise floor and the voice's usual level; both adapt to any gain."""

    def __init__(self, settings: GateSettings, hop_s: float) -> None:
        self._settings = settings
        self._hop_s = hop_s
        self.reset()

    def reset(self) -> None:
        self._floor_db: float | None = None
        self._voice_db = -28.0
        self._unvoiced_s = 1.0
        self._voice_s = 0.0
        self._open = False

    def __call__(self, level_db: float, voicing: float) -> Heard:
        settings = self._settings
        pitched = voicing > 0.55
        self._unvoiced_s = 0.0 if pitched else self._unvoiced_s + self._hop_s
        voiced = self._unvoiced_s <= settings.hold_s
        floor_db = self._floor_db = self._next_floor(level_db, voiced)
        margin = settings.close_db if self._open else settings.open_db
        self._open = level_db > max(floor_db + margin, settings.least_db)
        if self._open and pitched:
            self._follow_voice(level_db)
        amount = self._opening(level_db, floor_db) * (1.0 if voiced else settings.whisper)
        return Heard(amount if self._open else 0.0, voiced and self._open, level_db)

    def _opening(self, level_db: float, floor_db: float) -> float:
        """Smooth from the edge of hearing to the usual level of this voice."""
        settings = self._settings
        low = max(floor_db + settings.close_db, self._voice_db - settings.range_db)
        high = max(self._voice_db - 4.0, low + 6.0)
        part = min(max((level_db - low) / (high - low), 0.0), 1.0)
        shout = min(max((level_db - self._voice_db - 3.0) / 40.0, 0.0), 0.15)
        return part * part * (3.0 - 2.0 * part) + shout

    def _next_floor(self, level_db: float, voiced: bool) -> float:
        """Down at once, up slowly, and hardly at all while somebody speaks."""
        if self._floor_db is None:
            highest_db = _HIGHEST_FIRST_FLOOR_DB if voiced else level_db
            return max(min(level_db, highest_db), _LOWEST_FLOOR_DB)
        if level_db < self._floor_db:
            fall_db = (self._floor_db - level_db) * min(self._hop_s / 0.08, 1.0)
            return max(self._floor_db - fall_db, _LOWEST_FLOOR_DB)
        rise_db_s = 0.5 if voiced else 12.0 if self._open else 20.0
        return min(self._floor_db + rise_db_s * self._hop_s, level_db)

    def _follow_voice(self, level_db: float) -> None:
        """Quickly at first, then over seconds; louder sound counts for more than softer."""
        self._voice_s += self._hop_s
        slow_s = min(0.3 + self._voice_s, 3.0)
        time_s = 0.5 * slow_s if level_db > self._voice_db else slow_s
        self._voice_db += (level_db - self._voice_db) * min(self._hop_s / time_s, 1.0)
