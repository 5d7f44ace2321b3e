"""What others do, to compare with: MFCC templates of one speaker, and a mouth that only flaps.

Templates as in uLipSync (Hecomi): twelve mel cepstral coefficients, one mean for each vowel of the
calibrated speaker, the nearest wins, the level opens. Flapping: the level opens /a/, nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.voice.features import BANDS, HOP, WINDOW, LogMel
from hypermask.voice.hearing import Heard
from hypermask.voice.shapes import CLOSED, SHAPE_NAMES
from hypermask.voice.visemes import BASIS

COEFFICIENTS = 12
_RANGE_DB = (-22.0, -8.0)  # relative to the loudest so far: where the mouth begins and ends opening
_FORGETS_DB = 0.02  # a hop

_Floats = NDArray[np.float64]

_COSINES = np.cos(
    np.pi / BANDS * np.outer(np.arange(BANDS) + 0.5, np.arange(1, COEFFICIENTS + 1))
) * np.sqrt(2 / BANDS)


def mfcc(bands_db: NDArray[np.floating]) -> _Floats:
    """Log-mel spectra (..., 32) to mel cepstra (..., 12), without the level."""
    return np.asarray(bands_db @ _COSINES, np.float64)


@dataclass(frozen=True)
class Templates:
    """means: (5, 12) of a, i, u, e, o; scale: (12,)."""

    means: _Floats
    scale: _Floats

    def nearest(self, cepstra: _Floats) -> NDArray[np.intp]:
        """(n, 12) to indices of `SHAPE_NAMES`."""
        off = (cepstra[:, None] - self.means) / self.scale
        return np.asarray(1 + np.argmin(np.sum(off**2, axis=2), axis=1))


def learn(vowels: Mapping[str, _Floats]) -> Templates:
    """From mel cepstra (n, 12) of each of the five vowels; one that is missing is never heard."""
    means = [
        vowels[name].mean(axis=0) if name in vowels else np.full(COEFFICIENTS, np.inf)
        for name in SHAPE_NAMES[1:]
    ]
    spread = np.concatenate([v - v.mean(axis=0) for v in vowels.values()]).std(axis=0)
    return Templates(np.array(means), spread + 1e-6)


class LevelEar:
    """Opens /a/ with the level."""

    window, hop, delay = WINDOW, HOP, 0

    def __init__(self) -> None:
        self._loudest_db = -60.0
        self._spectrum = LogMel()

    def hear(self, sound: _Floats) -> Heard:
        bands = self._spectrum((sound - sound.mean())[None]).bands_db
        level_db = float(10 * np.log10(np.sum(10 ** (bands / 10)) + 1e-10))
        self._loudest_db = max(self._loudest_db - _FORGETS_DB, level_db)
        low, high = _RANGE_DB
        amount = float(np.clip((level_db - self._loudest_db - low) / (high - low), 0, 1))
        weights = np.zeros(len(BASIS))
        weights[self._shape(bands)] = amount
        weights[CLOSED] += 1 - amount
        return Heard(weights, level_db, 1 - amount)

    def restart(self) -> None:
        return

    def _shape(self, bands: NDArray[np.float32]) -> int:
        return SHAPE_NAMES.index("a")


class TemplateEar(LevelEar):
    """The nearest template's vowel, opened with the level."""

    def __init__(self, templates: Templates) -> None:
        super().__init__()
        self._templates = templates

    def _shape(self, bands: NDArray[np.float32]) -> int:
        return int(self._templates.nearest(mfcc(bands))[0])
