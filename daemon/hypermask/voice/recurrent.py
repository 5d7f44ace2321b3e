"""The recurrent network at run time: two layers of gated units, plain numpy, its file.

Gated recurrent unit: Cho et al. 2014, in the form that resets after the matrix product.
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
from hypermask.voice.features import FEATURES
from hypermask.voice.visemes import CLASSES

UNITS = 96
LOOKAHEADS = 4  # 0, 10, 20, 30 ms
VERSION = 2

_Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Recurrent:
    """Weights; `output` has one column of classes for each look-ahead."""

    input_mean: _Floats  # (FEATURES,)
    input_scale: _Floats
    first_input: _Floats  # (FEATURES, 3 UNITS): reset, update, candidate
    first_state: _Floats  # (UNITS, 3 UNITS)
    first_bias: _Floats  # (2, 3 UNITS): of the input, of the state
    second_input: _Floats  # (UNITS, 3 UNITS)
    second_state: _Floats
    second_bias: _Floats
    output: _Floats  # (UNITS, LOOKAHEADS * classes)
    output_bias: _Floats

    def start(self, streams: int = 1) -> State:
        return np.zeros((2, streams, UNITS), np.float32)

    def step(self, state: State, features: _Floats) -> _Floats:
        """One frame of each stream: features (streams, FEATURES) to hidden units (streams, UNITS).

        `state` (2, streams, UNITS) is moved on in place.
        """
        x = (features - self.input_mean) / self.input_scale
        _gated(x, state[0], self.first_input, self.first_state, self.first_bias)
        _gated(state[0], state[1], self.second_input, self.second_state, self.second_bias)
        hidden: State = state[1]
        return hidden

    def posteriors(self, hidden: _Floats, lookahead: int = 0) -> _Floats:
        """Hidden units (n, UNITS) to probabilities (n, classes) of the frame `lookahead` ago."""
        columns = slice(lookahead * len(CLASSES), (lookahead + 1) * len(CLASSES))
        return softmax(hidden @ self.output[:, columns] + self.output_bias[columns])


State = NDArray[np.float32]


def _gated(x: _Floats, h: _Floats, w: _Floats, u: _Floats, bias: _Floats) -> None:
    units = h.shape[1]
    from_input = x @ w + bias[0]
    from_state = h @ u + bias[1]
    gates = sigmoid(from_input[:, : 2 * units] + from_state[:, : 2 * units])
    reset, update = gates[:, :units], gates[:, units:]
    candidate = np.tanh(from_input[:, 2 * units :] + reset * from_state[:, 2 * units :])
    h += (1 - update) * (candidate - h)


def sigmoid(x: _Floats) -> _Floats:
    return np.asarray(np.float32(0.5) * (np.tanh(np.float32(0.5) * x) + np.float32(1)))


def softmax(x: _Floats) -> _Floats:
    weights = np.exp(x - x.max(axis=-1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True))


def shapes() -> dict[str, tuple[int, ...]]:
    outputs = LOOKAHEADS * len(CLASSES)
    return {
        "input_mean": (FEATURES,),
        "input_scale": (FEATURES,),
        "first_input": (FEATURES, 3 * UNITS),
        "first_state": (UNITS, 3 * UNITS),
        "first_bias": (2, 3 * UNITS),
        "second_input": (UNITS, 3 * UNITS),
        "second_state": (UNITS, 3 * UNITS),
        "second_bias": (2, 3 * UNITS),
        "output": (UNITS, outputs),
        "output_bias": (outputs,),
    }


def save(network: Recurrent, path: Path) -> None:
    """Half precision, versioned npz. Raises `HypermaskError` DISK-WRITE."""
    arrays = {f.name: getattr(network, f.name).astype(np.float16) for f in fields(network)}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, version=np.int64(VERSION), classes=np.array(CLASSES), **arrays)
    write_atomically(path, buffer.getvalue())


def load(path: Path) -> Recurrent:
    """Raises `DataError` VOICE-NET where the file is absent, damaged or of another version."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            version, classes = int(stored["version"]), tuple(stored["classes"].tolist())
            arrays = {name: stored[name].astype(np.float32) for name in shapes()}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise _bad(path, f"cannot be read: {error}") from error
    if version != VERSION or classes != CLASSES:
        raise _bad(path, f"has version {version}, this program reads {VERSION}")
    for name, shape in shapes().items():
        if arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
            raise _bad(path, f"has a wrong '{name}'")
    return Recurrent(**arrays)


def shipped() -> Recurrent:
    """The network that came with the program."""
    return load(Path(__file__).parent / "data" / "default.npz")


def _bad(path: Path, why: str) -> DataError:
    return DataError(
        "VOICE-NET",
        f"the voice network {path} {why}",
        "Install the program again, or train it with python -m hypermask.voice.default_train.",
    )
