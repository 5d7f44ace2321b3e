"""How far the mouth opens: louder opens it more, at any gain of the microphone."""

from __future__ import annotations

from hypermask.voice.features import HOP_S
from hypermask.voice.settings import LoudnessSettings

_FALL_DB_S = 100.0  # of the envelope: within a syllable soft consonants are as loud as its vowel
_USUAL_DB = 4.0  # below the usual level the mouth still opens fully
_LEAST = 0.1  # of the opening, for the softest voice
_SPEAKS = 0.5


class Loudness:
    """Follows the voice's envelope and its usual level over seconds."""

    def __init__(self, settings: LoudnessSettings) -> None:
        self._settings = settings
        self._usual_db = -28.0
        self._envelope_db = -100.0
        self._voice_s = 0.0

    def __call__(self, level_db: float, silent: float) -> float:
        """0 (nothing to hear) to 1 (the usual voice) and up to 1.15 (a shout), each 10 ms."""
        self._envelope_db = max(level_db, self._envelope_db - _FALL_DB_S * HOP_S)
        if level_db < self._settings.least_db:
            return 0.0
        if silent < _SPEAKS:
            self._follow()
        below_db = self._usual_db - _USUAL_DB - self._envelope_db
        part = 1 - max(below_db, 0.0) / (self._settings.range_db - _USUAL_DB)
        shout = min(max((-below_db - 7.0) / 40.0, 0.0), 0.15)
        return max(part, _LEAST) + shout

    def _follow(self) -> None:
        """Quickly at first, then over seconds; louder sound counts for more than softer."""
        self._voice_s += HOP_S
        slow_s = min(0.2 + self._voice_s, 3.0)
        time_s = 0.5 * slow_s if self._envelope_db > self._usual_db else slow_s
        self._usual_db += (self._envelope_db - self._usual_db) * min(HOP_S / time_s, 1.0)
