"""Speaker calibration: an actor says five vowels and is silent for a moment, ten seconds in all.

Each take is checked, so that a bad one is asked for again and never learnt from. From the takes the
last layer of the default network gets a small correction, and paper mode the best network of its
data base. Calibration may only better things: half of every take is held out, and a correction that
does not hear that half better than what is in use already is thrown away.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.voice import paper_base
from hypermask.voice.features import HOP, HOP_S
from hypermask.voice.hearing import decided
from hypermask.voice.listening import Listened, listen
from hypermask.voice.lpc import FRAME, RATE_HZ, cepstra
from hypermask.voice.recurrent import UNITS, Recurrent, softmax
from hypermask.voice.shapes import SHAPE_NAMES, nearest_shape
from hypermask.voice.speaker import Speaker, unknown
from hypermask.voice.takes import ASKED, PROMPTS
from hypermask.voice.visemes import (
    CLASSES,
    SILENCE,
    VISEME_OF_CLASS,
    VISEMES,
    basis_shapes,
    class_weights,
)

_SOFT_DB = -50.0  # full scale; the loudest 300 ms of a take
_ABOVE_SILENCE_DB = 12.0
_CLIPPED = 0.999
_CLIPPED_SHARE = 0.002
_LEAST_VOWEL_S = 0.25
_MOST_VOICE_S = 0.2  # in the silence
# Of the hops the two commonest visemes have so many: at least 0.79 in the vowels of 50 speakers
# (some waver between two), in running speech less than 0.70 in 95 of 100 cases.
_HELD_SHARE = 0.75
# Another vowel is so many times as likely as the one that was asked for. Of the 100 speakers' wrong
# vowels 3.5 % pass, and 0.4 % of the right ones do not; insisted on 8.5 % pass, and none does not.
_SURELY, _INSISTED = 4.0, 8.0
_CLASS = {"a": "aa", "i": "iy", "u": "uw", "e": "eh", "o": "oa", "silence": "silence"}
_BLOCK = 6  # hops
_STEPS, _RATE = 200, 0.02
_HOLDS = (
    30.0,
    10.0,
    3.0,
    1.0,
)  # how strongly the network as shipped is held to, tried in this order

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Take:
    """asked: one of `ASKED`; steady: the hops in which it sounds; problem: None, or what is wrong
    and what to do (a code and a sentence)."""

    asked: str
    samples: _Floats  # at 16 kHz
    heard: Listened
    steady: NDArray[np.intp]
    problem: tuple[str, str] | None


@dataclass(frozen=True)
class Calibration:
    """speaker: whom to use from now on; before, after: parts of the held-out frames heard rightly;
    adapted: whether the default network has a correction; better: False where the speaker in use
    already hears no worse, and is to stay."""

    speaker: Speaker
    before: float
    after: float
    adapted: bool
    better: bool = True

    def plain(self) -> dict[str, Any]:
        return {
            "name": self.speaker.name,
            "adapted": self.adapted,
            "held_out_before": round(self.before, 4),
            "held_out_after": round(self.after, 4),
            "paper_net": self.speaker.paper_net,
        }


def check(
    asked: str, samples: NDArray[np.floating], network: Recurrent, insists: bool = False
) -> Take:
    """A take (n,) at 16 kHz, and whether it can be learnt from.

    insists: the actor was told before that this was another vowel, and says the same again; so it
    may be the network that errs, and only a quite different sound is refused.
    Problems: VOICE-SHORT, VOICE-SOFT, VOICE-CLIPPED, VOICE-NOT-VOWEL, VOICE-WRONG (another vowel),
    VOICE-NOT-SILENT. Raises `DataError` VOICE-TAKE where `asked` is none of `ASKED`.
    """
    if asked not in ASKED:
        raise DataError("VOICE-TAKE", f"there is no take '{asked}'", f"Known: {', '.join(ASKED)}.")
    finite = np.nan_to_num(np.asarray(samples, float), nan=0.0, posinf=0.0, neginf=0.0)
    heard = listen(network, [np.concatenate([finite, np.zeros(HOP)])])[0]
    chances = heard.posteriors(network)
    if asked == "silence":
        speaks = np.flatnonzero(chances[:, SILENCE] < 0.3)
        steady = np.arange(min(5, len(chances) - 1), len(chances))
        return Take(asked, finite, heard, steady, _silence_problem(finite, len(speaks) * HOP_S))
    steady = _steady(heard, chances)
    surely = _INSISTED if insists else _SURELY
    return Take(
        asked, finite, heard, steady, _vowel_problem(asked, finite, heard, chances, steady, surely)
    )


def _steady(heard: Listened, chances: NDArray[np.float32]) -> NDArray[np.intp]:
    """Hops near the loudest of the take, where somebody speaks; without onset and release."""
    loud = heard.level_db > np.percentile(heard.level_db, 95) - 12
    hops = np.flatnonzero(loud & (chances[:, SILENCE] < 0.5))
    return hops[len(hops) // 8 : len(hops) - len(hops) // 8]


def _vowel_problem(
    asked: str,
    samples: _Floats,
    heard: Listened,
    chances: NDArray[np.float32],
    steady: NDArray[np.intp],
    surely: float,
) -> tuple[str, str] | None:
    if len(samples) < 0.3 * RATE_HZ:
        return "VOICE-SHORT", "The take is too short. Hold the vowel for a second."
    if np.percentile(heard.level_db, 90) < _SOFT_DB:
        return "VOICE-SOFT", "Too soft. Speak up, or turn the microphone's gain up."
    if np.mean(np.abs(samples) >= _CLIPPED) > _CLIPPED_SHARE:
        return "VOICE-CLIPPED", "Too loud: the sound clips. Turn the microphone's gain down."
    if len(steady) * HOP_S < _LEAST_VOWEL_S:
        return "VOICE-NOT-VOWEL", "No vowel was heard. Hold it for a second."
    hops = chances[steady] @ np.eye(len(VISEMES))[VISEME_OF_CLASS]
    visemes = hops.mean(axis=0)
    best = int(np.argmax(visemes))
    if not 1 <= best < len(SHAPE_NAMES):
        return "VOICE-NOT-VOWEL", "That was no vowel. Hold it for a second, without a consonant."
    often = np.sort(np.bincount(hops.argmax(axis=1), minlength=2))[-2:]
    if often.sum() < _HELD_SHARE * len(hops):
        return "VOICE-NOT-VOWEL", "That was speech. Hold one vowel for a second."
    if visemes[best] > surely * visemes[_index(asked)]:
        return "VOICE-WRONG", f'That was "{SHAPE_NAMES[best]}". {PROMPTS[asked]}'
    return None


def _silence_problem(samples: _Floats, voice_s: float) -> tuple[str, str] | None:
    if len(samples) < 0.3 * RATE_HZ:
        return "VOICE-SHORT", "The take is too short. Stay silent for a second."
    if voice_s > _MOST_VOICE_S:
        return "VOICE-NOT-SILENT", "Somebody spoke. Stay silent for a second."
    return None


def _index(asked: str) -> int:
    return SHAPE_NAMES.index("closed" if asked == "silence" else asked)


def calibrate(
    name: str, takes: Mapping[str, Take], network: Recurrent, in_use: Speaker | None = None
) -> Calibration:
    """From one good take for each of `ASKED`; in_use: the speaker who would go on otherwise.

    Raises `DataError` with the code of the first take that is not good, or VOICE-TAKE for one that
    is missing.
    """
    for asked in ASKED:
        if asked not in takes:
            raise DataError(
                "VOICE-TAKE", f"the take '{asked}' is missing", f"Record it: {PROMPTS[asked]}"
            )
        problem = takes[asked].problem
        if problem is not None:
            raise DataError(problem[0], f"the take '{asked}' cannot be used", problem[1])
    found = _adapt(takes, network)
    if in_use is not None:
        now = _judged(network, Held(in_use.correction), *_material(takes))
        if now > found.after or (now == found.after and in_use.name == name):
            adapted = bool(np.any(in_use.correction))
            return Calibration(in_use, now[0], now[0], adapted, better=False)
        found = replace(found, before=now)
    net = paper_base.shipped().choose(
        {asked: _cepstra(take) for asked, take in takes.items() if asked != "silence"}
    )
    adapted = found.correction is not None
    kept = found.correction if found.correction is not None else unknown().correction
    return Calibration(Speaker(name, net, kept), found.before[0], found.after[0], adapted)


def _cepstra(take: Take) -> _Floats:
    begin, end = int(take.steady[0]) * HOP, (int(take.steady[-1]) + 1) * HOP
    count = max((end - begin) // FRAME, 1)
    sound = np.resize(take.samples[begin:], count * FRAME)
    return cepstra(sound.reshape(count, FRAME))


def adapt(
    takes: Mapping[str, Take], network: Recurrent
) -> tuple[float, float, NDArray[np.float32] | None]:
    """Learns from one half of each take and is judged by the other, both ways round; what helps
    (or at least makes surer and harms nothing) is then learnt from all."""
    found = _adapt(takes, network)
    return found.before[0], found.after[0], found.correction


_Score = tuple[float, float]
"""Part of the held-out frames that are right, and how sure they are on the average (log)."""


@dataclass(frozen=True)
class _Found:
    before: _Score
    after: _Score
    correction: NDArray[np.float32] | None


@dataclass(frozen=True)
class Held:
    """A correction that was learnt before, and is only judged."""

    correction: NDArray[np.float32]


def _adapt(takes: Mapping[str, Take], network: Recurrent) -> _Found:
    parts, answers = _material(takes)
    before = best = _judged(network, None, parts, answers)
    hold = None
    for strength in _HOLDS:
        found = _judged(network, strength, parts, answers)
        if found > best:
            best, hold = found, strength
    if hold is None:
        return _Found(before, before, None)
    classes = [CLASSES.index(_CLASS[asked]) for asked in takes]
    every = [np.concatenate(halves) for halves in parts]
    return _Found(before, best, _learnt(network, every, classes, hold))


_Parts = list[tuple[NDArray[np.float32], NDArray[np.float32]]]


def _material(takes: Mapping[str, Take]) -> tuple[_Parts, list[int]]:
    """The halves of every take, and the shape that each asks for."""
    return [_halves(take) for take in takes.values()], [_index(asked) for asked in takes]


def _halves(take: Take) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    one, other = halves(take.steady)
    return take.heard.hidden[one], take.heard.hidden[other]


def halves(hops: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Blocks of 60 ms by turns: a vowel's begin and end are in both."""
    first = np.arange(len(hops)) // _BLOCK % 2 == 0
    return hops[first], hops[~first]


