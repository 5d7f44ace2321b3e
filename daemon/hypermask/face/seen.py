"""The face seen from outside: what units and mouth parameters do in pictures of it, against FACS.

    python -m hypermask.face.seen [CHARACTER]

prints the tables. What is measured knows nothing of the mesh. A picture of the mask goes to the
landmark network, which was trained on photographs. What that cannot see, depth and what moves by
less than its noise, and how purely each mouth parameter moves its own control point, is measured by
dots painted on the skin (`hypermask.face.markers`).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.face.action_units import NUMBERS, load_action_units
from hypermask.face.character import find_character, load_character
from hypermask.face.emotions import EMOTIONS
from hypermask.face.face import Face, Positions, deform, load_rig
from hypermask.face.features import MIDDLE, PAIRS
from hypermask.face.markers import Markers
from hypermask.face.mouth import CONTROL_POINTS, MOUTH_PARAMETERS, MOUTH_SHAPES
from hypermask.face.mouth_seen import AXES, MOUTH_FULL, MOUTH_START, OWN, mouth_marked
from hypermask.face.sheet import front_view
from hypermask.mask import load_mask
from hypermask.texture.landmarks import FaceFinder

Array = NDArray[np.float64]

PIXELS_PER_MM = 1.8
_SCALES = (1.5, 1.65, 1.8, 1.95, 2.1)

EXPECTED: dict[int, Mapping[str, str]] = {
    # What the manual says a unit does to a point: up, down, out (away from the middle), in.
    1: {"brow_inner": "up"},
    2: {"brow_outer": "up", "brow_middle": "up"},
    4: {"brow_inner": "down", "brow_middle": "down"},
    6: {"lid_lower": "up", "cheek": "up"},
    7: {"lid_upper": "down"},
    8: {"lower_lip_bottom": "up"},
    9: {"nose_wing": "up", "brow_inner": "down", "upper_lip_top": "up"},
    10: {"upper_lip_top": "up", "upper_lip_top_flank": "up", "nose_wing": "up"},
    11: {"upper_lip_top_flank": "up"},
    12: {"lip_corner": "up out", "cheek": "up"},
    13: {"lip_corner": "up", "cheek": "up"},
    14: {"lip_corner": "out"},
    15: {"lip_corner": "down"},
    16: {"lower_lip_bottom": "down", "lower_lip_bottom_flank": "down"},
    17: {"lower_lip_bottom": "up", "lower_lip_top": "up"},
    18: {"lip_corner": "in", "upper_lip_top_flank": "in"},
    19: {"lower_lip_bottom": "down"},
    20: {"lip_corner": "out", "lower_lip_top_flank": "out"},
    21: {"lip_corner": "down"},
    22: {"lip_corner": "in", "upper_lip_top": "up", "lower_lip_bottom": "down"},
    23: {"lip_corner": "in", "upper_lip_top": "down", "lower_lip_bottom": "up"},
    24: {"upper_lip_top": "down", "lower_lip_bottom": "up"},
    25: {"lower_lip_top": "down", "lower_lip_bottom": "down"},
    26: {"chin": "down", "lower_lip_bottom": "down"},
    27: {"chin": "down", "lower_lip_bottom": "down"},
    28: {"upper_lip_top": "down", "lower_lip_bottom": "up"},
    30: {"chin": "left", "lower_lip_bottom": "left"},
    32: {"lower_lip_bottom": "up", "upper_lip_bottom": "up"},
    33: {"lip_corner": "in"},
    35: {"lip_corner": "in"},
    36: {"lower_lip_bottom": "down"},
    37: {"lower_lip_bottom": "down"},
    38: {"nose_wing": "out"},
    41: {"lid_upper": "down"},
    42: {"lid_upper": "down"},
    43: {"lid_upper": "down"},
    44: {"lid_upper": "down", "lid_lower": "up", "brow_inner": "down"},
    45: {"lid_upper": "down"},
    46: {"lid_upper": "down"},
}
UNSEEN: dict[int, tuple[str, Mapping[str, str]]] = {
    5: ("the network's lids hardly follow eyes that are opened wider", {"lid_upper": "up"}),
    29: ("the jaw comes forward, towards the viewer", {"chin": "forward"}),
    31: ("a bulge at the jaw's corner, which has no landmark", {"cheek": "out", "chin": "up"}),
    34: ("cheeks puffed towards the viewer", {"cheek": "out forward", "fold": "forward"}),
    39: ("the network's nostrils follow by 0.3 mm only, which is its noise", {"nose_wing": "in"}),
}
"""Units whose main movement the landmarks cannot show from the front: why, and what it is."""

_WAYS = {
    "up": (1, 1.0),
    "down": (1, -1.0),
    "out": (0, 1.0),
    "in": (0, -1.0),
    "left": (2, 1.0),
    "forward": (3, 1.0),
}


class Viewer:
    """Draws a character and finds its landmarks."""

    def __init__(self, character: str = "mean") -> None:
        mask = load_mask(paths.configs() / "masks" / "reference")
        self.face = Face(load_character(find_character(character)), mask)
        self._finder = FaceFinder()
        self.neutral = self.landmarks()
        self.markers = Markers(self.face)

    def landmarks(self, scales: Sequence[float] = (PIXELS_PER_MM,), **asked: Any) -> Array:
        """(468, 2) mm on the mask as the network finds them; asked: as of `Face.positions`.

        scales: pixels for a millimetre; the mean over pictures of several sizes has less noise.
        """
        places = self.face.positions(**asked)
        return np.asarray(np.mean([self._found(places, scale) for scale in scales], axis=0))

    def _found(self, places: tuple[Positions, ...], scale: float) -> Array:
        picture = front_view(self.face, places, scale, eye_holes=False)
        found = self._finder.find(np.ascontiguousarray(picture[..., ::-1])).points[:, :2]
        middle = (np.array(picture.shape[1::-1]) - 1) / 2
        return np.asarray((found - middle) * (1, -1) / scale)

    def change(self, **asked: Any) -> Array:
        """(468, 2) mm: the landmarks' movement from the neutral face."""
        return self.landmarks(**asked) - self.neutral


