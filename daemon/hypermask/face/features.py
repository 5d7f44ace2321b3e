"""The 48 feature points that action units move, and how all other vertices follow them (PAPERS A4).

Left and right in the points' names are the audience's, as everywhere on the mask.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from hypermask.face import points
from hypermask.face.mesh import RIM, Mesh, influence, load_mesh
from hypermask.face.mouth import ROUND_JAW, ROW_SHARES

Array = NDArray[np.float64]

PAIRS = {
    "brow_inner": (107, 336),
    "brow_middle": (105, 334),
    "brow_outer": (70, 300),
    "forehead": (67, 297),
    "ear": (234, 454),
    "lid_upper_inner": (157, 384),
    "lid_upper": (159, 386),
    "lid_upper_outer": (161, 388),
    "lid_lower_inner": (154, 381),
    "lid_lower": (145, 374),
    "lid_lower_outer": (163, 390),
    "cheek": (50, 280),
    "fold": (205, 425),
    "nose_side": (198, 420),
    "nose_wing": (129, 358),
    "lip_corner": (61, 291),
    "upper_lip_top_flank": (39, 269),
    "upper_lip_bottom_flank": (81, 311),
    "lower_lip_top_flank": (178, 402),
    "lower_lip_bottom_flank": (181, 405),
}
"""Name of a point there is on both sides -> its vertex on the audience's left and right."""
MIDDLE = {
    "nose_root": 168,
    "nose_tip": 4,
    "upper_lip_top": 0,
    "upper_lip_bottom": 13,
    "lower_lip_top": 14,
    "lower_lip_bottom": 17,
    "chin_boss": 200,
    "chin": 152,
}
FEATURE_POINTS: dict[str, int] = {
    **{f"{name}_left": left for name, (left, _) in PAIRS.items()},
    **{f"{name}_right": right for name, (_, right) in PAIRS.items()},
    **MIDDLE,
}
"""Name -> vertex of the mesh, 48 of them, in the order of the carrier's columns."""
ORDER = {name: k for k, name in enumerate(FEATURE_POINTS)}

_FREE_RIM = (10, 338, 297, 332, 109, 67, 103)
"""The outline's upper edge goes with the forehead; the rest of it lies still."""

_EYE_CORNERS = {190: "lid_upper_inner_left", 414: "lid_upper_inner_right"}
_CORNER_SHARE = 0.35
"""Above the inner corners: led by the lid, or shut lids under a lowered brow would fold there."""


@functools.cache
def carrier() -> Array:
    """(V, 48): what share of each feature point's displacement every vertex takes.

    Along the lips, the lids and the brows vertices follow smooth curves through the feature
    points, along the jaw the chin; everything between takes the smoothest field over the mesh.
    """
    mesh = load_mesh()
    rows = _led(mesh)
    led = sorted(rows)
    still = {*points.OVAL, *RIM} - set(_FREE_RIM) - set(led)
    carried = influence(mesh, led, sorted(still))
    return np.asarray(carried @ np.array([rows[vertex] for vertex in led]))


def _led(mesh: Mesh) -> dict[int, Array]:
    """Vertex -> (48,) for all whose movement follows from the feature points directly."""
    rows = {vertex: np.eye(len(ORDER))[ORDER[name]] for name, vertex in FEATURE_POINTS.items()}
    rows |= _lips(mesh) | _lids(mesh) | _brows(mesh)
    for vertex, name in _EYE_CORNERS.items():
        rows[vertex] = _CORNER_SHARE * np.eye(len(ORDER))[ORDER[name]]
    for vertex, share in zip(points.JAW, ROUND_JAW, strict=True):
        rows[vertex] = share * np.eye(len(ORDER))[ORDER["chin"]]
    return rows


