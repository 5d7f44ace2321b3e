"""Two ears: each turns a window of sound into weights of the basic mouths (`visemes.BASIS`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hypermask.voice.arousal import Arousal
from hypermask.voice.features import HOP, WINDOW, LogMel, Normaliser
from hypermask.voice.lpc import FRAME, FrameAnalyser, window
from hypermask.voice.network import Network
from hypermask.voice.recurrent import LOOKAHEADS, Recurrent
from hypermask.voice.shapes import CLOSED, Interpolation
from hypermask.voice.visemes import (
    BASIS,
    LIPS,
    SILENCE,
    VISEME_OF_CLASS,
    VISEMES,
    class_weights,
)

# These were chosen by the figures of the voices in `material.VALIDATION`, never by those that
# measure.
_SHARPNESS = 4.0
# Odds that the training mixture has wrong: a closure that is missed is seen, one too many hardly;
# the tongue's consonants are likelier in running speech than among lone vowels.
_ODDS = {"narrow": 1.8}
_LEANING = np.array([_ODDS.get(VISEMES[viseme], 1.0) for viseme in VISEME_OF_CLASS])
_LEANING[LIPS] = 2.0
_MEMBERS = np.eye(len(VISEMES))[VISEME_OF_CLASS]  # (classes, visemes)
_QUIETEST_DB = -100.0
_SURELY_SHUT, _SURELY_OPEN = 0.85, 0.25
"""Of the probability that the lips are shut: beyond these nothing of the other side is left."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Heard:
    """weights: (8,) of `BASIS`, summing to 1; silent: probability that nobody speaks."""

    weights: _Floats
    level_db: float
    silent: float
    arousal: float = 0.0


class Ear(Protocol):
    """window, hop: samples at 16 kHz; delay: hops by which its answer is older than the window."""

    window: int
    hop: int
    delay: int

    def hear(self, sound: _Floats) -> Heard: ...

    def restart(self) -> None:
        """The next window does not follow on the last one."""


@dataclass
class RecurrentEar:
    """The recurrent network, which remembers what it heard before."""

    network: Recurrent
    delay: int = 0
    window: int = WINDOW
    hop: int = HOP
    _weights: _Floats = field(default_factory=class_weights)

    def __post_init__(self) -> None:
        if not 0 <= self.delay < LOOKAHEADS:
            raise ValueError(f"the look-ahead is 0 to {LOOKAHEADS - 1} hops")
        self._spectrum, self._normaliser, self._arousal = LogMel(), Normaliser(), Arousal()
        self._state = self.network.start()

    def hear(self, sound: _Floats) -> Heard:
        spectrum = self._spectrum((sound - sound.mean())[None])
        features, level = self._normaliser(spectrum)
        hidden = self.network.step(self._state, features)
        chances = self.network.posteriors(hidden, self.delay)[0].astype(np.float64)
        level_db, silent = float(level[0]), float(chances[SILENCE])
        arousal = self._arousal(
            level_db, float(spectrum.voicing[0]), float(spectrum.pitch_hz[0]), silent
        )
        return Heard(decided(chances, self._weights), level_db, silent, arousal)

    def restart(self) -> None:
        """The levels that were learnt of this microphone stay."""
        self._state[:] = 0.0


def decided(chances: _Floats, mouths: _Floats) -> _Floats:
    """Probabilities (..., classes) to weights (..., 8): the expected mouth, made up its mind.

    The mean of many possible mouths is a mouth that nobody makes, so the likelier viseme counts for
    more than its probability. Between shut and open a lip is in doubt for even shorter.
    """
    chances = chances * _LEANING
    chances = chances / chances.sum(axis=-1, keepdims=True)
    groups = chances @ _MEMBERS
    sharp = groups**_SHARPNESS
    sharp /= sharp.sum(axis=-1, keepdims=True)
    decided = chances * ((sharp / np.maximum(groups, 1e-12)) @ _MEMBERS.T)
    shut = decided[..., SILENCE] + decided[..., LIPS]
    part = np.clip((shut - _SURELY_OPEN) / (_SURELY_SHUT - _SURELY_OPEN), 0, 1)
    wanted = part * part * (3 - 2 * part)
    decided[..., [SILENCE, LIPS]] = 0
    decided *= ((1 - wanted) / np.maximum(1 - shut, 1e-9))[..., None]
    weights = decided @ mouths
    weights[..., CLOSED] += 1 - decided.sum(axis=-1)
    return np.asarray(weights)


class PaperEar:
    """PAPERS A6: the LPC cepstrum of 32 ms, the 20-20-13 network, no memory."""

    window = FRAME
    hop = FRAME
    delay = 0

    def __init__(self, network: Network) -> None:
        self._network = network
        self._analyse = FrameAnalyser()
        self._interpolation = Interpolation(network.shapes)
        self._taper = window()
        self._power = float(np.sum(self._taper**2))

    def hear(self, sound: _Floats) -> Heard:
        sound = sound - sound.mean()
        level_db = max(_level_db(sound * self._taper, self._power), _QUIETEST_DB)
        weights = np.zeros(len(BASIS))
        if level_db <= -90.0:  # silence has no spectrum to ask the network about
            weights[CLOSED] = 1.0
        else:
            weights[:6] = self._interpolation.linear(self._network(self._analyse(sound)[None]))[0]
        return Heard(weights, level_db, float(weights[CLOSED]))

    def restart(self) -> None:
        return


def _level_db(windowed: _Floats, power: float) -> float:
    return 10.0 * math.log10(float(windowed @ windowed) / power + 1e-10)