def _judged(
    network: Recurrent,
    hold: float | Held | None,
    parts: _Parts,
    answers: list[int],
) -> _Score:
    """hold: how strongly a new correction is held to the network as shipped; None: none."""
    right, sure = [], []
    classes = [CLASSES.index(_CLASS[SHAPE_NAMES[k] if k else "silence"]) for k in answers]
    for learnt in (0, 1):
        correction = hold.correction if isinstance(hold, Held) else None
        if isinstance(hold, float):
            correction = _learnt(network, [halves[learnt] for halves in parts], classes, hold)
        for halves, answer in zip(parts, answers, strict=True):
            chances = _chances(network, halves[1 - learnt], correction)
            right.append(heard_shapes(chances) == answer)
            members = np.flatnonzero(answer == VISEME_OF_CLASS)
            sure.append(np.log(chances[:, members].sum(axis=1) + 1e-3))
    return float(np.mean(np.concatenate(right))), float(np.mean(np.concatenate(sure)))


def heard_shapes(chances: NDArray[np.floating]) -> NDArray[np.intp]:
    """Probabilities (n, classes) to the nearest of the six reference shapes."""
    parameters = decided(chances.astype(float), class_weights()) @ basis_shapes()
    return nearest_shape(parameters, basis_shapes()[: len(SHAPE_NAMES)])


