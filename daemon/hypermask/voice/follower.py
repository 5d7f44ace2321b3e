"""The mouth follows the voice: sound in blocks of any size and rate, mouth parameters out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hypermask.config import Settings
from hypermask.voice.loudness import Gate, GateSettings, Heard, Meter
from hypermask.voice.lpc import FRAME, RATE_HZ, FrameAnalyser
from hypermask.voice.network import Network, shipped
from hypermask.voice.resample import Resampler
from hypermask.voice.shapes import CLOSED, Interpolation, reference_shapes

# A block that starts this much off the last one's end is a gap in the sound, not jitter of clocks.
_GAP_S = 0.02
_LOUDEST = 8.0  # times full scale; a sample beyond it is broken

_Floats = NDArray[np.float64]


class VoiceSettings(Settings):
    """How the mouth follows. "paper": a mouth each 32 ms, straight from the network."""

    mode: Literal["default", "paper"] = "default"
    hop_s: float = Field(0.010, ge=0.004, le=0.032)
    attack_s: float = Field(0.015, ge=0, le=0.2)  # time constant of opening
    release_s: float = Field(0.035, ge=0, le=0.5)  # time constant of closing
    shape_s: float = Field(0.025, ge=0, le=0.2)  # time constant from vowel to vowel
    opening: float = Field(1.0, ge=0, le=2)  # how far the mouth opens at the usual level
    gate: GateSettings = GateSettings()


@dataclass(frozen=True)
class MouthFrame:
    """time_s: when the middle of the analysed 32 ms sounded; level_db: full scale."""

    time_s: float
    parameters: _Floats  # (13,)
    level_db: float


class MouthFollower:
    """Frames of 512 samples at 16 kHz, each `hop_s`, become mouth parameters.

    A frame can exist `latency_s` after its `time_s`, plus what the caller's blocks add. Samples
    that are not finite or far beyond full scale count as silence; after a gap the analysis starts
    afresh and the mouth has closed as far as it would have in that time.
    """

    def __init__(
        self,
        rate_hz: float,
        settings: VoiceSettings | None = None,
        network: Network | None = None,
        shapes: _Floats | None = None,
    ) -> None:
        """shapes: (6, 13), the face's reference shapes, by default those of the face package.

        Raises `DataError` VOICE-RATE or VOICE-NET.
        """
        self._settings = settings or VoiceSettings()
        paper = self._settings.mode == "paper"
        self._rate_hz = rate_hz
        self._network = network or shipped(self._settings.mode)
        self._shapes = reference_shapes() if shapes is None else shapes
        self._interpolation = Interpolation(self._network.shapes)
        self._resampler = Resampler(rate_hz)
        self._paper = paper
        self._hop = FRAME if paper else round(self._settings.hop_s * RATE_HZ)
        self._analyse, self._meter = FrameAnalyser(), Meter()
        self._gate = Gate(self._settings.gate, self._hop / RATE_HZ)
        self._mouth: _Mouth = _PaperMouth() if paper else _Mouth(self._settings)
        self._last: MouthFrame | None = None
        self._sound: _Floats = np.zeros(0)
        self._dropped = 0  # samples at 16 kHz that have left `_sound`
        self._fed = 0  # samples of the input since the last gap
        self._anchor, self._anchor_s = 0, 0.0  # one of them, and when it sounded

    @property
    def latency_s(self) -> float:
        """From `MouthFrame.time_s` to the last sample that the frame needs."""
        return 0.5 * FRAME / RATE_HZ + self._resampler.delay_s

    def feed(self, samples: NDArray[np.floating], time_s: float) -> list[MouthFrame]:
        """A block (n,) whose first sample sounded at `time_s`; the frames that are now complete."""
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
        parameters = self._parameters(self._mouth.resting(since_s))
        return MouthFrame(time_s, parameters, -100.0)

    def _restart(self, time_s: float) -> None:
        if self._last is not None:
            self._mouth.rest(max(time_s - self._last.time_s, 0.0))
        self._resampler.reset()
        self._sound = np.zeros(0)
        self._dropped = self._fed = 0

    def _frames(self) -> list[MouthFrame]:
        frames = []
        at = 0
        while at + FRAME <= len(self._sound):
            centre = (self._dropped + at + 0.5 * (FRAME - 1)) / RATE_HZ
            time_s = self._anchor_s + centre - self._anchor / self._rate_hz
            frames.append(self._frame(self._sound[at : at + FRAME], time_s))
            at += self._hop
        self._sound = self._sound[at:]
        self._dropped += at
        self._last = frames[-1] if frames else self._last
        return frames

    def _frame(self, sound: _Floats, time_s: float) -> MouthFrame:
        sound = sound - sound.mean()  # some sound cards have an offset
        level_db, voicing = self._meter(sound)
        heard = self._gate(level_db, voicing)
        raw = self._network(self._analyse(sound)[None])
        interpolation = self._interpolation
        weights = (interpolation.linear(raw) if self._paper else interpolation.weights(raw))[0]
        mixed = self._mouth.follow(weights, heard, self._hop / RATE_HZ)
        return MouthFrame(time_s, self._parameters(mixed), level_db)

    def _parameters(self, weights: _Floats) -> _Floats:
        """Weights (6,) of the face's own shapes; those that ask for more than 1 exaggerate."""
        return np.asarray(weights @ self._shapes)


