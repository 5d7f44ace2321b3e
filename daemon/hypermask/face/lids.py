"""Lids that close over the eyeballs, and when they do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.face import points
from hypermask.face.mesh import RIM, Mesh, influence

Array = NDArray[np.float64]

_LOWER_SHARE = 0.12
"""The lower lid comes up by this share of the gap, the upper lid down by the rest."""
_FOLLOW = ((247, 30, 29, 27, 28, 56, 190), (113, 225, 224, 223, 222, 221, 189))
"""The two rows of skin above the left upper lid, a vertex for each of the lid's."""
_FOLLOW_SHARES = (
    (0.60, 0.90, 0.95, 0.95, 0.95, 0.90, 0.60),
    (0.15, 0.50, 0.68, 0.76, 0.73, 0.52, 0.15),
)
"""The lid is a stiff plate: the row next to its edge goes with it, or the line that is painted
along the edge would be drawn out into a band when it shuts."""
_BLINK_S = 0.26
_BLINK_PERIOD_S = 3.7


@dataclass(frozen=True)
class Lids:
    """upper, lower: (14,) vertices of both eyes in pairs; carrier: (V, 28) upper then lower."""

    upper: NDArray[np.int32]
    lower: NDArray[np.int32]
    carrier: Array


def make_lids(mesh: Mesh) -> Lids:
    upper = [*points.LEFT_LID_UPPER[1:-1], *points.RIGHT_LID_UPPER[1:-1]]
    lower = [*points.LEFT_LID_LOWER[1:-1], *points.RIGHT_LID_LOWER[1:-1]]
    still = {*points.LEFT_BROW, *points.RIGHT_BROW, *points.NOSE, *points.OVAL}
    still |= {*points.LIPS_OUTER, *points.LIPS_INNER, 33, 133, 362, 263}
    still |= {points.FEATURES["cheek_left"], points.FEATURES["cheek_right"]}
    still |= {*RIM, *mesh.among([*points.LEFT_BROW, *points.RIGHT_BROW])}
    moved = [*upper, *lower]
    rows, weights = _following(mesh)
    led = [*moved, *rows]
    carried = influence(mesh, led, sorted(still - set(led)))
    carrier = carried[:, : len(moved)] + carried[:, len(moved) :] @ weights
    return Lids(np.array(upper, np.int32), np.array(lower, np.int32), carrier)


def _following(mesh: Mesh) -> tuple[list[int], Array]:
    """Vertices above both upper lids and (n, 28) what each takes of the lids' movements."""
    left = [vertex for row in _FOLLOW for vertex in row]
    rows = [*left, *mesh.mirror[left].tolist()]
    shares = np.concatenate([np.diag(row) for row in _FOLLOW_SHARES])
    weights = np.zeros((len(rows), 28))
    weights[: len(left), :7] = shares
    weights[len(left) :, 7:14] = shares[:, ::-1]  # the right lid's vertices go the other way round
    return rows, weights


def close_lids(lids: Lids, flat: Array, closed: Array) -> None:
    """Close the lids in place: flat (V, 2) metres, closed (14,) 0 open to 1 shut per pair.

    Lids that have come to cross by their expression are brought together as well.
    """
    gap = flat[lids.lower] - flat[lids.upper]
    share = np.where(gap[:, 1] > 0, 1.0, closed)[:, None]
    move = np.concatenate([gap * share * (1 - _LOWER_SHARE), -gap * share * _LOWER_SHARE])
    flat += lids.carrier @ move


def blink(time_s: float) -> float:
    """How far the lids are shut, 0 to 1, at this time: a pure function, about 16 blinks a minute.

    Each period of 3.7 s holds one blink at a place of its own; it shuts faster than it opens.
    """
    number = int(np.floor(time_s / _BLINK_PERIOD_S))
    start = number * _BLINK_PERIOD_S + spread(number) * (_BLINK_PERIOD_S - 2 * _BLINK_S)
    phase = (time_s - start) / _BLINK_S
    if not 0 < phase < 1:
        return 0.0
    rise, hold = 0.3, 0.42
    level = phase / rise if phase < rise else 1.0 if phase < hold else (1 - phase) / (1 - hold)
    return float(level * level * (3 - 2 * level))


def spread(number: int) -> float:
    """A number in 0 to 1 that looks random and is always the same (golden-ratio sequence)."""
    return (number * 0.6180339887498949 + 0.37) % 1.0