def _chances(
    network: Recurrent, hidden: NDArray[np.float32], correction: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    output, bias = _head(network)
    if correction is not None:
        output, bias = output + correction[:-1], bias + correction[-1]
    return softmax(hidden @ output + bias)


def _head(network: Recurrent) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    return network.output[:, : len(CLASSES)], network.output_bias[: len(CLASSES)]


def _learnt(
    network: Recurrent, parts: list[NDArray[np.float32]], classes: list[int], hold: float
) -> NDArray[np.float32]:
    """(UNITS + 1, classes): gradient descent on the cross-entropy, every take counting the same.

    What is asked for is softened by what the network thinks anyway, so that a class next to the
    right one (another "a") is not unlearnt.
    """
    correction = np.zeros((UNITS + 1, len(CLASSES)), np.float32)
    members = [np.flatnonzero(VISEME_OF_CLASS[k] == VISEME_OF_CLASS) for k in classes]
    wanted = []
    for hidden, group in zip(parts, members, strict=True):
        chances = _chances(network, hidden, None)
        target = np.zeros_like(chances)
        target[:, group] = chances[:, group] + np.float32(1e-3)
        wanted.append(target / target.sum(axis=1, keepdims=True))
    mean = np.zeros_like(correction)
    for _ in range(_STEPS):
        gradient = np.float32(hold / 1000) * correction
        for hidden, target in zip(parts, wanted, strict=True):
            error = (_chances(network, hidden, correction) - target) / np.float32(len(hidden))
            gradient[:-1] += hidden.T @ error
            gradient[-1] += error.sum(axis=0)
        mean = np.float32(0.8) * mean + gradient
        correction -= np.float32(_RATE) * mean
    return correction
