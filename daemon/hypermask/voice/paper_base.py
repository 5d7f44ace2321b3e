"""PAPERS A6: a data base of 100 speakers' networks; a new speaker gets the one that fits him best.

The new speaker says the five vowels; every network is tried, and the one whose outputs come nearest
to the five reference shapes is kept.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.storage import write_atomically
from hypermask.voice.lpc import ORDER
from hypermask.voice.network import HIDDEN, OUTPUTS, Network, sigmoid
from hypermask.voice.shapes import SHAPE_NAMES, spread

VERSION = 2
_SIZES = {
    "input_mean": (ORDER,),
    "input_scale": (ORDER,),
    "hidden_weights": (ORDER, HIDDEN),
    "hidden_bias": (HIDDEN,),
    "output_weights": (HIDDEN, OUTPUTS),
    "output_bias": (OUTPUTS,),
}

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PaperBase:
    """names: of the speakers; weights: each array of `Network` with the speakers in front;
    shapes (6, 13); usual: the one who fits most others best, for who was never calibrated."""

    names: tuple[str, ...]
    weights: Mapping[str, _Floats]
    shapes: _Floats
    usual: str

    def network(self, name: str) -> Network:
        """Raises `DataError` VOICE-BASE where nobody has this name."""
        if name not in self.names:
            raise DataError(
                "VOICE-BASE",
                f"the data base of voices has no speaker '{name}'",
                "Calibrate the voice again (hypermask voice calibrate).",
            )
        row = self.names.index(name)
        return Network(**{k: v[row] for k, v in self.weights.items()}, shapes=self.shapes)

    def outputs(self, cepstra: _Floats) -> _Floats:
        """Every network's mouth parameters: (n, 20) -> (speakers, n, 13)."""
        w = self.weights
        scaled = (cepstra[None] - w["input_mean"][:, None]) / w["input_scale"][:, None]
        hidden = sigmoid(scaled @ w["hidden_weights"] + w["hidden_bias"][:, None])
        return np.asarray(hidden @ w["output_weights"] + w["output_bias"][:, None])

    def errors(self, vowels: Mapping[str, _Floats]) -> _Floats:
        """(speakers,): how far each network's mouths are from the reference shapes.

        vowels: {"a": cepstra (n, 20), ...}. Parameters count by their spread over the shapes.
        """
        scale = spread(self.shapes)
        total = np.zeros(len(self.names))
        for name, cepstra in vowels.items():
            off = (self.outputs(cepstra) - self.shapes[SHAPE_NAMES.index(name)]) / scale
            # A network that has never heard such a sound answers with any number.
            total += np.minimum(np.mean(off**2, axis=2), 4.0).mean(axis=1)
        return total / max(len(vowels), 1)

    def choose(self, vowels: Mapping[str, _Floats], without: str | None = None) -> str:
        """The speaker whose network fits best; `without` is one who must not be chosen."""
        errors = self.errors(vowels)
        if without in self.names:
            errors[self.names.index(without)] = np.inf
        return self.names[int(np.argmin(errors))]


def save(base: PaperBase, path: Path) -> None:
    """Half precision. Raises `HypermaskError` DISK-WRITE."""
    arrays: dict[str, Any] = {name: base.weights[name].astype(np.float16) for name in _SIZES}
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        version=np.int64(VERSION),
        names=np.array(base.names),
        usual=np.array(base.usual),
        shapes=base.shapes.astype(np.float32),
        **arrays,
    )
    write_atomically(path, buffer.getvalue())


def load(path: Path) -> PaperBase:
    """Raises `DataError` VOICE-NET where the file is absent, damaged or of another version."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            version = int(stored["version"])
            names = tuple(str(name) for name in stored["names"])
            usual = str(stored["usual"])
            shapes = stored["shapes"].astype(np.float64)
            weights = {name: stored[name].astype(np.float64) for name in _SIZES}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise _bad(path, f"cannot be read: {error}") from error
    if version != VERSION:
        raise _bad(path, f"has version {version}, this program reads {VERSION}")
    for name, size in _SIZES.items():
        if weights[name].shape != (len(names), *size) or not np.isfinite(weights[name]).all():
            raise _bad(path, f"has a wrong '{name}'")
    if shapes.shape != (len(SHAPE_NAMES), OUTPUTS) or usual not in names:
        raise _bad(path, "has wrong shapes")
    return PaperBase(names, weights, shapes, usual)


def shipped() -> PaperBase:
    """The data base that came with the program."""
    return load(Path(__file__).parent / "data" / "paper.npz")


def shipped_choice(name: str | None) -> Network:
    """One speaker's network, or the usual one. Raises `DataError` VOICE-NET, VOICE-BASE."""
    base = shipped()
    return base.network(name or base.usual)


def _bad(path: Path, why: str) -> DataError:
    return DataError(
        "VOICE-NET",
        f"the data base of voices {path} {why}",
        "Install the program again, or train it with python -m hypermask.voice.paper_train.",
    )
