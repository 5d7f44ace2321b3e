"""The mouth follows the voice: sound in blocks of any size and rate, mouth parameters out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.voice import recurrent
from hypermask.voice.hearing import Ear, PaperEar, RecurrentEar
from hypermask.voice.lips import Lips, PaperLips
from hypermask.voice.lpc import RATE_HZ
from hypermask.voice.paper_base import shipped_choice
from hypermask.voice.resample import Resampler
from hypermask.voice.settings import VoiceSettings
from hypermask.voice.speaker import Speaker
from hypermask.voice.visemes import basis_shapes

# A block that starts this much off the last one's end is a gap in the sound, not jitter of clocks.
_GAP_S = 0.02
_LOUDEST = 8.0  # times full scale; a sample beyond it is broken

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MouthFrame:
    """time_s: when the sound was heard whose mouth this is; level_db: full scale.

    arousal: 0 to 1, how excited the voice sounds (`hypermask.voice.arousal`).
    """

    time_s: float
    parameters: _Floats  # (13,)
    level_db: float
    arousal: float = 0.0


class MouthFollower:
    """Windows of 25 ms each 10 ms (paper: 32 ms each 32 ms) become mouth parameters.

    A frame can exist `latency_s` after its `time_s`, plus what the caller's blocks add. Samples
    that are not finite or far beyond full scale count as silence; after a gap the analysis starts
    afresh and the mouth has closed as far as it would have in that time.
    """

    def __init__(
        self,
        rate_hz: float,
        settings: VoiceSettings | None = None,
        speaker: Speaker | None = None,
        shapes: _Floats | None = None,
        ear: Ear | None = None,
    ) -> None:
        """shapes: (6, 13), the face's reference shapes, by default those of the face package;
        speaker: what calibration learnt of the actor; ear: another than the settings name.

        Raises `DataError` VOICE-RATE or VOICE-NET.
        """
        self._settings = settings or VoiceSettings()
        self._rate_hz = rate_hz
        self._shapes = basis_shapes(shapes)
        self._resampler = Resampler(rate_hz)
        self._ear = ear or make_ear(self._settings, speaker)
        paper = self._settings.mode == "paper"
        self._lips = PaperLips(self._settings) if paper else Lips(self._settings)
        self._last: MouthFrame | None = None
        self._sound: _Floats = np.zeros(0)
        self._dropped = 0  # samples at 16 kHz that have left `_sound`
        self._fed = 0  # samples of the input since the last gap
        self._anchor, self._anchor_s = 0, 0.0  # one of them, and when it sounded

    @property
    def latency_s(self) -> float:
        """From `MouthFrame.time_s` to the last sample that the frame needs."""
        return self._half_s + self._waits_s + self._resampler.delay_s

    @property
    def _half_s(self) -> float:
        return 0.5 * self._ear.window / RATE_HZ

    @property
    def _waits_s(self) -> float:
        return self._ear.delay * self._ear.hop / RATE_HZ

    def use(self, speaker: Speaker | None) -> None:
        """From now on with what calibration learnt of this actor; all else that was heard of the
        microphone and the room stays."""
        ear = make_ear(self._settings, speaker)
        if isinstance(self._ear, RecurrentEar) and isinstance(ear, RecurrentEar):
            self._ear.network = ear.network
        else:
            self._ear = ear

    def feed(self, samples: NDArray[np.floating], time_s: float) -> list[MouthFrame]:
        """The frames that are complete with a block (n,) or (n, channels).

        time_s: when its first sample sounded.
        """
        block = _repaired(samples)
        if len(block) == 0:
            return []
        expected_s = self._anchor_s + (self._fed - self._anchor) / self._rate_hz
        if not math.isfinite(time_s):
            time_s = expected_s
        if self._fed == 0 or abs(time_s - expected_s) > _GAP_S:
            self._restart(time_s)
        self._anchor_s, self._anchor = time_s, self._fed
        self._fed += len(block)
        self._sound = np.concatenate([self._sound, self._resampler.process(block)])
        return self._frames()

    def idle(self, time_s: float) -> MouthFrame:
        """The mouth at `time_s` when no sound has come since the last frame: it closes."""
        since_s = max(time_s - self._last.time_s, 0.0) if self._last else 0.0
        return MouthFrame(time_s, self._parameters(self._lips.resting(since_s)), -100.0)

    def _restart(self, time_s: float) -> None:
        if self._last is not None:
            self._lips.rest(max(time_s - self._last.time_s, 0.0))
        self._ear.restart()
        self._resampler.reset()
        self._sound = np.zeros(0)
        self._dropped = self._fed = 0

    def _frames(self) -> list[MouthFrame]:
        frames = []
        at = 0
        window, hop = self._ear.window, self._ear.hop
        while at + window <= len(self._sound):
            centre = (self._dropped + at + 0.5 * (window - 1)) / RATE_HZ
            time_s = self._anchor_s + centre - self._anchor / self._rate_hz - self._waits_s
            frames.append(self._frame(self._sound[at : at + window], time_s))
            at += hop
        self._sound = self._sound[at:]
        self._dropped += at
        self._last = frames[-1] if frames else self._last
        return frames

    def _frame(self, sound: _Floats, time_s: float) -> MouthFrame:
        heard = self._ear.hear(sound)
        weights = self._lips.follow(heard, self._ear.hop / RATE_HZ)
        return MouthFrame(time_s, self._parameters(weights), heard.level_db, heard.arousal)

    def _parameters(self, weights: _Floats) -> _Floats:
        """Weights (8,) of the face's own mouths; those that ask for more than 1 exaggerate."""
        return np.asarray(weights @ self._shapes)


def make_ear(settings: VoiceSettings, speaker: Speaker | None) -> Ear:
    """Raises `DataError` VOICE-NET."""
    if settings.mode == "paper":
        return PaperEar(shipped_choice(speaker.paper_net if speaker else None))
    network = recurrent.shipped()
    adapted = speaker.adapted(network) if speaker else network
    return RecurrentEar(adapted, settings.lookahead_ms // 10)


def _repaired(samples: NDArray[np.floating]) -> _Floats:
    block = np.asarray(samples, np.float64)
    if block.ndim == 2:  # (n, channels)
        block = block.mean(axis=1)
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(block) <= _LOUDEST, block, 0.0)
