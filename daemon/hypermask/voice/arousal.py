"""How excited a voice sounds, 0 to 1: loudness, pitch and how lively both are.

Raised pitch, a wider pitch range, more energy and faster changes of both are what arousal does to a
voice in nearly every study (Banse and Scherer 1996; Juslin and Laukka 2003). All are measured
against the same speaker's own usual voice, so men, women and children count alike.
"""

from __future__ import annotations

import math

import numpy as np

from hypermask.voice.features import HOP_S

_VOICED = 0.55
_SPEAKS = 0.5  # probability of silence below which somebody speaks
_NOW_S, _USUAL_S = 0.8, 40.0
_FIRST_S = 2.0  # of voice, after which the usual is known well enough to compare
_FADE_S = 3.0  # of silence, after which excitement has gone down to a third
_CALM, _STEEP = 0.9, 1.6

# What counts as one unit of excitement.
_LEVEL_DB, _PITCH_OCTAVES, _PITCH_RANGE_OCTAVES, _LEVEL_RANGE_DB = 8.0, 0.45, 0.16, 5.0


class Arousal:
    """A frame each 10 ms; 0.25 for a usual voice, towards 1 for an excited one, 0 in silence."""

    def __init__(self) -> None:
        self._usual = np.zeros(2)  # level in dB, pitch in octaves
        self._now = np.zeros(2)
        self._spread = np.zeros(2)  # mean absolute deviation from now, over seconds
        self._usual_spread = np.array([_LEVEL_RANGE_DB, _PITCH_RANGE_OCTAVES])
        self._voiced_s = 0.0
        self._value = 0.0

    def __call__(self, level_db: float, voicing: float, pitch_hz: float, silent: float) -> float:
        if silent < _SPEAKS and voicing > _VOICED:
            self._follow(np.array([level_db, math.log2(max(pitch_hz, 40.0))]))
            target = self._excitement()
            self._value += (target - self._value) * HOP_S / 0.3
        else:
            self._value *= 1 - HOP_S / _FADE_S
        return self._value

    def _follow(self, heard: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
        if self._voiced_s == 0.0:
            self._usual, self._now = heard.copy(), heard.copy()
            self._spread = 0.5 * self._usual_spread
        self._voiced_s += HOP_S
        jump = abs(heard[1] - self._now[1])
        if jump > 0.7:  # an octave error of the pitch, or another voice: slowly believed
            heard = np.array(
                [heard[0], self._now[1] + math.copysign(0.05, heard[1] - self._now[1])]
            )
        deviation = np.abs(heard - self._now)
        self._now += (heard - self._now) * HOP_S / min(_NOW_S, self._voiced_s + HOP_S)
        self._spread += (deviation - self._spread) * HOP_S / _NOW_S
        slow = HOP_S / min(_USUAL_S, self._voiced_s + HOP_S)
        self._usual += (heard - self._usual) * slow

    def _excitement(self) -> float:
        level, pitch = self._now - self._usual
        lively = (self._spread - 0.5 * self._usual_spread) / self._usual_spread
        known = min(self._voiced_s / _FIRST_S, 1.0)
        units = known * (level / _LEVEL_DB + pitch / _PITCH_OCTAVES)
        units += 0.5 * float(np.clip(lively, -1, 1.5).sum())
        return 1 / (1 + math.exp(-_STEEP * (units - _CALM)))