def along(change: Mapping[int, Array] | Array, point: str, way: str) -> float:
    """mm that a feature point has moved in a direction, the mean of both sides.

    change: by vertex, (2,) or (3,) mm to the right, up and forward.
    """
    if point in MIDDLE:
        middle = change[MIDDLE[point]]
        out = np.array([0.0, middle[1], middle[0], *middle[2:]])
    else:
        left, right = (change[vertex] for vertex in PAIRS[point])
        out = np.array([right[0] - left[0], right[1] + left[1], right[0] + left[0]]) / 2
        out = np.array([*out, *(right[2:] + left[2:]) / 2])
    axis, sign = _WAYS[way]
    return float(out[axis] * sign)


def units_seen(viewer: Viewer) -> Iterator[tuple[int, str, str, float, float]]:
    """(unit, point, way, mm seen, mm in the mesh) of every expected movement at intensity 1.

    "left" is the face's own, the audience's right.
    """
    rig = load_rig()
    for number, points in EXPECTED.items():
        seen = viewer.change(units={str(number): 1.0})
        made = (deform(rig, units={str(number): 1.0})[0] - rig.mesh.rest) * 1000
        for point, ways in points.items():
            for way in ways.split():
                yield number, point, way, along(seen, point, way), along(made, point, way)


def unit_marked(markers: Markers, number: int) -> Iterator[tuple[int, str, str, float]]:
    """(unit, point, way, mm by dots) of a unit's movements at intensity 1, for any of the 44."""
    points = EXPECTED[number] if number in EXPECTED else UNSEEN[number][1]
    vertices = [vertex for point in points for vertex in _vertices(point)]
    moved = markers.find(vertices, units={str(number): 1.0}) - markers.find(vertices)
    change = dict(zip(vertices, moved, strict=True))
    for point, ways in points.items():
        for way in ways.split():
            yield number, point, way, along(change, point, way)


def _vertices(point: str) -> tuple[int, ...]:
    return (MIDDLE[point],) if point in MIDDLE else PAIRS[point]


def mouth_seen(viewer: Viewer, index: int, shares: Sequence[float]) -> dict[str, Array]:
    """Control point -> (n, 2) mm by landmarks, for shares of `MOUTH_FULL`, from `MOUTH_START`."""
    full = np.eye(13)[index] * MOUTH_FULL[index]
    found = [viewer.landmarks(_SCALES, mouth=MOUTH_START + full * share) for share in shares]
    return {
        name: np.array([points[vertex] for points in found])
        for name, vertex in CONTROL_POINTS.items()
    }


