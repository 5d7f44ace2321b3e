"""The mouth: 13 parameters on 7 control points (PAPERS A5), six reference shapes, their fields.

Unit: the half width of the closed mouth. Every value is an offset from the closed mouth; vertical
is positive upwards, horizontal outwards (both corners), depth towards the audience. Control point i
moves alone with its own parameters; between the control points the lips follow smooth profiles.

| index | control point          | what                                  |
|-------|------------------------|---------------------------------------|
| 0, 1  | upper lip, upper edge  | vertical, depth                       |
| 2, 3  | upper lip, lower edge  | vertical, depth                       |
| 4, 5  | lower lip, upper edge  | vertical, depth                       |
| 6, 7  | lower lip, lower edge  | vertical, depth                       |
| 8     | jaw                    | vertical                              |
| 9-11  | mouth corner           | vertical, horizontal, depth           |
| 12    | lips                   | horizontal opening: how far out to the corners they part |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.errors import UsageError
from hypermask.face import points
from hypermask.face.mesh import RIM, Mesh, influence

Array = NDArray[np.float64]

MOUTH_PARAMETERS = (
    "upper_lip_upper_vertical",
    "upper_lip_upper_depth",
    "upper_lip_lower_vertical",
    "upper_lip_lower_depth",
    "lower_lip_upper_vertical",
    "lower_lip_upper_depth",
    "lower_lip_lower_vertical",
    "lower_lip_lower_depth",
    "jaw_vertical",
    "corner_vertical",
    "corner_horizontal",
    "corner_depth",
    "lips_horizontal",
)
CONTROL_POINTS = {
    "upper_lip_upper": points.UPPER_LIP_OUTER[5],
    "upper_lip_lower": points.UPPER_LIP_INNER[5],
    "lower_lip_upper": points.LOWER_LIP_INNER[5],
    "lower_lip_lower": points.LOWER_LIP_OUTER[5],
    "jaw": points.JAW[7],
    "corner_left": points.UPPER_LIP_OUTER[0],
    "corner_right": points.UPPER_LIP_OUTER[-1],
}

MOUTH_SHAPES: dict[str, Array] = {
    "closed": np.zeros(13),
    "a": np.array([0.08, 0.0, 0.18, 0.0, -0.96, 0.0, -0.86, 0.02, -0.72, -0.14, -0.10, 0.0, 0.50]),
    "i": np.array(
        [0.07, -0.04, 0.12, -0.04, -0.24, -0.04, -0.20, -0.04, -0.10, 0.06, 0.18, -0.06, 0.38]
    ),
    "u": np.array(
        [0.02, 0.34, -0.02, 0.36, -0.22, 0.36, -0.20, 0.34, -0.16, -0.02, -0.40, 0.16, 0.02]
    ),
    "e": np.array(
        [0.07, -0.02, 0.14, -0.02, -0.44, -0.02, -0.38, -0.02, -0.28, 0.0, 0.10, -0.04, 0.42]
    ),
    "o": np.array(
        [0.06, 0.24, 0.06, 0.26, -0.58, 0.26, -0.52, 0.24, -0.42, -0.08, -0.34, 0.12, 0.16]
    ),
}
"""Reference shapes: the vowels of the five, and the closed mouth."""

_FULLNESS = 0.16
"""A lip brought forward looks fuller: its edge moves outwards by this share of the depth."""
_OPENING = [4, 6, 8]
_LEAST_THICKNESS = 0.35
_PROFILE = 0.75
ROW_SHARES = (0.4, 0.75)
"""Where the two rows inside a lip lie between its outer and its inner outline."""
ROUND_JAW = (0.15, 0.42, 0.66, 0.84, 0.94, 0.98, 1.0, 1.0, 1.0, 0.98, 0.94, 0.84, 0.66, 0.42, 0.15)


def half_width(mesh: Mesh) -> float:
    """Metres: the unit of the parameters."""
    left, right = CONTROL_POINTS["corner_left"], CONTROL_POINTS["corner_right"]
    return float(mesh.rest[right, 0] - mesh.rest[left, 0]) / 2


def check_mouth(mouth: ArrayLike) -> Array:
    """(13,) finite numbers, held within [-1.5, 1.5]. Raises `UsageError` FACE-MOUTH."""
    values = np.asarray(mouth, float)
    if values.shape != (13,) or not np.isfinite(values).all():
        raise UsageError(
            "FACE-MOUTH", "a mouth is not 13 finite numbers", "Give all 13 parameters."
        )
    return np.asarray(np.clip(values, -1.5, 1.5))


def mouth_fields(mesh: Mesh) -> Array:
    """(13, V, 3) metres of displacement for each parameter at 1."""
    moved = sorted({*points.LIPS_OUTER, *points.LIPS_INNER, *points.JAW})
    given = _given(mesh, moved) * half_width(mesh)
    rows = [vertex for column in points.LIP_COLUMNS for vertex in column[1:3]]
    carried = influence(mesh, [*moved, *rows], _still(mesh, [*moved, *rows]))
    carried = carried[:, : len(moved)] + carried[:, len(moved) :] @ _between(moved, rows)
    return np.asarray(np.einsum("vm,pmd->pvd", carried, given))


def _between(moved: list[int], rows: list[int]) -> Array:
    """(len(rows), len(moved)): the rows inside a lip follow its outer and its inner outline."""
    weights = np.zeros((len(rows), len(moved)))
    for outer, upper, lower, inner in points.LIP_COLUMNS:
        for vertex, share in ((upper, ROW_SHARES[0]), (lower, ROW_SHARES[1])):
            weights[rows.index(vertex), moved.index(outer)] = 1 - share
            weights[rows.index(vertex), moved.index(inner)] = share
    return weights


def _still(mesh: Mesh, moved: Sequence[int]) -> list[int]:
    """What the mouth does not move: eyes, brows, nose, the sides above the jaw, the rim."""
    still = {*points.LEFT_EYE, *points.RIGHT_EYE, *points.LEFT_BROW, *points.RIGHT_BROW}
    still |= {
        *points.NOSE,
        *points.OVAL,
        *RIM,
        *mesh.among([*points.LEFT_BROW, *points.RIGHT_BROW]),
    }
    return sorted(still - set(moved))


def _given(mesh: Mesh, moved: list[int]) -> Array:
    """(13, len(moved), 3): displacement of lips and jaw for each parameter, in half widths."""
    place = {vertex: k for k, vertex in enumerate(moved)}
    given = np.zeros((13, len(moved), 3))
    lines = (
        (points.UPPER_LIP_OUTER, 0, 1.0),
        (points.UPPER_LIP_INNER, 2, -0.5),
        (points.LOWER_LIP_INNER, 4, 0.5),
        (points.LOWER_LIP_OUTER, 6, -1.0),
    )
    for line, first, outwards in lines:
        rows = [place[vertex] for vertex in line]
        s = mesh.rest[list(line), 0] / half_width(mesh)
        centre, corner = _profiles(mesh, line)
        given[first, rows, 1] = centre
        given[first + 1, rows, 1] = centre * outwards * _FULLNESS
        given[first + 1, rows, 2] = centre
        given[9, rows, 1] = corner
        given[10, rows, 0] = s
        given[11, rows, 2] = corner
    given[12] += _wide_opening(mesh, moved)
    for vertex, share in zip(points.JAW, ROUND_JAW, strict=True):
        given[8, place[vertex], 1] = share
    return given


def _profiles(mesh: Mesh, line: tuple[int, ...]) -> tuple[Array, Array]:
    """Shares of the middle and of the corner along an outline.

    The middle's share ends at the outline's own corners. The corner's is the same function of x
    for all outlines, so that a smile shears the lips and does not make them thinner.
    """
    x = mesh.rest[list(line), 0]
    centre = np.maximum(1 - (x / np.abs(x).max()) ** 2, 0) ** _PROFILE
    return np.asarray(centre), np.asarray((x / half_width(mesh)) ** 2)


def _wide_opening(mesh: Mesh, moved: list[int]) -> Array:
    """(len(moved), 3): the lips part further out: flanks apart, middle and corners unmoved."""
    field = np.zeros((len(moved), 3))
    place = {vertex: k for k, vertex in enumerate(moved)}
    for line, up in ((points.UPPER_LIP_INNER, 1.0), (points.LOWER_LIP_INNER, -1.0)):
        x = mesh.rest[list(line), 0]
        s = np.abs(x) / np.abs(x).max()
        field[[place[vertex] for vertex in line], 1] = up * 0.3 * s**2 * (1 - s**4)
    return field


@dataclass(frozen=True)
class Lips:
    """Keeps lips from crossing and from being turned inside out.

    inner, outer: (18,) vertices, nine of the upper lip, then nine of the lower one, left to right;
    thickness: (18,) metres, the least a lip may have; carrier: (V, 36) inner, then outer.
    """

    inner: NDArray[np.int32]
    outer: NDArray[np.int32]
    thickness: Array
    carrier: Array


def make_lips(mesh: Mesh) -> Lips:
    inner = [*points.UPPER_LIP_INNER[1:-1], *points.LOWER_LIP_INNER[1:-1]]
    outer = [*points.UPPER_LIP_OUTER[1:-1], *points.LOWER_LIP_OUTER[1:-1]]
    moved = [*inner, *outer]
    rows = [vertex for column in points.LIP_COLUMNS for vertex in column[1:3]]
    corners = {column[k] for column in points.LIP_COLUMNS[0:11:10] for k in (0, 3)}
    still = {*_still(mesh, moved), *points.JAW, *corners} - set(rows)
    given = [*moved, *sorted(corners)]
    carrier = influence(mesh, [*given, *rows], sorted(still - set(given)))
    carrier = carrier[:, : len(given)] + carrier[:, len(given) :] @ _between(given, rows)
    rest = np.abs(mesh.rest[outer, 1] - mesh.rest[inner, 1])
    return Lips(
        np.array(inner, np.int32),
        np.array(outer, np.int32),
        _LEAST_THICKNESS * rest,
        carrier[:, : len(moved)],
    )


def part_lips(lips: Lips, flat: Array) -> None:
    """In place, flat (V, 2) metres: lips that would cross meet in the middle; none turns over."""
    half = len(lips.inner) // 2
    way = np.repeat([1.0, -1.0], half)
    inner, outer = flat[lips.inner, 1], flat[lips.outer, 1]
    overlap = np.maximum(inner[half:] - inner[:half], 0) / 2
    lift = way * np.tile(overlap, 2)
    missing = np.maximum(lips.thickness - way * (outer - inner - lift), 0)
    flat[:, 1] += lips.carrier @ np.concatenate([lift, way * missing])


def spoken(mouth: Array) -> float:
    """0 to 1: how far speech has opened the mouth (13,), so that what else opens it gives way."""
    return min(1.0, max(0.0, -float(min(mouth[k] for k in _OPENING)) / 0.8))
