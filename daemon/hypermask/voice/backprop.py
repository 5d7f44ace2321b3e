"""Back-propagation for the small network.

Rumelhart, Hinton and Williams 1986; step sizes as Kingma and Ba 2015 (Adam).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from hypermask.voice.examples import Examples
from hypermask.voice.lpc import ORDER
from hypermask.voice.network import HIDDEN, Network, sigmoid
from hypermask.voice.shapes import CLOSED

_BATCH = 256
_RATE = 5e-3
_DECAY = 1e-4  # of the weights: keeps the net from learning single speakers by heart

_Floats = NDArray[np.float64]


def train(
    taught: Examples,
    shapes: _Floats,
    iterations: int,
    rng: np.random.Generator,
    progress: Callable[[], None] = lambda: None,
) -> Network:
    """A network whose outputs are mouth parameters; `iterations` are mini-batches of 256.

    Every shape is shown equally often. The error is taken where all six shapes are equally far
    from each other, in the weights of their interpolation; the output layer then mixes `shapes`
    (6, 13) by them. Two vowels of similar mouths are so told apart as well as any others.
    `progress` is called once an iteration.
    """
    mean, scale = taught.cepstra.mean(axis=0), taught.cepstra.std(axis=0)
    inputs = (taught.cepstra - mean) / scale
    targets = np.delete(np.eye(len(shapes)), CLOSED, axis=1)[taught.shape]
    vowels = targets.shape[1]
    weights = [
        rng.normal(0, ORDER**-0.5, (ORDER, HIDDEN)),
        np.zeros(HIDDEN),
        rng.normal(0, HIDDEN**-0.5, (HIDDEN, vowels)),
        np.zeros(vowels),
    ]
    step = _Adam(weights)
    for number, chosen in enumerate(_batches(taught.shape, iterations, rng)):
        gradients = _gradients(weights, inputs[chosen], targets[chosen])
        step(gradients, _RATE * 0.5 * (1 + np.cos(np.pi * number / iterations)))
        progress()
    hidden, hidden_bias, output, output_bias = weights
    mix = np.delete(shapes, CLOSED, axis=0) - shapes[CLOSED]
    return Network(
        mean, scale, hidden, hidden_bias, output @ mix, output_bias @ mix + shapes[CLOSED], shapes
    )


def _batches(
    shape: NDArray[np.intp], iterations: int, rng: np.random.Generator
) -> Iterator[NDArray[np.intp]]:
    members = [np.flatnonzero(shape == kind) for kind in np.unique(shape)]
    for _ in range(iterations):
        kinds = rng.integers(0, len(members), _BATCH)
        picks = rng.random(_BATCH)
        yield np.array(
            [members[k][int(p * len(members[k]))] for k, p in zip(kinds, picks, strict=True)]
        )


def _gradients(weights: list[_Floats], inputs: _Floats, targets: _Floats) -> list[_Floats]:
    hidden_weights, hidden_bias, output_weights, output_bias = weights
    hidden = sigmoid(inputs @ hidden_weights + hidden_bias)
    error = (hidden @ output_weights + output_bias - targets) / len(inputs)
    error += error.sum(axis=1, keepdims=True)  # the closed mouth's weight is what is left of 1
    back = (error @ output_weights.T) * hidden * (1 - hidden)
    return [
        inputs.T @ back + _DECAY * hidden_weights,
        back.sum(axis=0),
        hidden.T @ error + _DECAY * output_weights,
        error.sum(axis=0),
    ]


class _Adam:
    def __init__(self, weights: list[_Floats]) -> None:
        self._weights = weights
        self._mean = [np.zeros_like(weight) for weight in weights]
        self._square = [np.zeros_like(weight) for weight in weights]
        self._count = 0

    def __call__(self, gradients: list[_Floats], rate: float) -> None:
        self._count += 1
        for weight, mean, square, gradient in zip(
            self._weights, self._mean, self._square, gradients, strict=True
        ):
            mean += 0.1 * (gradient - mean)
            square += 0.001 * (gradient**2 - square)
            sized = mean / (1 - 0.9**self._count)
            weight -= rate * sized / (np.sqrt(square / (1 - 0.999**self._count)) + 1e-8)
