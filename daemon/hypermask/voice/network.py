"""The paper's network: 20 cepstral coefficients, 20 sigmoid units, 13 mouth parameters.

Yotsukura et al. 2001 (HYPERMASK), section on voice. Plain numpy at run time.
"""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.storage import write_atomically
from hypermask.voice.lpc import ORDER

HIDDEN = 20
OUTPUTS = 13
VERSION = 1

_Floats = NDArray[np.float64]


def sigmoid(x: _Floats) -> _Floats:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * x)))


@dataclass(frozen=True)
class Network:
    """Weights, and the reference shapes (6, 13) in whose parameters the outputs are."""

    input_mean: _Floats  # (20,)
    input_scale: _Floats  # (20,)
    hidden_weights: _Floats  # (20, 20)
    hidden_bias: _Floats  # (20,)
    output_weights: _Floats  # (20, 13)
    output_bias: _Floats  # (13,)
    shapes: _Floats  # (6, 13), see `hypermask.voice.shapes.SHAPE_NAMES`

    def __call__(self, cepstra: _Floats) -> _Floats:
        """Cepstra (n, 20) to mouth parameters (n, 13)."""
        hidden = sigmoid(
            (cepstra - self.input_mean) / self.input_scale @ self.hidden_weights + self.hidden_bias
        )
        return np.asarray(hidden @ self.output_weights + self.output_bias)


_SHAPES = {
    "input_mean": (ORDER,),
    "input_scale": (ORDER,),
    "hidden_weights": (ORDER, HIDDEN),
    "hidden_bias": (HIDDEN,),
    "output_weights": (HIDDEN, OUTPUTS),
    "output_bias": (OUTPUTS,),
    "shapes": (6, OUTPUTS),
}


def save(network: Network, path: Path) -> None:
    """Writes a versioned npz. Raises `HypermaskError` DISK-WRITE."""
    arrays = {f.name: getattr(network, f.name).astype(np.float32) for f in fields(network)}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, version=np.int64(VERSION), **arrays)
    write_atomically(path, buffer.getvalue())


def load(path: Path) -> Network:
    """Raises `DataError` VOICE-NET where the file is absent, damaged or of another version."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            version = int(stored["version"])
            arrays = {name: stored[name].astype(np.float64) for name in _SHAPES}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise _bad(path, f"cannot be read: {error}") from error
    if version != VERSION:
        raise _bad(path, f"has version {version}, this program reads {VERSION}")
    for name, shape in _SHAPES.items():
        if arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
            raise _bad(path, f"has a wrong '{name}'")
    return Network(**arrays)


def shipped(model: str) -> Network:
    """The network that came with the program: "default" or "paper"."""
    return load(Path(__file__).parent / "data" / f"{model}.npz")


def _bad(path: Path, why: str) -> DataError:
    return DataError(
        "VOICE-NET",
        f"the voice network {path} {why}",
        "Install the program again, or train it with python -m hypermask.voice.train.",
    )
