"""Whole recordings through the recurrent network, heard as a show does: from the first sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.voice.features import HOP, WINDOW, LogMel, Normaliser, Spectrum, framed
from hypermask.voice.recurrent import Recurrent


@dataclass(frozen=True)
class Listened:
    """For each hop of 10 ms: hidden units (n, UNITS), level_db (n,); frame k is of its middle."""

    hidden: NDArray[np.float32]
    level_db: NDArray[np.float32]

    def posteriors(self, network: Recurrent, lookahead: int = 0) -> NDArray[np.float32]:
        """(n, classes); a network that waits answers for the frame `lookahead` hops ago."""
        late = np.concatenate([self.hidden[lookahead:], np.repeat(self.hidden[-1:], lookahead, 0)])
        return network.posteriors(late, lookahead)


def listen(network: Recurrent, recordings: list[NDArray[np.floating]]) -> list[Listened]:
    """Recordings at 16 kHz, each from a cold start; together, because that is quicker."""
    counts = [max(len(sound) // HOP, 1) for sound in recordings]
    spectrum, frames = LogMel(), max(counts, default=0)
    before = (WINDOW - HOP) // 2
    heard = []
    for sound in recordings:
        padded = np.zeros(before + frames * HOP + WINDOW, np.float32)
        padded[before : before + len(sound)] = sound
        heard.append(spectrum(framed(padded)[:frames]))
    normaliser, state = Normaliser(len(recordings)), network.start(len(recordings))
    hidden = np.empty((frames, *state[1].shape), np.float32)
    level = np.empty((frames, len(recordings)), np.float32)
    bands, voicing, pitch = (np.stack([getattr(one, name) for one in heard]) for name in _PARTS)
    for k in range(frames):
        frame = Spectrum(bands[:, k], voicing[:, k], pitch[:, k])
        features, level[k] = normaliser(frame)
        hidden[k] = network.step(state, features)
    return [Listened(hidden[:n, row], level[:n, row]) for row, n in enumerate(counts)]


_PARTS = ("bands_db", "voicing", "pitch_hz")