class _Mouth:
    """Smooths between vowels, opens with the loudness, closes without chatter."""

    def __init__(self, settings: VoiceSettings) -> None:
        self._settings = settings
        self._vowel: _Floats | None = None  # (6,) without the closed mouth, summing to 1
        self._amount = 0.0

    def follow(self, weights: _Floats, heard: Heard, hop_s: float) -> _Floats:
        """Weights (6,) from the network to weights (6,) of this moment's mouth."""
        settings = self._settings
        open_part = 1.0 - float(weights[CLOSED])
        target = settings.opening * heard.opening * open_part
        if target > 0:
            vowel = weights / open_part
            vowel[CLOSED] = 0.0
            if self._vowel is None or self._amount < 0.02:
                self._vowel = vowel  # a mouth that opens takes its vowel at once
            trust = min(heard.opening, 1.0)
            self._vowel = self._vowel + trust * _step(hop_s, settings.shape_s) * (
                vowel - self._vowel
            )
        time_s = settings.attack_s if target > self._amount else settings.release_s
        self._amount += (target - self._amount) * _step(hop_s, time_s)
        return self._mixed(self._amount)

    def rest(self, since_s: float) -> None:
        """The state after `since_s` without sound."""
        self._amount *= 1.0 - _step(since_s, self._settings.release_s)

    def resting(self, since_s: float) -> _Floats:
        return self._mixed(self._amount * (1.0 - _step(since_s, self._settings.release_s)))

    def _mixed(self, amount: float) -> _Floats:
        if self._vowel is None or amount < 1e-3:
            return _SHUT.copy()
        mixed = np.asarray(amount * self._vowel)
        mixed[CLOSED] = 1.0 - amount
        return mixed


class _PaperMouth(_Mouth):
    """What the network says, at once; silence has no spectrum to ask it about."""

    def __init__(self) -> None:
        super().__init__(VoiceSettings())

    def follow(self, weights: _Floats, heard: Heard, hop_s: float) -> _Floats:
        self._amount = 0.0 if heard.level_db <= -90.0 else 1.0
        self._vowel = weights
        return self._mixed(self._amount)

    def _mixed(self, amount: float) -> _Floats:
        if self._vowel is None:
            return _SHUT.copy()
        return np.asarray(amount * self._vowel + (1 - amount) * _SHUT)


_SHUT: _Floats = np.eye(6)[CLOSED]


def _step(elapsed_s: float, time_constant_s: float) -> float:
    """How much of the way a first-order follower goes in `elapsed_s`."""
    return 1.0 if time_constant_s <= 0 else -math.expm1(-elapsed_s / time_constant_s)


def _repaired(samples: NDArray[np.floating]) -> _Floats:
    block = np.asarray(samples, np.float64).ravel()
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(block) <= _LOUDEST, block, 0.0)
