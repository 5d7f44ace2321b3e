"""The face seen from outside: the landmark models' findings on the rendered face, against FACS.

    python -m hypermask.face.seen [CHARACTER]

prints the tables. What is measured knows nothing of the mesh: a picture of the mask goes to the
landmark network, which was trained on photographs.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.face.action_units import NUMBERS, load_action_units
from hypermask.face.character import find_character, load_character
from hypermask.face.emotions import EMOTIONS
from hypermask.face.face import Face, deform, load_rig
from hypermask.face.features import MIDDLE, PAIRS
from hypermask.face.mouth import CONTROL_POINTS, MOUTH_PARAMETERS, MOUTH_SHAPES
from hypermask.face.sheet import front_view
from hypermask.mask import load_mask
from hypermask.texture.landmarks import FaceFinder

Array = NDArray[np.float64]

PIXELS_PER_MM = 1.8

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
UNSEEN = {
    5: "the network's lids hardly follow eyes that are opened wider",
    29: "the jaw comes forward, towards the viewer",
    31: "a bulge at the jaw's corner, which has no landmark",
    39: "the network's nostrils follow by 0.3 mm only, which is its noise",
    34: "cheeks puffed towards the viewer",
}
"""Units whose main movement the landmarks cannot show from the front, and why."""

_WAYS = {"up": (1, 1.0), "down": (1, -1.0), "out": (0, 1.0), "in": (0, -1.0), "left": (2, 1.0)}


class Viewer:
    """Draws a character and finds its landmarks."""

    def __init__(self, character: str = "mean") -> None:
        mask = load_mask(paths.configs() / "masks" / "reference")
        self.face = Face(load_character(find_character(character)), mask)
        self._finder = FaceFinder()
        self.neutral = self.landmarks()

    def landmarks(self, **asked: Any) -> Array:
        """(468, 2) mm on the mask as the network finds them; asked: as of `Face.positions`."""
        places = self.face.positions(**asked)
        picture = front_view(self.face, places, PIXELS_PER_MM, eye_holes=False)
        found = self._finder.find(np.ascontiguousarray(picture[..., ::-1])).points[:, :2]
        middle = (np.array(picture.shape[1::-1]) - 1) / 2
        return np.asarray((found - middle) * (1, -1) / PIXELS_PER_MM)

    def change(self, **asked: Any) -> Array:
        """(468, 2) mm: the landmarks' movement from the neutral face."""
        return self.landmarks(**asked) - self.neutral


def along(change: Array, point: str, way: str) -> float:
    """mm that a feature point has moved in a direction, the mean of both sides."""
    if point in MIDDLE:
        out = np.array([0.0, change[MIDDLE[point], 1], change[MIDDLE[point], 0]])
    else:
        left, right = (change[vertex] for vertex in PAIRS[point])
        out = np.array([right[0] - left[0], right[1] + left[1], right[0] + left[0]]) / 2
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


def mouth_seen(viewer: Viewer, index: int, values: Array) -> dict[str, Array]:
    """Control point -> (n, 2) mm seen for n values of one mouth parameter, from a parted mouth."""
    parted = 0.5 * MOUTH_SHAPES["e"]
    found = [viewer.landmarks(mouth=parted + np.eye(13)[index] * value) for value in values]
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
    table = load_action_units().table
    print(f"\n{'unit':32} {'point':24} {'way':5} seen mm  mesh mm")
    for number, point, way, seen, made in units_seen(viewer):
        print(f"{number:3} {table[number].name:28} {point:24} {way:5} {seen:7.1f} {made:8.1f}")
    for number in sorted(set(NUMBERS) - set(EXPECTED)):
        print(f"{number:3} {table[number].name:28} not seen: {UNSEEN[number]}")
    print("\nmouth parameter at -0.1 and +0.1: mm seen (right, up) of each control point")
    for index, name in enumerate(MOUTH_PARAMETERS):
        moved = mouth_seen(viewer, index, np.array([-0.1, 0.1]))
        row = "  ".join(f"{key} {p[1, 0] - p[0, 0]:+.1f} {p[1, 1] - p[0, 1]:+.1f}" for key, p in
                        moved.items())  # fmt: skip
        print(f"{name:26} {row}")
    print("\nemotions: cosines of the landmarks' movement")
    full = emotions_seen(viewer)
    for name, line in zip(EMOTIONS, likeness(emotions_seen(viewer, 0.6), full), strict=True):
        print(f"{name + ' at 0.6':18}" + "".join(f"{value:7.2f}" for value in line))


if __name__ == "__main__":
    main()
