"""The paper's network: 20 cepstral coefficients, 20 sigmoid units, 13 mouth parameters.

Yotsukura et al. 2001 (HYPERMASK), section on voice. Plain numpy at run time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HIDDEN = 20
OUTPUTS = 13

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
