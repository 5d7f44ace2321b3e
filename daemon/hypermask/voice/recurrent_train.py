"""Back-propagation through time for the recurrent network (Werbos 1990), in plain numpy."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.voice import recurrent
from hypermask.voice.recurrent import LOOKAHEADS, UNITS, Recurrent, sigmoid, softmax
from hypermask.voice.visemes import CLASSES

_Floats = NDArray[np.float32]
_CLIP = 1.0  # of the gradient's norm
_DECAY = 1e-5
_WARM = 100  # iterations
_DROPPED = 0.1


@dataclass(frozen=True)
class Sequences:
    """features (n, frames, FEATURES); targets (n, frames, classes); weight (n, frames)."""

    features: NDArray[np.float16]
    targets: NDArray[np.float16]
    weight: NDArray[np.float16]


@dataclass(frozen=True)
class Lesson:
    """What a batch takes of some sequences: `batch` of them, of each `frames` frames from a random
    one on; share: of its mean loss in the whole."""

    sequences: Sequences
    batch: int = 48
    frames: int = 200
    share: float = 1.0

    def batches(self, rng: np.random.Generator) -> Iterator[tuple[_Floats, _Floats, _Floats]]:
        """Features, targets and weight, without end; every sequence once before any twice."""
        order = np.zeros(0, np.intp)
        count, length = self.sequences.features.shape[:2]
        while True:
            if len(order) < self.batch:
                order = rng.permutation(count)
            chosen, order = order[: self.batch], order[self.batch :]
            begin = int(rng.integers(0, max(length - self.frames, 0) + 1))
            part = (chosen, slice(begin, begin + self.frames))
            yield (
                self.sequences.features[part].astype(np.float32),
                self.sequences.targets[part].astype(np.float32),
                self.sequences.weight[part].astype(np.float32),
            )


def initial(features: NDArray[np.floating], rng: np.random.Generator) -> dict[str, _Floats]:
    """features (n, frames, FEATURES): what the input's mean and scale are taken from."""
    every = features[:: max(len(features) // 200, 1)].astype(np.float32)
    weights = {}
    for name, shape in recurrent.shapes().items():
        spread = shape[0] ** -0.5 if len(shape) == 2 and "bias" not in name else 0.0
        weights[name] = rng.normal(0, max(spread, 1e-12), shape).astype(np.float32)
    weights["input_mean"] = every.mean(axis=(0, 1))
    weights["input_scale"] = every.std(axis=(0, 1)) + np.float32(1e-3)
    return weights


def train(
    lessons: Sequence[Lesson],
    iterations: int,
    rng: np.random.Generator,
    rate: float = 3e-3,
    progress: Callable[[float], None] = lambda loss: None,
    start: Recurrent | None = None,
) -> Recurrent:
    """Each of the `iterations` takes one batch of every lesson; `progress` gets their loss.

    start: a network to go on from.
    The rate rises over the first `_WARM` iterations and falls along a cosine (Loshchilov and
    Hutter 2017).
    """
    if start is None:
        weights = initial(lessons[0].sequences.features, rng)
    else:
        weights = {name: weight.copy() for name, weight in vars(start).items()}
    step = _Adam({k: v for k, v in weights.items() if not k.startswith("input_")})
    sources = [(lesson.share, lesson.batches(rng)) for lesson in lessons]
    for number in range(iterations):
        total: dict[str, _Floats] = {}
        whole = 0.0
        for share, batches in sources:
            batch = next(batches)
            loss, gradients = loss_and_gradients(weights, *batch, _kept(len(batch[0]), rng))
            whole += share * loss
            for name, gradient in gradients.items():
                part = np.float32(share) * gradient
                total[name] = total[name] + part if name in total else part
        warm = min(1.0, (number + 1) / _WARM)
        step(total, rate * warm * 0.5 * (1 + np.cos(np.pi * number / iterations)) + 1e-6)
        progress(whole)
    return Recurrent(**weights)


def _kept(streams: int, rng: np.random.Generator) -> tuple[_Floats, _Floats]:
    """Units of each layer that the next one hears, the same ones over a whole sequence (dropout,
    Srivastava et al. 2014; Zaremba et al. 2014)."""
    first, second = rng.random((2, streams, UNITS)) >= _DROPPED
    scale = np.float32(1 / (1 - _DROPPED))
    return first * scale, second * scale


def loss_and_gradients(
    weights: dict[str, _Floats],
    features: _Floats,
    targets: _Floats,
    weight: _Floats,
    kept: tuple[_Floats, _Floats] | None = None,
) -> tuple[float, dict[str, _Floats]]:
    """Mean cross-entropy over frames and look-aheads, and its derivatives.

    kept: (streams, UNITS) of either layer, factors of what it gives on.
    """
    x = np.ascontiguousarray(
        ((features - weights["input_mean"]) / weights["input_scale"]).transpose(1, 0, 2)
    )
    first = _Layer(weights, "first")
    second = _Layer(weights, "second")
    between, after = kept if kept is not None else (np.float32(1), np.float32(1))
    hidden = second.forward(first.forward(x) * between) * after
    loss, gradients, back = _output(weights, hidden, targets, weight)
    back = second.backward(back * after, gradients)
    first.backward(back * between, gradients)
    return loss, gradients


def _output(
    weights: dict[str, _Floats], hidden: _Floats, targets: _Floats, weight: _Floats
) -> tuple[float, dict[str, _Floats], _Floats]:
    """The four look-aheads: the one of n frames is scored on the targets n frames ago."""
    frames, streams, _ = hidden.shape
    count = len(CLASSES)
    logits = hidden @ weights["output"] + weights["output_bias"]
    total = max(float(weight.sum()) * LOOKAHEADS, 1.0)
    error = np.zeros_like(logits)
    loss = 0.0
    for ahead in range(LOOKAHEADS):
        columns = slice(ahead * count, (ahead + 1) * count)
        wanted = targets.transpose(1, 0, 2)[: frames - ahead]
        counted = weight.T[: frames - ahead, :, None] / np.float32(total)
        found = softmax(logits[ahead:, :, columns])
        error[ahead:, :, columns] = (found - wanted) * counted
        loss -= float(np.sum(wanted * np.log(found + 1e-8) * counted))
    flat = error.reshape(frames * streams, -1)
    gradients = {
        "output": hidden.reshape(frames * streams, -1).T @ flat,
        "output_bias": flat.sum(axis=0),
    }
    return loss, gradients, error @ weights["output"].T


class _Layer:
    def __init__(self, weights: dict[str, _Floats], name: str) -> None:
        self._w, self._u = weights[f"{name}_input"], weights[f"{name}_state"]
        self._bias, self._name = weights[f"{name}_bias"], name

    def forward(self, x: _Floats) -> _Floats:
        """(frames, streams, inputs) to (frames, streams, UNITS)."""
        frames, streams, _ = x.shape
        self._x = x
        from_input = x @ self._w + self._bias[0]
        h = np.zeros((frames + 1, streams, UNITS), np.float32)
        self._gates = np.empty((frames, streams, 2 * UNITS), np.float32)
        self._candidate = np.empty((frames, streams, UNITS), np.float32)
        self._from_state = np.empty((frames, streams, UNITS), np.float32)
        for t in range(frames):
            from_state = h[t] @ self._u + self._bias[1]
            gates = sigmoid(from_input[t, :, : 2 * UNITS] + from_state[:, : 2 * UNITS])
            self._gates[t], self._from_state[t] = gates, from_state[:, 2 * UNITS :]
            candidate = np.tanh(
                from_input[t, :, 2 * UNITS :] + gates[:, :UNITS] * self._from_state[t]
            )
            self._candidate[t] = candidate
            update = gates[:, UNITS:]
            h[t + 1] = candidate + update * (h[t] - candidate)
        self._h = h
        return h[1:]

    def backward(self, back: _Floats, gradients: dict[str, _Floats]) -> _Floats:
        """Derivatives by the outputs to those by the inputs; adds the weights' to `gradients`."""
        frames, streams, _ = back.shape
        by_input = np.empty((frames, streams, 3 * UNITS), np.float32)
        by_state = np.empty((frames, streams, 3 * UNITS), np.float32)
        carried = np.zeros((streams, UNITS), np.float32)
        transposed = np.ascontiguousarray(self._u.T)
        for t in range(frames - 1, -1, -1):
            carried = carried + back[t]
            reset, update = self._gates[t, :, :UNITS], self._gates[t, :, UNITS:]
            candidate = self._candidate[t]
            d_candidate = carried * (1 - update) * (1 - candidate**2)
            d_update = carried * (self._h[t] - candidate) * update * (1 - update)
            d_reset = d_candidate * self._from_state[t] * reset * (1 - reset)
            by_input[t, :, :UNITS] = by_state[t, :, :UNITS] = d_reset
            by_input[t, :, UNITS : 2 * UNITS] = by_state[t, :, UNITS : 2 * UNITS] = d_update
            by_input[t, :, 2 * UNITS :] = d_candidate
            by_state[t, :, 2 * UNITS :] = d_candidate * reset
            carried = carried * update + by_state[t] @ transposed
        name = self._name
        flat_input = by_input.reshape(frames * streams, -1)
        flat_state = by_state.reshape(frames * streams, -1)
        gradients[f"{name}_input"] = self._x.reshape(frames * streams, -1).T @ flat_input
        gradients[f"{name}_state"] = self._h[:-1].reshape(frames * streams, -1).T @ flat_state
        gradients[f"{name}_bias"] = np.stack([flat_input.sum(axis=0), flat_state.sum(axis=0)])
        return by_input @ self._w.T


class _Adam:
    """Kingma and Ba 2015, with the gradient's norm held (Pascanu et al. 2013)."""

    def __init__(self, weights: dict[str, _Floats]) -> None:
        self._weights = weights
        self._mean = {name: np.zeros_like(weight) for name, weight in weights.items()}
        self._square = {name: np.zeros_like(weight) for name, weight in weights.items()}
        self._count = 0

    def __call__(self, gradients: dict[str, _Floats], rate: float) -> None:
        self._count += 1
        norm = float(np.sqrt(sum(float(np.sum(g**2)) for g in gradients.values())))
        held = np.float32(min(1.0, _CLIP / max(norm, 1e-12)))
        for name, weight in self._weights.items():
            gradient = gradients[name] * held + np.float32(_DECAY) * weight
            mean, square = self._mean[name], self._square[name]
            mean += np.float32(0.1) * (gradient - mean)
            square += np.float32(0.005) * (gradient**2 - square)
            sized = mean / np.float32(1 - 0.9**self._count)
            spread = np.sqrt(square / np.float32(1 - 0.995**self._count)) + np.float32(1e-8)
            weight -= np.float32(rate) * sized / spread
