"""The six reference mouth shapes, and every other shape as an interpolation of them.

Yotsukura et al. 2001 (HYPERMASK): five vowels and the closed mouth, 13 parameters each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hypermask.face.mouth import MOUTH_SHAPES

SHAPE_NAMES = ("closed", "a", "i", "u", "e", "o")
CLOSED = 0

_Floats = NDArray[np.float64]


def reference_shapes() -> _Floats:
    """The face's own reference shapes (6, 13), in the order of `SHAPE_NAMES`."""
    return np.array([MOUTH_SHAPES[name] for name in SHAPE_NAMES], np.float64)


def spread(shapes: _Floats) -> _Floats:
    """How far each parameter ranges over the shapes (13,); never 0, so that it can divide."""
    deviation = shapes.std(axis=0)
    return np.asarray(np.maximum(deviation, 1e-3 * max(float(deviation.max()), 1e-9)))


class Interpolation:
    """Mouth parameters to the weights of the six shapes whose interpolation comes nearest.

    Parameters count by their spread over the shapes, so that small ones are heard too. Because
    the weights outlive any change of the shapes, a network trained with one set of shapes can
    drive a face that has another.
    """

    def __init__(self, shapes: _Floats) -> None:
        """shapes: (6, 13) in the order of `SHAPE_NAMES`."""
        self._closed = shapes[CLOSED]
        self._scale = spread(shapes)
        vowels = (np.delete(shapes, CLOSED, axis=0) - self._closed) / self._scale
        self._unmix = np.linalg.pinv(vowels, rcond=1e-3)

    def linear(self, parameters: _Floats) -> _Floats:
        """(n, 13) -> (n, 6), summing to 1, negative outside the shapes' hull."""
        vowels = ((parameters - self._closed) / self._scale) @ self._unmix
        closed = 1.0 - vowels.sum(axis=-1, keepdims=True)
        return np.concatenate([closed, vowels], axis=-1)

    def weights(self, parameters: _Floats) -> _Floats:
        """The same, kept within the hull: none negative, summing to 1."""
        positive = np.maximum(self.linear(parameters), 0.0)
        return np.asarray(positive / positive.sum(axis=-1, keepdims=True))


def nearest_shape(parameters: _Floats, shapes: _Floats) -> NDArray[np.intp]:
    """Index of the reference shape nearest to each mouth: (n, 13) -> (n,).

    Nearest among six that count as equally far from each other, so that similar ones compete on
    equal terms: the one with the largest weight.
    """
    weights = Interpolation(shapes).linear(parameters)
    return np.asarray(np.argmax(weights, axis=1))
