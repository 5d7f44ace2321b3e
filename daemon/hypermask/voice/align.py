"""Connected speech against its phone times: is the mouth right, and is it in time?

Frame accuracy: every 10 ms the viseme (of nine) whose mouth is nearest to the thirteen parameters
is compared with the one spoken. A closure is seen when the lips meet while /p b m/ is spoken or
soon after. All times count from when a frame's parameters exist, not from its time stamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask.voice.features import HOP_S
from hypermask.voice.follower import MouthFollower, MouthFrame
from hypermask.voice.hearing import Ear
from hypermask.voice.phones import read_phones
from hypermask.voice.settings import VoiceSettings
from hypermask.voice.speaker import Speaker
from hypermask.voice.synthesis import Phone
from hypermask.voice.visemes import (
    CLASSES,
    LIPS,
    SILENCE,
    VISEME_OF_CLASS,
    VISEMES,
    basis_shapes,
    class_weights,
)
from hypermask.voice.wav import read_wav

OPEN = 0.1  # half widths of the mouth between the lips' inner edges; less is shut
LONG_PAUSE_S = 0.3
_CLOSES_S = 0.1  # at the beginning of a pause in which a mouth may still be closing
_OPENS_S = 0.04  # at its end: speech begins before it is loud
_LATE_S = 0.06  # after a closure's end in which it still counts as seen
_EARLY_S = 0.05
_CLOSES = frozenset("pbmPBM")  # lips only come near each other for the Spanish "b" in "lobo"
_BLOCK_S = 0.01
_SHORT = 0.5  # a vowel's mouth at this opening is still its mouth

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Scores:
    """frame_accuracy and macro_f1 of nine visemes; closure_recall; closure_delay_ms (median, from
    the closure's begin in the sound to the lips meeting, latency included); false_opening: share
    of long pauses with the mouth open; jitter: mean change of the opening's change from frame to
    frame, half widths. NaN where the speech has nothing to measure."""

    frame_accuracy: float
    macro_f1: float
    closure_recall: float
    closure_delay_ms: float
    false_opening: float
    jitter: float


@dataclass(frozen=True)
class Track:
    """A mouth over time: time_s (n,) of the sound it shows; parameters (n, 13); latency_s: how
    much later they exist."""

    time_s: _Floats
    parameters: _Floats
    latency_s: float

    @property
    def opening(self) -> _Floats:
        """Between the inner edges of the lips, in half widths of the mouth."""
        return np.maximum(self.parameters[:, 2] - self.parameters[:, 4], 0.0)

    def at(self, time_s: _Floats) -> NDArray[np.intp]:
        """Index of the frame that is shown for each of these times."""
        after = np.searchsorted(self.time_s, time_s).clip(1, len(self.time_s) - 1)
        nearer = time_s - self.time_s[after - 1] < self.time_s[after] - time_s
        return np.asarray(after - nearer)


def follow(
    sound: NDArray[np.floating],
    rate_hz: float,
    settings: VoiceSettings | None = None,
    speaker: Speaker | None = None,
    ear: Ear | None = None,
) -> tuple[Track, list[MouthFrame]]:
    """What a show would do with this recording, in blocks of 10 ms."""
    follower = MouthFollower(rate_hz, settings, speaker, ear=ear)
    block = max(round(_BLOCK_S * rate_hz), 1)
    padded = np.concatenate([sound, np.zeros(int(0.1 * rate_hz))])
    frames: list[MouthFrame] = []
    for at in range(0, len(padded), block):
        frames += follower.feed(padded[at : at + block], at / rate_hz)
    times = np.array([frame.time_s for frame in frames])
    mouths = np.array([frame.parameters for frame in frames])
    return Track(times, mouths, follower.latency_s), frames


def align(wav: Path, phones: Path, settings: VoiceSettings | None = None) -> dict[str, Any]:
    """The scores of one recording, as plain data.

    Raises `DataError` VOICE-WAV, VOICE-PHONES, VOICE-RATE or VOICE-NET.
    """
    spoken = read_phones(phones)
    sound, rate_hz = read_wav(wav)
    track, _ = follow(sound, rate_hz, settings)
    return report([(track, spoken)])


def report(spoken: Sequence[tuple[Track, Sequence[Phone]]]) -> dict[str, Any]:
    """Scores over recordings together, the F1 of each viseme, and how much there was to score."""
    true, seen, delays, missed, open_s, pause_s, jerks = [], [], [], 0, 0.0, 0.0, []
    for track, phones in spoken:
        wanted, found = frames(track, phones)
        true.append(wanted)
        seen.append(found)
        recording = closures(track, phones)
        delays += [delay for delay in recording if delay is not None]
        missed += sum(delay is None for delay in recording)
        opened, silent = pauses(track, phones)
        open_s, pause_s = open_s + opened, pause_s + silent
        jerks.append(np.abs(np.diff(track.opening, 2)))
    wanted, found = np.concatenate(true), np.concatenate(seen)
    f1 = _f1(wanted, found)
    closed = len(delays) + missed
    scores = Scores(
        frame_accuracy=float(np.mean(wanted == found)) if len(wanted) else float("nan"),
        macro_f1=float(np.mean(list(f1.values()))) if f1 else float("nan"),
        closure_recall=len(delays) / closed if closed else float("nan"),
        closure_delay_ms=1e3 * float(np.median(delays)) if delays else float("nan"),
        false_opening=open_s / pause_s if pause_s > 0 else float("nan"),
        jitter=float(np.mean(np.concatenate(jerks))),
    )
    plain = {k: None if np.isnan(v) else round(v, 4) for k, v in asdict(scores).items()}
    latency_ms = round(1e3 * max(track.latency_s for track, _ in spoken), 2)
    counts = {"frames": len(wanted), "closures": closed, "pause_s": round(pause_s, 2)}
    return (
        plain | counts | {"latency_ms": latency_ms, "f1": {k: round(v, 4) for k, v in f1.items()}}
    )


def frames(track: Track, phones: Sequence[Phone]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Visemes spoken and shown, every 10 ms of the known phones."""
    times, wanted = [], []
    for phone in phones:
        inside = np.arange(np.ceil(phone.begin_s / HOP_S), np.ceil(phone.end_s / HOP_S)) * HOP_S
        if not phone.classes:
            continue
        turn = int(np.ceil(0.6 * len(inside))) if len(phone.classes) > 1 else len(inside)
        times.append(inside)
        wanted += [phone.classes[0]] * turn + [phone.classes[-1]] * (len(inside) - turn)
    if not wanted:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    shown = track.parameters[track.at(np.concatenate(times))]
    return VISEME_OF_CLASS[np.array(wanted)], visemes_of(shown)


def visemes_of(parameters: _Floats) -> NDArray[np.intp]:
    """(n, 13) to the viseme whose mouth, or whose mouth half opened, is nearest."""
    targets, owner = _targets()
    scale = np.maximum(targets.std(axis=0), 0.02)
    distance = np.sum(((parameters[:, None] - targets) / scale) ** 2, axis=2)
    return np.asarray(owner[np.argmin(distance, axis=1)])


def _targets() -> tuple[_Floats, NDArray[np.intp]]:
    """The mouths (m, 13) of all classes, vowels also as a soft voice opens them."""
    whole = class_weights() @ basis_shapes()
    vowels = [k for k, name in enumerate(CLASSES) if VISEMES[VISEME_OF_CLASS[k]] in "aiueo"]
    kept = [k for k in range(len(CLASSES)) if k != SILENCE]
    targets = np.concatenate([whole[kept], (0.5 * (1 + _SHORT)) * whole[vowels]])
    return targets, VISEME_OF_CLASS[np.array([*kept, *vowels])]


def _f1(wanted: NDArray[np.intp], found: NDArray[np.intp]) -> dict[str, float]:
    """Of every viseme that is spoken."""
    scores = {}
    for k, name in enumerate(VISEMES):
        both = float(np.sum((wanted == k) & (found == k)))
        if np.any(wanted == k):
            scores[name] = 2 * both / float(np.sum(wanted == k) + np.sum(found == k))
    return scores


def closures(track: Track, phones: Sequence[Phone]) -> list[float | None]:
    """For each /p b m/ the seconds until the lips met (None: never), the mouth's delay included.

    A run of them is one closure. Lips that met before count from the closure's begin.
    """
    delays: list[float | None] = []
    spans: list[list[float]] = []
    for phone in phones:
        if phone.label[:1] in _CLOSES and phone.classes and phone.classes[0] == LIPS:
            if spans and phone.begin_s - spans[-1][1] < 1e-3:
                spans[-1][1] = phone.end_s
            else:
                spans.append([phone.begin_s, phone.end_s])
    shut = track.time_s[track.opening <= OPEN]
    for begin, end in spans:
        met = shut[(shut >= begin - _EARLY_S) & (shut <= end + _LATE_S)]
        delays.append(max(float(met[0]) - begin, 0.0) + track.latency_s if len(met) else None)
    return delays


def pauses(track: Track, phones: Sequence[Phone]) -> tuple[float, float]:
    """Seconds with the mouth open in pauses of 300 ms and more, and seconds of such pauses.

    The first 100 ms of a pause are the mouth's to close, the last 40 to open.
    """
    spans: list[list[float]] = []
    for phone in phones:
        if phone.classes and phone.classes[0] == SILENCE:
            if spans and phone.begin_s - spans[-1][1] < 1e-3:
                spans[-1][1] = phone.end_s
            else:
                spans.append([phone.begin_s, phone.end_s])
    opened = total = 0.0
    for begin, end in spans:
        if end - begin < LONG_PAUSE_S:
            continue
        times = np.arange(begin + _CLOSES_S, end - _OPENS_S, HOP_S)
        opened += HOP_S * float(np.sum(track.opening[track.at(times)] > OPEN))
        total += HOP_S * len(times)
    return opened, total