def emotions_seen(viewer: Viewer, weight: float = 1.0) -> Array:
    """(6, 936) mm: the landmarks' movement for each emotion."""
    return np.array([viewer.change(expression={e: weight}).ravel() for e in EMOTIONS])


def likeness(a: Array, b: Array) -> Array:
    """Cosines between rows."""
    a = a / np.linalg.norm(a, axis=1, keepdims=True)
    b = b / np.linalg.norm(b, axis=1, keepdims=True)
    return np.asarray(a @ b.T)


def deform_times(count: int = 2000) -> Array:
    """(count,) ms of `deform` with all 88 halves and 13 mouth parameters at once."""
    rig, random = load_rig(), np.random.default_rng(1)
    shapes = np.array(list(MOUTH_SHAPES.values()))
    times = []
    for _ in range(count):
        units, mouth = random.random(88) * 0.4, random.dirichlet(np.ones(6)) @ shapes
        start = time.perf_counter()
        deform(rig, None, mouth, 0.2, units)
        times.append((time.perf_counter() - start) * 1000)
    return np.array(times)


def main() -> None:
    times = deform_times()
    print(f"deform: p50 {np.median(times):.3f} ms, p95 {np.percentile(times, 95):.3f} ms")
    viewer = Viewer(*sys.argv[1:])
    _print_units(viewer)
    _print_mouth(viewer)
    print("\nemotions: cosines of the landmarks' movement")
    full = emotions_seen(viewer)
    for name, line in zip(EMOTIONS, likeness(emotions_seen(viewer, 0.6), full), strict=True):
        print(f"{name + ' at 0.6':18}" + "".join(f"{value:7.2f}" for value in line))


def _print_units(viewer: Viewer) -> None:
    table = load_action_units().table
    seen = {row[:3]: row[3:] for row in units_seen(viewer)}
    print(f"\n{'unit':32} {'point':22} {'way':8}landmarks   dots   mesh (mm)")
    marked_rows = (row for number in NUMBERS for row in unit_marked(viewer.markers, number))
    for number, point, way, marked in marked_rows:
        found, made = seen.get((number, point, way), (np.nan, np.nan))
        by_landmarks = "        -" if np.isnan(found) else f"{found:9.1f}"
        in_mesh = "" if np.isnan(made) else f"{made:7.1f}"
        name = f"{number:3} {table[number].name:28}"
        print(f"{name} {point:22} {way:8}{by_landmarks}{marked:7.1f}{in_mesh}")
    for number, (why, _) in UNSEEN.items():
        print(f"{number:3} {table[number].name:28} no landmarks: {why}")


def _print_mouth(viewer: Viewer) -> None:
    print("\nmouth parameter          at 1/3, 2/3 and full (mm), by dots    steady  others at most")
    for index, name in enumerate(MOUTH_PARAMETERS):
        pure = mouth_marked(viewer.markers, index)
        path = "".join(f"{value:9.2f}" for value in pure.own)
        steady = "yes" if pure.steady else "no"
        print(f"{name:26}{path}{steady:>16}{pure.other:9.2f} mm{100 * pure.leak:6.1f} %")
    print("\nthe same by landmarks from the front")
    for index, name in enumerate(MOUTH_PARAMETERS):
        if AXES[index] == 2 or not OWN[index]:
            continue
        found = np.array(list(mouth_seen(viewer, index, (0, 1 / 3, 2 / 3, 1)).values()))
        own = list(OWN[index])
        moved = found - found[:, :1]
        moved[5, :, 0] *= -1
        seen = moved[own, 1:, AXES[index]].mean(axis=0)
        other = np.linalg.norm(np.delete(moved[:, -1], own, axis=0), axis=1).max()
        steps = np.diff(seen, prepend=0) * np.sign(MOUTH_FULL[index])
        steady = "yes" if (steps > 0).all() else "no"
        line = "".join(f"{value:9.2f}" for value in seen)
        print(f"{name:26}{line}{steady:>16}{other:9.2f} mm")


if __name__ == "__main__":
    main()
