"""From what was heard to how the lips move: loudness, soft onset and release."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hypermask.voice.hearing import Heard
from hypermask.voice.loudness import Loudness
from hypermask.voice.settings import LipSettings
from hypermask.voice.shapes import CLOSED
from hypermask.voice.visemes import BASIS

_Floats = NDArray[np.float64]
_TRAVERSE_S = 0.03
"""No lips open or shut in less."""
_VOICE_COMES_S, _VOICE_GOES_S = 0.012, 0.06
_DOUBT, _BELIEF = 0.4, 0.65  # of the followed probability that somebody speaks
SHUT: _Floats = np.eye(len(BASIS))[CLOSED]


class Lips:
    """Weights (8,) of the basic mouths that follow what is heard."""

    def __init__(self, settings: LipSettings) -> None:
        self._settings = settings
        self._loudness = Loudness(settings.loudness)
        self._weights = SHUT.copy()
        self._voice = 0.0

    def follow(self, heard: Heard, hop_s: float) -> _Floats:
        scale = self._settings.opening * self._loudness(heard.level_db, heard.silent)
        scale *= self._believed(heard.silent, hop_s)
        target = scale * heard.weights
        target[CLOSED] = 0.0
        target[CLOSED] = 1.0 - target.sum()
        opens = target[CLOSED] < self._weights[CLOSED]
        time_s = self._settings.attack_s if opens else self._settings.release_s
        change = _step(hop_s, time_s) * (target - self._weights)
        most = hop_s / _TRAVERSE_S
        self._weights = self._weights + change * min(1.0, most / max(abs(change[CLOSED]), 1e-9))
        if 1.0 - self._weights[CLOSED] < 1e-3:
            self._weights = SHUT.copy()
        return self._weights

    def _believed(self, silent: float, hop_s: float) -> float:
        """0 to 1: a crackle that sounds like a voice for one hop does not open the mouth."""
        time_s = _VOICE_COMES_S if 1 - silent > self._voice else _VOICE_GOES_S
        self._voice += _step(hop_s, time_s) * (1 - silent - self._voice)
        return min(max((self._voice - _DOUBT) / (_BELIEF - _DOUBT), 0.0), 1.0)

    def rest(self, since_s: float) -> None:
        """The state after `since_s` without sound."""
        self._weights = self.resting(since_s)

    def resting(self, since_s: float) -> _Floats:
        left = 1.0 - _step(since_s, self._settings.release_s)
        return SHUT + left * (self._weights - SHUT) if left > 1e-3 else SHUT.copy()


class PaperLips(Lips):
    """What the network says, at once."""

    def follow(self, heard: Heard, hop_s: float) -> _Floats:
        self._weights = heard.weights
        return self._weights


def _step(elapsed_s: float, time_constant_s: float) -> float:
    """How much of the way a first-order follower goes in `elapsed_s`."""
    return 1.0 if time_constant_s <= 0 else -math.expm1(-elapsed_s / time_constant_s)
