"""Training sequences for the recurrent network: voices, labels each 10 ms, noise, microphones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.voice import stage_noise
from hypermask.voice.features import (
    FEATURES,
    HOP,
    HOP_S,
    WINDOW,
    LogMel,
    Normaliser,
    Spectrum,
    first_levels,
    framed,
    warped,
)
from hypermask.voice.lpc import RATE_HZ
from hypermask.voice.noise import ambient, unit
from hypermask.voice.recurrent_train import Sequences
from hypermask.voice.synthesis import Phone, Utterance
from hypermask.voice.visemes import CLASS_OF_VOWEL, CLASSES, SILENCE
from hypermask.voice.vowels import Vowel

FRAMES = 300
LEAD = 1
"""Hops by which the answer runs ahead of the sound: so much later the lips are there. What comes
next can often be heard before, and where it cannot, the network learns to wait."""
_GROUP = 50
_CLEAN = 0.4  # of the scenes have no microphone's colour
_WARPED, _WARP = 0.6, (0.88, 1.14)
_LED = 0.25  # of a consonant's mouth that its neighbours decide; Cohen and Massaro 1993
_FIRST_VOWEL = CLASSES.index("aa")
_FREE = [CLASSES.index(name) for name in ("s", "t", "l", "k", "th")]
"""Consonants made by the tongue: the lips are free to do what the neighbours need."""
_IMPORTANCE = np.ones(len(CLASSES))
for _name, _weight in {"silence": 0.7, "lips": 2.5, "teeth": 2.5, "w": 1.7, "sh": 1.5}.items():
    _IMPORTANCE[CLASSES.index(_name)] = _weight
_SMOOTH = np.array([0.15, 0.7, 0.15])
LEARNT_VOWELS = ("ah", "iy", "uw", "eh", "oa")

_Floats = NDArray[np.float64]
_Singles = NDArray[np.float32]
_Halves = NDArray[np.float16]


@dataclass(frozen=True)
class Piece:
    """A stretch of voice: samples at 16 kHz, targets (frames, classes), weight (frames,).

    Frame k is the hop from 160 k on. `level` is the rms where somebody speaks.
    """

    samples: NDArray[np.float32]
    targets: NDArray[np.float16]
    weight: NDArray[np.float16]
    level: float


def of_utterance(utterance: Utterance) -> Piece:
    count = len(utterance.samples) // HOP
    targets = led(timeline(utterance.phones, count))
    weight = (np.minimum(targets, 1) @ _IMPORTANCE).astype(np.float16)
    sound = utterance.samples[: count * HOP]
    return Piece(sound, targets.astype(np.float16), weight, _level(sound))


def timeline(phones: Sequence[Phone], count: int) -> NDArray[np.float64]:
    """(count, classes): the class in the middle of each hop; a diphthong's halves one by one."""
    targets = np.zeros((count, len(CLASSES)))
    middles = (np.arange(count) + 0.5) * HOP_S
    for phone in phones:
        inside = np.flatnonzero((middles >= phone.begin_s) & (middles < phone.end_s))
        if not phone.classes:
            continue
        turn = int(np.ceil(0.6 * len(inside))) if len(phone.classes) > 1 else len(inside)
        targets[inside[:turn], phone.classes[0]] = 1
        targets[inside[turn:], phone.classes[-1]] = 1
    return targets


