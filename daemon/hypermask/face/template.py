"""Makes `mesh.json` from the landmarks of the faces in a folder of photographs.

    python -m hypermask.face.template FOLDER

The mean of all faces, made symmetric, is laid on to the mask: pupils, nose, mouth and chin go to
where the mask has them. The landmarks are dense where a network finds them well, at the nostrils
and beside the nose; a face needs its brows. So points are added half-way between landmarks of the
brows and around them, and as many triangles' corners are taken where landmarks lie closest and
nothing moves by itself. The triangles are our own: Delaunay's of that shape, with the openings of
eyes and mouth taken out, and a rim around that lies outside the mask's outline.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask.face import points as named
from hypermask.face.features import FEATURE_POINTS
from hypermask.face.mesh import HALF_HEIGHT_M, HALF_WIDTH_M, LANDMARKS, Mesh, even_lips, save_mesh
from hypermask.face.points import LOWER_LIP_INNER, OPENINGS, UPPER_LIP_INNER
from hypermask.texture.fit import PAPER_LANDMARKS
from hypermask.texture.landmarks import FaceFinder, Landmarks
from hypermask.texture.photo import load_photo

Array = NDArray[np.float64]

PUPIL_DISTANCE_MM = 62.0
_LIP_GAP_MM = 0.7
_LIP_REACH_MM = 20.0
_NEAR_OPENING_MM = 7.0
_THINNED_PAIRS = 22
"""So many landmarks on each side are no corner; none as near as that to an eye or to the lips."""
_BROW_BETWEEN = (
    *((70, 63), (63, 105), (105, 66), (66, 107), (46, 53), (53, 52), (52, 65), (65, 55)),
    *((63, 53), (105, 52), (66, 65), (107, 55), (63, 46), (105, 53), (66, 52), (107, 65)),
)
"""Pairs of landmarks of the audience's left brow, and of the skin above it: in the middle of each
the mesh has one more point. The other brow has their mirror images."""
# (height above the pupils in a face with 62 mm between them, height on the mask), both in mm:
# below the chin, chin, mouth, under the nose, tip, pupils, brows, top of the forehead.
_HEIGHTS = (
    *((-130.0, -124.0), (-113.2, -107.0), (-68.1, -57.5), (-46.6, -34.0), (-36.0, -22.0)),
    *((0.0, 25.0), (21.5, 49.0), (52.5, 87.0), (70.0, 106.0)),
)


def mean_shape(faces: list[Landmarks]) -> Array:
    """(468, 3) mm, y up, origin between the pupils, which lie at (+-31, 0)."""
    shapes = []
    for face in faces:
        left, right = face.pupils
        axis = (right - left) / face.eye_distance
        rotation = np.array([axis, [-axis[1], axis[0]]])
        scale = PUPIL_DISTANCE_MM / face.eye_distance
        flat = (face.points[:, :2] - (left + right) / 2) @ rotation.T * scale
        shapes.append(np.column_stack([flat * (1, -1), -face.points[:, 2] * scale]))
    mean: Array = np.mean(shapes, axis=0)
    return mean


def mirror_of(shape: Array) -> NDArray[np.int32]:
    """(468,) the point on the other side, by the best one-to-one match."""
    from scipy.optimize import linear_sum_assignment

    reflected = shape * (-1, 1, 1)
    cost = np.linalg.norm(shape[:, None] - reflected[None], axis=2) ** 2
    match = np.asarray(linear_sum_assignment(cost)[1], np.int32)
    if not (match[match] == np.arange(len(shape))).all():
        raise ValueError("the landmarks have no one-to-one mirror")
    return match


def on_mask(shape: Array) -> Array:
    """(468, 2) mm on the mask: heights by `_HEIGHTS`, widths growing below and beside the eyes."""
    from scipy.interpolate import PchipInterpolator

    heights = np.array(_HEIGHTS)
    x, y = shape[:, 0], shape[:, 1]
    below = np.clip((5 - y) / 50, 0, 1)
    beside = np.clip((np.abs(x) - 31) / 37, 0, 1)
    grow = np.maximum(_smooth(below), _smooth(beside))
    return np.column_stack([x * (1 + 0.16 * grow), PchipInterpolator(*heights.T)(y)])


def with_lips(points: Array, gap_mm: float) -> Array:
    """The same points with the lips `gap_mm` apart in the middle, all around moved along."""
    upper, lower = points[list(UPPER_LIP_INNER)], points[list(LOWER_LIP_INNER)]
    x, y = points[:, 0], points[:, 1]
    line = np.interp(x, upper[:, 0], (upper[:, 1] + lower[:, 1]) / 2)
    gap = np.interp(x, upper[:, 0], upper[:, 1] - lower[:, 1], left=0, right=0)
    profile = np.sin(np.linspace(0, np.pi, len(upper))) ** 0.5
    wanted = gap_mm * np.interp(x, upper[:, 0], profile, left=0, right=0)
    side = np.sign(y - line)
    side[list(UPPER_LIP_INNER)] = 1
    side[list(LOWER_LIP_INNER)] = -1
    shift = side * (wanted - gap) / 2 * np.exp(-np.abs(y - line) / _LIP_REACH_MM)
    return np.column_stack([x, y + shift])


def _smooth(t: Array) -> Array:
    return np.asarray(t * t * (3 - 2 * t))


def _rim() -> Array:
    """(12, 2) mm on the border of the texture's rectangle, outside the mask's outline."""
    w, h = HALF_WIDTH_M * 1000, HALF_HEIGHT_M * 1000
    top = [(-w, h), (-w / 3, h), (w / 3, h), (w, h), (w, h / 3), (w, -h / 3)]
    return np.array(top + [(-x, -y) for x, y in top])


def halfway_points(mirror: NDArray[np.int32]) -> NDArray[np.int32]:
    """(n, 2) pairs of landmarks with a point half-way: those of one brow, then their mirrors."""
    left = np.array(_BROW_BETWEEN, np.int32)
    return np.concatenate([left, mirror[left]])


def thinned(points: Array, mirror: NDArray[np.int32], pairs: int) -> NDArray[np.intp]:
    """Landmarks that are to be no triangle's corner: pair by pair those that lie closest to others.

    What has a name in `hypermask.face.points`, and what is near an eye or the lips, stays.
    """
    loose = _nameless(points)
    kept = np.ones(len(points), bool)
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(gaps, np.inf)
    for _ in range(pairs):
        spacing = np.where(kept, gaps, np.inf).min(axis=1)
        first = int(np.where(loose & kept, spacing, np.inf)[:LANDMARKS].argmin())
        kept[[first, mirror[first]]] = False
    return np.flatnonzero(~kept)


def _nameless(points: Array) -> NDArray[np.bool_]:
    loose = np.zeros(len(points), bool)
    loose[:LANDMARKS] = True
    edges = [*named.LEFT_EYE, *named.RIGHT_EYE, *named.LIPS_OUTER, *named.LIPS_INNER]
    far = np.linalg.norm(points[:, None] - points[edges], axis=2).min(axis=1)
    loose &= far > _NEAR_OPENING_MM
    for some in (named.OVAL, named.JAW, named.NOSE, named.LEFT_BROW, named.RIGHT_BROW):
        loose[list(some)] = False
    loose[[*named.FEATURES.values(), *FEATURE_POINTS.values(), *PAPER_LANDMARKS]] = False
    return loose


def triangulate(
    points: Array, kept: NDArray[np.intp]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """(triangles, holes) of the points `kept`, both anti-clockwise."""
    from scipy.spatial import Delaunay

    triangles = kept[Delaunay(points[kept]).simplices].astype(np.int32)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    triangles[turn < 0] = triangles[turn < 0][:, ::-1]
    outlines = [list(zip(o, o[1:] + o[:1], strict=True)) for o in OPENINGS]
    for edge in (edge for outline in outlines for edge in outline):
        _recover(points, triangles, edge)
    hole = np.zeros(len(triangles), bool)
    for opening in OPENINGS:
        hole |= np.isin(triangles, opening).all(axis=1)
    return triangles[~hole], triangles[hole]


def _recover(points: Array, triangles: NDArray[np.int32], edge: tuple[int, int]) -> None:
    """Flip edges in place until `edge` is one of them (Sloan 1993, constrained triangulation)."""
    for _ in range(100):
        crossing = _crossing(points, triangles, edge)
        if not crossing:
            return
        for first, second in crossing:
            if _flip(points, triangles, first, second):
                break
        else:
            raise ValueError(f"edge {edge} cannot be recovered")


def _crossing(
    points: Array, triangles: NDArray[np.int32], edge: tuple[int, int]
) -> list[tuple[int, int]]:
    """Pairs of neighbouring triangles whose common edge crosses `edge`."""
    owners: dict[frozenset[int], list[int]] = {}
    for number, corners in enumerate(triangles.tolist()):
        for k in range(3):
            owners.setdefault(frozenset((corners[k], corners[k - 2])), []).append(number)
    a, b = edge
    pairs = []
    for common, both in owners.items():
        if len(both) == 2 and not common & {a, b}:
            c, d = common
            apart = _turn(points, a, b, c) * _turn(points, a, b, d) < 0
            if apart and _turn(points, c, d, a) * _turn(points, c, d, b) < 0:
                pairs.append((both[0], both[1]))
    return pairs


def _flip(points: Array, triangles: NDArray[np.int32], first: int, second: int) -> bool:
    one, two = triangles[first].tolist(), triangles[second].tolist()
    (p,) = set(one) - set(two)
    (q,) = set(two) - set(one)
    k = one.index(p)
    c, d = one[(k + 1) % 3], one[(k + 2) % 3]
    if _turn(points, p, c, q) <= 0 or _turn(points, p, q, d) <= 0:
        return False
    triangles[first] = p, c, q
    triangles[second] = p, q, d
    return True


def _turn(points: Array, a: int, b: int, c: int) -> float:
    """Positive where a, b, c turn anti-clockwise."""
    u, v = points[b] - points[a], points[c] - points[a]
    return float(u[0] * v[1] - u[1] * v[0])


def make_mesh(faces: list[Landmarks]) -> Mesh:
    shape = mean_shape(faces)
    mirror = mirror_of(shape)
    symmetric = (shape + shape[mirror] * (-1, 1, 1)) / 2
    rim = _rim()
    points = np.concatenate([on_mask(symmetric), rim])
    reflected = rim * (-1, 1)
    partner = np.linalg.norm(rim[:, None] - reflected[None], axis=2).argmin(axis=1)
    points = with_lips(points, _LIP_GAP_MM)
    points[:LANDMARKS] = even_lips(points[:LANDMARKS])
    between = halfway_points(mirror)
    count, pairs = len(points), len(between) // 2
    points = np.concatenate([points, points[between].mean(axis=1)])
    order = np.arange(2 * pairs)
    whole = np.concatenate([mirror, LANDMARKS + partner, count + np.roll(order, pairs)])
    kept = np.setdiff1d(np.arange(len(points)), thinned(points, whole, _THINNED_PAIRS))
    triangles, holes = triangulate(points, kept)
    return Mesh(points / 1000, triangles, holes, whole.astype(np.int32), between)


def main() -> None:
    finder = FaceFinder()
    photos = sorted(Path(sys.argv[1]).glob("*.jpg"))
    faces = [finder.find(load_photo(photo)) for photo in photos]
    mesh = make_mesh(faces)
    save_mesh(mesh, Path(__file__).with_name("mesh.json"))
    riders = len(mesh.riders[0])
    print(
        f"{len(faces)} faces, {mesh.count} points, {riders} of them no corners, "
        f"{len(mesh.triangles)} triangles"
    )


if __name__ == "__main__":
    main()
