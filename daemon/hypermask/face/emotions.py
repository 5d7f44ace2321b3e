"""Six emotions (PAPERS A4): displacements of feature points and of the mouth's parameters.

The action units are those of EMFACS: happiness 6+12; sadness 1+4+15; surprise 1+2+5+26;
fear 1+2+4+5+7+20+26; anger 4+5+7+23; disgust 9+15+16.
Millimetres on the mask: outwards (away from the middle) and upwards; both sides alike.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.errors import UsageError
from hypermask.face import points
from hypermask.face.mesh import LANDMARKS, Mesh, influence

Array = NDArray[np.float64]

EMOTIONS = ("anger", "happiness", "sadness", "disgust", "surprise", "fear")

Moves = dict[str, tuple[float, float]]

_STAGE = 1.25
"""What is read from the stalls is larger than life."""

UPPER_FACE: dict[str, Moves] = {
    "anger": {
        "brow_inner": (-3.5, -9.0),
        "brow_inner_low": (-3.0, -8.5),
        "brow_middle": (-2.0, -5.0),
        "brow_outer": (0.5, 2.5),
        "lid_upper_inner": (0.0, -1.6),
        "lid_upper": (0.0, -0.4),
        "lid_upper_outer": (0.0, 0.8),
        "lid_lower": (0.0, 1.6),
        "lid_lower_outer": (0.0, 1.4),
        "lid_lower_inner": (0.0, 0.6),
        "nose_wing": (1.8, 1.2),
        "cheek": (0.0, 0.8),
        "nose_root": (0.0, -2.5),
    },
    "happiness": {
        "brow_middle": (0.0, 1.0),
        "brow_outer": (0.0, 0.8),
        "lid_lower_inner": (0.0, 1.2),
        "lid_lower": (0.0, 2.4),
        "lid_lower_outer": (0.0, 2.0),
        "lid_upper": (0.0, -0.6),
        "lid_upper_outer": (0.0, -0.8),
        "cheek": (2.5, 5.5),
        "fold": (3.5, 4.0),
        "nose_wing": (1.2, 0.8),
    },
    "sadness": {
        "brow_inner": (-2.5, 7.5),
        "brow_inner_low": (-2.5, 7.0),
        "brow_middle": (-1.0, 1.0),
        "brow_outer": (0.5, -4.0),
        "lid_upper_inner": (0.0, 0.8),
        "lid_upper": (0.0, -1.4),
        "lid_upper_outer": (0.0, -2.0),
        "lid_lower": (0.0, 0.4),
        "cheek": (-0.5, -1.0),
        "fold": (-0.5, -1.5),
        "nose_root": (0.0, 0.8),
    },
    "disgust": {
        "brow_inner": (-2.2, -5.5),
        "brow_inner_low": (-2.0, -5.5),
        "brow_middle": (-1.0, -4.0),
        "brow_outer": (0.0, -1.5),
        "lid_upper_inner": (0.0, -1.6),
        "lid_upper": (0.0, -1.8),
        "lid_upper_outer": (0.0, -1.2),
        "lid_lower_inner": (0.0, 1.2),
        "lid_lower": (0.0, 2.0),
        "lid_lower_outer": (0.0, 1.4),
        "cheek": (0.5, 4.0),
        "fold": (1.8, 3.5),
        "nose_wing": (2.0, 4.0),
        "nose_side": (0.8, 3.0),
        "nose_tip": (0.0, 1.6),
        "nose_root": (0.0, -1.5),
    },
    "surprise": {
        "brow_inner": (0.0, 9.0),
        "brow_inner_low": (0.0, 8.5),
        "brow_middle": (0.5, 11.0),
        "brow_outer": (0.5, 9.0),
        "lid_upper_inner": (0.0, 2.6),
        "lid_upper": (0.0, 3.6),
        "lid_upper_outer": (0.0, 2.8),
        "lid_lower": (0.0, -0.9),
        "lid_lower_outer": (0.0, -0.6),
        "cheek": (-0.8, -1.8),
        "fold": (-1.5, -3.0),
        "nose_root": (0.0, 1.0),
    },
    "fear": {
        "brow_inner": (-3.2, 10.0),
        "brow_inner_low": (-3.2, 9.5),
        "brow_middle": (-1.5, 6.5),
        "brow_outer": (0.0, 1.5),
        "lid_upper_inner": (0.0, 2.8),
        "lid_upper": (0.0, 3.2),
        "lid_upper_outer": (0.0, 1.6),
        "lid_lower_inner": (0.0, 0.4),
        "lid_lower": (0.0, 0.6),
        "lid_lower_outer": (0.0, 0.4),
        "cheek": (1.0, -0.5),
        "fold": (2.0, -1.0),
        "nose_root": (0.0, 1.0),
    },
}

MOUTH: dict[str, Array] = {
    # 13 parameters in `hypermask.face.mouth` order: what the emotion does to the closed mouth.
    "anger": np.array([-0.12, 0.0, -0.02, 0.0, 0.02, 0.0, 0.12, 0.0, 0.04, -0.13, -0.08, 0.0, 0.0]),
    "happiness": np.array(
        [0.04, 0.0, 0.10, 0.0, -0.16, 0.0, -0.10, 0.0, -0.08, 0.30, 0.24, -0.1, 0.30]
    ),
    "sadness": np.array([0.03, 0.0, 0.02, 0.0, 0.03, 0.1, 0.07, 0.1, 0.05, -0.30, -0.04, 0.0, 0.0]),
    "disgust": np.array(
        [0.24, 0.1, 0.20, 0.0, -0.02, 0.1, -0.12, 0.2, 0.02, -0.18, -0.04, 0.0, 0.10]
    ),
    "surprise": np.array(
        [0.08, 0.0, 0.12, 0.0, -0.66, 0.0, -0.62, 0.0, -0.60, -0.06, -0.18, 0.0, 0.18]
    ),
    "fear": np.array(
        [0.03, 0.0, 0.10, 0.0, -0.34, 0.0, -0.24, 0.0, -0.24, -0.16, 0.20, -0.1, 0.36]
    ),
}


def emotion_weights(expression: Mapping[str, float] | ArrayLike | None) -> Array:
    """(6,) weights in `EMOTIONS` order, each held within 0 to 1.

    Raises `UsageError` FACE-EMOTION for an unknown name or another shape.
    """
    if expression is None:
        return np.zeros(len(EMOTIONS))
    if isinstance(expression, Mapping):
        unknown = sorted(set(expression) - set(EMOTIONS))
        if unknown:
            raise _wrong(f"there is no emotion '{unknown[0]}'")
        values = np.array([float(expression.get(name, 0.0)) for name in EMOTIONS])
    else:
        values = np.asarray(expression, float)
    if values.shape != (len(EMOTIONS),) or not np.isfinite(values).all():
        raise _wrong("an expression is not six finite weights")
    return np.asarray(np.clip(values, 0, 1))


def _wrong(what: str) -> UsageError:
    return UsageError("FACE-EMOTION", what, f"Known: {', '.join(EMOTIONS)}.")


def emotion_fields(mesh: Mesh) -> Array:
    """(6, V, 3) metres of displacement outside the mouth for each emotion at weight 1."""
    moved = sorted(points.FEATURES.values())
    place = {vertex: k for k, vertex in enumerate(moved)}
    still = {*points.LIPS_OUTER, *points.LIPS_INNER, *points.JAW, *range(LANDMARKS, mesh.count)}
    still |= {*points.OVAL}
    carried = influence(mesh, moved, sorted(still - set(moved)))
    fields = np.zeros((len(EMOTIONS), mesh.count, 3))
    for number, emotion in enumerate(EMOTIONS):
        given = np.zeros((len(moved), 3))
        for feature, (outwards, up) in UPPER_FACE[emotion].items():
            for name, side in (
                (feature, 0.0),
                (f"{feature}_left", -1.0),
                (f"{feature}_right", 1.0),
            ):
                if name in points.FEATURES:
                    given[place[points.FEATURES[name]]] = (outwards * side, up, 0)
        fields[number] = carried @ given * _STAGE / 1000
    return fields


def emotion_mouths() -> Array:
    """(6, 13) what each emotion adds to the mouth's parameters at weight 1."""
    return np.array([MOUTH[name] for name in EMOTIONS])