def led(targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Co-articulation: lips that a consonant leaves free are on their way between the vowels."""
    hard = targets.argmax(axis=1)
    mixed = targets.copy()
    begins = np.flatnonzero(np.r_[True, hard[1:] != hard[:-1]])
    ends = np.r_[begins[1:], len(hard)]
    for k, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        if hard[begin] not in _FREE:
            continue
        after = hard[begins[k + 1]] if k + 1 < len(begins) else SILENCE
        before = hard[begins[k - 1]] if k > 0 else SILENCE
        way = np.linspace(0.25, 0.75, end - begin)[:, None]
        for neighbour, share in ((before, 1 - way), (after, way)):
            if neighbour >= _FIRST_VOWEL:
                mixed[begin:end] -= _LED * share * targets[begin:end]
                mixed[begin:end, neighbour] += _LED * share[:, 0]
    return smoothed(mixed)


def smoothed(targets: NDArray[np.float64]) -> NDArray[np.float64]:
    padded = np.concatenate([targets[:1], targets, targets[-1:]])
    return np.asarray(sum(w * padded[k : k + len(targets)] for k, w in enumerate(_SMOOTH)))


def of_vowel(vowel: Vowel, importance: float = 3.0, others: float = 0.7) -> Piece:
    """A recorded h-V-d word: the nucleus is sure, the edges are only where they are plain.

    importance: of a frame of the five vowels, where one of running speech counts 1; others: of one
    of the other vowels. The nucleus counts `LEAD` hops longer, so that its last frame is learnt.
    """
    count = len(vowel.samples) // HOP
    sound = vowel.samples[: count * HOP].astype(np.float32)
    power = 10 * np.log10(np.mean(sound.reshape(count, HOP) ** 2, axis=1) + 1e-10)
    quiet = power < power.max() - 38
    begin, end = vowel.start // HOP, max(vowel.end // HOP, vowel.start // HOP + 1) + LEAD
    hard = np.full(count, SILENCE)
    weight = np.where(quiet, 1.0, 0.0)
    weight[begin - 2 : end + 4] = 0.0
    hard[begin:end] = CLASSES.index(CLASS_OF_VOWEL[vowel.vowel])
    weight[begin:end] = importance if vowel.vowel in LEARNT_VOWELS else others
    if vowel.vowel == "ei":
        hard[begin + (end - begin) * 6 // 10 : end] = CLASSES.index("ih")
        weight[begin:end] = others
    level = _level(sound[begin * HOP : end * HOP])
    sure = np.eye(len(CLASSES))[hard]
    targets = smoothed(sure)
    targets[begin:end] = sure[begin:end]
    return Piece(sound, targets.astype(np.float16), weight.astype(np.float16), level)


def sung(rng: np.random.Generator, formants: tuple[float, float, float], vowel: str) -> Piece:
    """A long note: pulses with vibrato through the formants that were measured of a speaker."""
    count = int(rng.uniform(0.8, 4.0) * RATE_HZ) // HOP * HOP
    time_s = np.arange(count) / RATE_HZ
    wobble = 1 + rng.uniform(0, 0.03) * np.sin(2 * np.pi * rng.uniform(4, 7) * time_s)
    phase = np.cumsum(rng.uniform(85, 330) * wobble) / RATE_HZ
    sound = np.diff(np.floor(phase), prepend=0) + 0.003 * rng.standard_normal(count)
    spectrum = np.fft.rfft(sound)
    z = np.exp(-2j * np.pi * np.fft.rfftfreq(count))
    for formant in (*formants, rng.uniform(3200, 4200)):
        radius = np.exp(-np.pi * (50 + 0.05 * formant) / RATE_HZ)
        spectrum /= 1 - 2 * radius * np.cos(2 * np.pi * formant / RATE_HZ) * z + radius**2 * z**2
    swell = np.minimum(1, np.minimum(time_s, time_s[::-1]) / 0.03)
    sound = unit(np.fft.irfft(spectrum, count)) * swell
    targets = np.zeros((count // HOP, len(CLASSES)), np.float16)
    targets[:, CLASSES.index(CLASS_OF_VOWEL[vowel])] = 1
    weight = np.full(count // HOP, 0.7, np.float16)
    weight[:4] = weight[-4:] = 0
    return Piece(sound.astype(np.float32), targets, weight, 1.0)


def silence(frames: int) -> Piece:
    targets = np.zeros((frames, len(CLASSES)), np.float16)
    targets[:, SILENCE] = 1
    return Piece(np.zeros(frames * HOP, np.float32), targets, np.ones(frames, np.float16), 1.0)


def at_pitch(piece: Piece, factor: float) -> Piece:
    """Played `factor` times as fast: a shorter vocal tract, a higher and quicker voice."""
    count = int(len(piece.samples) / factor) // HOP
    at = np.arange(count * HOP) * factor
    sound = np.interp(at, np.arange(len(piece.samples)), piece.samples)
    frames = np.minimum(((np.arange(count) + 0.5) * factor).astype(int), len(piece.targets) - 1)
    return Piece(sound.astype(np.float32), piece.targets[frames], piece.weight[frames], piece.level)


Draw = Callable[[np.random.Generator], list[Piece]]


class Mixer:
    """Makes scenes of `frames` hops out of pieces; `families` are drawn from with their shares.

    single: a scene is what one draw gives and no more, and it begins soon.
    """

    def __init__(
        self,
        families: Sequence[tuple[float, Draw]],
        babble: Sequence[Piece],
        frames: int = FRAMES,
        single: bool = False,
    ) -> None:
        self._draw = [draw for _, draw in families]
        self._shares = np.array([share for share, _ in families])
        self._babble = babble
        self._frames, self._single = frames, single
        self._spectrum = LogMel()

    def sequences(
        self, count: int, rng: np.random.Generator, progress: Callable[[], None] = lambda: None
    ) -> Sequences:
        made = Sequences(
            np.zeros((count, self._frames, FEATURES), np.float16),
            np.zeros((count, self._frames, len(CLASSES)), np.float16),
            np.zeros((count, self._frames), np.float16),
        )
        for at in range(0, count, _GROUP):
            group = range(at, min(at + _GROUP, count))
            sounds = np.zeros((len(group), (self._frames - 1) * HOP + WINDOW), np.float32)
            for row, k in enumerate(group):
                sounds[row], made.targets[k], made.weight[k] = self._scene(rng, sounds.shape[1])
                progress()
            made.features[at : at + len(group)] = self._features(sounds, rng)
        return made

    def _scene(self, rng: np.random.Generator, samples: int) -> tuple[_Floats, _Halves, _Halves]:
        voice = self._word(rng) if self._single else self._voice(rng)
        # Window k is centred 200 samples after its first; hop k's middle lies 80 after its own.
        shift = (WINDOW - HOP) // 2
        sound = np.concatenate([np.zeros(shift), voice.samples[: samples - shift]])
        if rng.uniform() >= _CLEAN:
            sound = stage_noise.microphone(sound, rng)
        sound = sound + self._noise(rng, len(sound))
        sound *= 10 ** (rng.uniform(-42, -12) / 20)
        if rng.uniform() < 0.05:
            sound *= 10 ** (rng.uniform(10, 25) / 20)
        answers = slice(LEAD, LEAD + self._frames)
        return np.clip(sound, -1, 1), voice.targets[answers], voice.weight[answers]

    def _word(self, rng: np.random.Generator) -> Piece:
        before = int(rng.integers(0, 12)) if rng.uniform() < 0.5 else 0
        drawn = self._draw[rng.choice(len(self._draw), p=self._shares / self._shares.sum())](rng)
        return _joined([silence(before), *map(_levelled, drawn), silence(self._frames + LEAD)])

    def _voice(self, rng: np.random.Generator) -> Piece:
        """Pieces of unit level one after another, with pauses, at least as long as a scene."""
        pieces: list[Piece] = []
        frames = 0
        if rng.uniform() < 0.4:
            pieces.append(silence(int(rng.integers(5, 80))))
        draw = self._draw[rng.choice(len(self._draw), p=self._shares / self._shares.sum())]
        while frames < self._frames + 4:
            for piece in draw(rng):
                pieces.append(_levelled(piece, 10 ** (rng.uniform(-6, 3) / 20)))
            if rng.uniform() < 0.6:
                pieces.append(silence(int(rng.integers(5, 100))))
            frames = sum(len(piece.targets) for piece in pieces)
        start = 0
        if rng.uniform() >= 0.5:
            start = int(rng.integers(0, max(frames - self._frames - 3, 1)))
        return _joined(pieces, start)

    def _noise(self, rng: np.random.Generator, count: int) -> _Floats:
        kind = rng.uniform()
        room = unit(rng.standard_normal(count)) if kind < 0.2 else ambient(rng, count)
        snr_db = rng.uniform(35, 70) if rng.uniform() < 0.35 else rng.uniform(2, 35)
        sound = room * 10 ** (-snr_db / 20)
        if rng.uniform() < 0.35:
            event = stage_noise.EVENTS[rng.integers(len(stage_noise.EVENTS))](rng, count)
            sound = sound + event * 10 ** (-rng.uniform(4, 35) / 20)
        if rng.uniform() < 0.15:
            sound = sound + self._crowd(rng, count) * 10 ** (-rng.uniform(10, 30) / 20)
        return np.asarray(sound)

    def _crowd(self, rng: np.random.Generator, count: int) -> _Floats:
        total = np.zeros(count)
        for _ in range(rng.integers(3, 8)):
            one = self._babble[int(rng.integers(len(self._babble)))].samples
            total += np.resize(np.roll(one, int(rng.integers(len(one)))), count)
        return unit(total)

    def _features(
        self, sounds: NDArray[np.float32], rng: np.random.Generator
    ) -> NDArray[np.float16]:
        spectra = [self._spectrum(framed(sound)) for sound in sounds]
        bands, voicing, pitch = (
            np.stack([getattr(one, name) for one in spectra]) for name in vars(spectra[0])
        )
        for row in np.flatnonzero(rng.uniform(size=len(sounds)) < _WARPED):
            bands[row] = warped(bands[row], rng.uniform(*_WARP))
        normaliser = Normaliser(len(sounds))
        normaliser.start(*_before(bands, rng))
        features = np.empty((len(sounds), self._frames, FEATURES), np.float16)
        for k in range(self._frames):
            features[:, k] = normaliser(Spectrum(bands[:, k], voicing[:, k], pitch[:, k]))[0]
        return features


def _levelled(piece: Piece, gain: float = 1.0) -> Piece:
    sound = piece.samples * np.float32(gain / piece.level)
    return Piece(sound, piece.targets, piece.weight, 1.0)


def _joined(pieces: Sequence[Piece], start: int = 0) -> Piece:
    """From hop `start` on."""
    return Piece(
        np.concatenate([piece.samples for piece in pieces])[start * HOP :],
        np.concatenate([piece.targets for piece in pieces])[start:],
        np.concatenate([piece.weight for piece in pieces])[start:],
        1.0,
    )


def _before(bands_db: _Singles, rng: np.random.Generator) -> tuple[_Singles, _Singles]:
    """Half of the streams have begun long before: in noise alone, or in the same voice."""
    streams = len(bands_db)
    floor = np.percentile(bands_db, 12, axis=1).astype(np.float32)
    floor += rng.uniform(-3, 3, (streams, 1)).astype(np.float32)
    loud = np.percentile(10 * np.log10(np.sum(10 ** (bands_db / 10), axis=2)), 90, axis=1)
    kind = rng.uniform(size=streams)
    voice = loud + np.where(kind < 0.25, rng.uniform(-30, 8), rng.uniform(-5, 8, streams))
    cold = kind > 0.5
    fresh_floor, fresh_voice = first_levels(bands_db[:, 0])
    floor[cold], voice[cold] = fresh_floor[cold], fresh_voice[cold]
    return floor, voice.astype(np.float32)


def _level(sound: NDArray[np.floating]) -> float:
    """The rms of the louder half."""
    count = max(len(sound) // HOP, 1)
    power = np.mean(np.resize(sound, (count, HOP)) ** 2, axis=1)
    return float(np.sqrt(np.mean(np.sort(power)[count // 2 :]))) + 1e-6