def _lips(mesh: Mesh) -> dict[int, Array]:
    """The outlines of both lips as functions of x alone, so that a smile shears and never folds."""
    rows: dict[int, Array] = {}
    for edge, line in (
        ("upper_lip_top", points.UPPER_LIP_OUTER),
        ("upper_lip_bottom", points.UPPER_LIP_INNER),
        ("lower_lip_top", points.LOWER_LIP_INNER),
        ("lower_lip_bottom", points.LOWER_LIP_OUTER),
    ):
        names = (f"{edge}_flank_left", edge, f"{edge}_flank_right")
        through = ("lip_corner_left", *names, "lip_corner_right")
        own = _along(mesh, line, [FEATURE_POINTS[name] for name in through], through)
        # The inner corners lie a little inside the outer ones: there both lips' curves meet.
        rows |= {v: (row + rows[v]) / 2 if v in rows else row for v, row in own.items()}
    for outer, upper, lower, inner in points.LIP_COLUMNS:
        for vertex, share in ((upper, ROW_SHARES[0]), (lower, ROW_SHARES[1])):
            rows[vertex] = (1 - share) * rows[outer] + share * rows[inner]
    return rows


def _lids(mesh: Mesh) -> dict[int, Array]:
    rows: dict[int, Array] = {}
    for lid, side, line in (
        ("upper", "left", points.LEFT_LID_UPPER),
        ("lower", "left", points.LEFT_LID_LOWER),
        ("upper", "right", points.RIGHT_LID_UPPER[::-1]),
        ("lower", "right", points.RIGHT_LID_LOWER[::-1]),
    ):
        ends = (f"lid_{lid}_outer_{side}", f"lid_{lid}_{side}", f"lid_{lid}_inner_{side}")
        knots = [line[0], *(FEATURE_POINTS[name] for name in ends), line[-1]]
        rows |= _along(mesh, line, knots, (None, *ends, None))
    return rows


def _brows(mesh: Mesh) -> dict[int, Array]:
    rows: dict[int, Array] = {}
    for side, line in (("left", points.LEFT_BROW), ("right", points.RIGHT_BROW)):
        names = tuple(f"brow_{part}_{side}" for part in ("outer", "middle", "inner"))
        whole = (*line, *mesh.among(line))
        rows |= _along(mesh, whole, [FEATURE_POINTS[name] for name in names], names)
    return rows


def _along(
    mesh: Mesh, line: tuple[int, ...], knots: list[int], names: tuple[str | None, ...]
) -> dict[int, Array]:
    """Rows of the vertices of a line: a natural cubic spline over x through named points.

    A point without a name lies still; beyond the ends of the knots the ends' own value holds.
    """
    x = mesh.rest[:, 0]
    order = np.argsort(x[knots])
    at = x[knots][order]
    weights = natural_spline(at, np.clip(x[list(line)], at[0], at[-1]))
    rows = np.zeros((len(line), len(ORDER)))
    for column, k in enumerate(order):
        name = names[k]
        if name is not None:
            rows[:, ORDER[name]] += weights[:, column]
    return dict(zip(line, rows, strict=True))


def natural_spline(knots: Array, at: Array) -> Array:
    """(len(at), len(knots)) weights of the knots' values in the natural cubic spline at `at`."""
    count = len(knots)
    h = np.diff(knots)
    system, right = np.eye(count), np.zeros((count, count))
    for k in range(1, count - 1):
        system[k, k - 1 : k + 2] = h[k - 1], 2 * (h[k - 1] + h[k]), h[k]
        right[k, k - 1 : k + 2] = np.array([1 / h[k - 1], -1 / h[k - 1] - 1 / h[k], 1 / h[k]]) * 6
    curvature = np.linalg.solve(system, right)
    part = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, count - 2)
    length = h[part]
    b = (at - knots[part]) / length
    a = 1 - b
    values = np.eye(count)
    bend = (a**3 - a)[:, None] * curvature[part] + (b**3 - b)[:, None] * curvature[part + 1]
    straight = a[:, None] * values[part] + b[:, None] * values[part + 1]
    return np.asarray(straight + bend * (length**2 / 6)[:, None])
