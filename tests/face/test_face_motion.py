"""The face's mesh, mouth, emotions and lids move as PAPERS A3 to A5 say, and never tear."""

from pathlib import Path

import numpy as np
import pytest

from hypermask.errors import UsageError
from hypermask.face import interior, points
from hypermask.face.emotions import EMOTIONS
from hypermask.face.face import deform, load_rig
from hypermask.face.lids import blink
from hypermask.face.mesh import load_mesh, signed_areas
from hypermask.face.mouth import CONTROL_POINTS, MOUTH_PARAMETERS, MOUTH_SHAPES
from hypermask.mask import load_mask

MASK = load_mask(Path(__file__).parents[2] / "configs" / "masks" / "reference")
RIG = load_rig()
REST = RIG.mesh.rest * 1000


def _flat(expression=None, mouth=None, lids=0.0) -> np.ndarray:
    return deform(RIG, expression, mouth, lids)[0] * 1000


def _up(flat: np.ndarray, feature: str) -> float:
    return float((flat - REST)[points.FEATURES[feature], 1])


def test_the_mesh_has_the_papers_size_and_is_sound() -> None:
    mesh = load_mesh()
    assert 460 <= mesh.count <= 520 and 800 <= len(mesh.triangles) <= 900
    assert (signed_areas(mesh.rest, mesh.triangles) > 0).all()
    assert (mesh.mirror[mesh.mirror] == np.arange(mesh.count)).all()
    np.testing.assert_allclose(mesh.rest[mesh.mirror] * (-1, 1), mesh.rest, atol=2e-5)


def test_the_rest_face_lies_on_the_masks_features() -> None:
    left = REST[list(points.LEFT_EYE)].mean(axis=0)
    assert abs(left[0] + 31) < 2 and abs(left[1] - 25) < 3
    assert abs(REST[4, 1] + 22) < 6 and abs(REST[13, 1] + 57) < 1.5 and abs(REST[152, 1] + 106) < 3


def test_the_skin_covers_the_whole_outline() -> None:
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 41), np.linspace(-0.14, 0.14, 57))
    inside = np.stack([x, y], -1)[MASK.inside(x, y)]
    assert np.abs(inside).max(axis=0)[0] < np.abs(load_mesh().rest[:, 0]).max()
    assert np.abs(inside).max(axis=0)[1] < np.abs(load_mesh().rest[:, 1]).max()


@pytest.mark.parametrize("emotion", [None, *EMOTIONS])
@pytest.mark.parametrize("shape", MOUTH_SHAPES)
@pytest.mark.parametrize("lids", [0.0, 1.0])
def test_no_triangle_turns_over(emotion, shape, lids) -> None:
    flat = _flat({emotion: 1.0} if emotion else None, MOUTH_SHAPES[shape], lids)
    assert (signed_areas(flat, RIG.mesh.triangles) > 0).all()


def test_no_triangle_turns_over_in_mixtures() -> None:
    random = np.random.default_rng(5)
    shapes = np.array(list(MOUTH_SHAPES.values()))
    for _ in range(300):
        weights = random.dirichlet(np.ones(6)) * random.random()
        mouth = random.dirichlet(np.ones(6)) @ shapes
        flat = _flat(weights, mouth, random.random())
        assert (signed_areas(flat, RIG.mesh.triangles) > 0).all()


@pytest.mark.parametrize("index", range(13))
def test_each_mouth_parameter_moves_its_own_control_point_monotonically(index: int) -> None:
    name = MOUTH_PARAMETERS[index]
    point, _, way = name.rpartition("_")
    places = []
    for value in np.linspace(-0.1, 0.1, 5):
        flat, out = deform(RIG, None, np.eye(13)[index] * value)
        places.append(np.column_stack([flat, out]) * 1000)
    moved = {key: np.array([p[vertex] for p in places]) for key, vertex in CONTROL_POINTS.items()}
    axis = {"horizontal": 0, "vertical": 1, "depth": 2}[way]
    own = {"corner": "corner_right"}.get(point, point)
    if own == "lips":  # the opening widens: the flanks of the lips part, the corners stay
        flank = np.array([p[points.LOWER_LIP_INNER[8], 1] for p in places])
        assert (np.diff(flank) <= 0).all() and flank[0] - flank[-1] > 0.2
    else:
        assert (np.diff(moved[own][:, axis]) >= -1e-9).all()
        assert np.ptp(moved[own][:, axis]) > 0.08 * RIG.half_width * 1000
    for key, path in moved.items():
        if not key.startswith(point) and not (
            way == "vertical" and "lip" in key and "lip" in point
        ):
            assert np.ptp(path, axis=0).max() < 0.35


def test_reference_shapes_look_like_their_vowels() -> None:
    def opening(name: str) -> tuple[float, float]:
        flat = _flat(None, MOUTH_SHAPES[name])
        gap = (
            flat[CONTROL_POINTS["upper_lip_lower"], 1] - flat[CONTROL_POINTS["lower_lip_upper"], 1]
        )
        width = flat[CONTROL_POINTS["corner_right"], 0] - flat[CONTROL_POINTS["corner_left"], 0]
        return gap, width

    gaps = {name: opening(name)[0] for name in MOUTH_SHAPES}
    widths = {name: opening(name)[1] for name in MOUTH_SHAPES}
    assert gaps["closed"] < 1 < gaps["u"] < gaps["e"] < gaps["o"] < gaps["a"]
    assert widths["u"] < widths["o"] < widths["a"] < widths["closed"] < widths["i"]


def test_the_chin_follows_the_jaw_and_stays_on_the_mask() -> None:
    chin = _flat({"surprise": 1.0}, MOUTH_SHAPES["a"])[CONTROL_POINTS["jaw"]]
    assert REST[CONTROL_POINTS["jaw"], 1] - chin[1] > 15
    assert MASK.inside(*(chin / 1000))


def test_emotions_move_the_features_of_their_action_units() -> None:
    flat = {name: _flat({name: 1.0}) for name in EMOTIONS}
    mouth = {name: flat[name] - REST for name in EMOTIONS}
    corner, other = CONTROL_POINTS["corner_right"], CONTROL_POINTS["corner_left"]
    assert _up(flat["anger"], "brow_inner_left") < -4
    assert _up(flat["sadness"], "brow_inner_left") > 4 > 0 > _up(flat["sadness"], "brow_outer_left")
    assert min(_up(flat["surprise"], f"brow_{p}_left") for p in ("inner", "middle", "outer")) > 5
    assert _up(flat["fear"], "brow_inner_left") > 6 and _up(flat["fear"], "lid_upper_left") > 1
    assert _up(flat["happiness"], "cheek_left") > 3
    assert _up(flat["disgust"], "nose_wing_left") > 2
    assert mouth["happiness"][corner, 1] > 5 and mouth["happiness"][corner, 0] > 3
    assert mouth["sadness"][corner, 1] < -5 and mouth["sadness"][other, 1] < -5
    assert mouth["surprise"][CONTROL_POINTS["jaw"], 1] < -10
    vectors = np.array([mouth[name][:468].ravel() for name in EMOTIONS])
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    likeness = vectors @ vectors.T - np.eye(6)
    assert likeness.max() < 0.75


def test_shut_lids_leave_no_gap_whatever_the_expression() -> None:
    for emotion in (None, *EMOTIONS):
        flat = _flat({emotion: 1.0} if emotion else None, None, 1.0)
        gap = flat[RIG.lids.upper, 1] - flat[RIG.lids.lower, 1]
        assert np.abs(gap).max() < 0.05
    left = _flat(None, None, (1.0, 0.0))
    gap = left[RIG.lids.upper, 1] - left[RIG.lids.lower, 1]
    assert np.abs(gap[:7]).max() < 0.05 < 2 < gap[7:].max()


def test_the_skin_next_to_a_shutting_lid_goes_with_it() -> None:
    """Or a line painted along the lid would be drawn out into a band."""
    down = _flat(lids=1.0)[:, 1] - REST[:, 1]
    for lid, skin in (((160, 159, 158), (29, 27, 28)), ((385, 386, 387), (258, 257, 259))):
        assert (down[list(skin)] < 0.85 * down[list(lid)]).all()


def test_rows_of_teeth_stay_stiff_behind_lips_that_bend() -> None:
    flat = deform(RIG, {"happiness": 1.0}, MOUTH_SHAPES["a"])[0]
    lower, upper = interior.teeth_places(flat, RIG.half_width)
    lower_lip = flat[list(points.LOWER_LIP_INNER), 1]
    edge = lower[: len(lower) // 3, 1]
    assert np.ptp(lower_lip) > 0.02 and np.ptp(edge) < 0.4 * np.ptp(lower_lip)
    assert upper[:, 1].max() > flat[13, 1] and np.abs(upper[:, 0]).max() > 0.9 * RIG.half_width
    closed_lower, closed_upper = interior.teeth_places(_flat() / 1000, RIG.half_width)
    assert closed_upper[:, 1].min() > REST[13, 1] / 1000 > closed_lower[:, 1].max()


def test_blinks_are_deterministic_and_rare() -> None:
    times = np.arange(0, 60, 0.01)
    levels = np.array([blink(t) for t in times])
    assert levels.max() > 0.99 and levels.min() == 0
    assert 10 <= ((levels[1:] > 0.5) & (levels[:-1] <= 0.5)).sum() <= 22
    assert (levels > 0).mean() < 0.1
    assert [blink(t) for t in times[:500]] == levels[:500].tolist()


def test_wrong_expressions_and_mouths_are_refused() -> None:
    with pytest.raises(UsageError, match="FACE-EMOTION"):
        deform(RIG, {"joy": 1.0})
    with pytest.raises(UsageError, match="FACE-EMOTION"):
        deform(RIG, np.zeros(5))
    with pytest.raises(UsageError, match="FACE-MOUTH"):
        deform(RIG, None, np.zeros(12))
    with pytest.raises(UsageError, match="FACE-MOUTH"):
        deform(RIG, None, np.full(13, np.nan))


def test_the_mesh_is_finer_at_lips_eyes_and_brows_than_elsewhere() -> None:
    """Mean edge of the triangles there, against that of all triangles that touch none of them."""
    regions = {
        "lips": {*points.LIPS_OUTER, *points.LIPS_INNER},
        "eyes": {*points.LEFT_EYE, *points.RIGHT_EYE},
        "brows": {*points.LEFT_BROW, *points.RIGHT_BROW},
    }
    triangles = RIG.mesh.triangles
    sides = [
        np.linalg.norm(REST[triangles[:, k]] - REST[triangles[:, k - 1]], axis=1) for k in range(3)
    ]
    edge = np.mean(sides, axis=0)
    touch = {name: np.isin(triangles, list(some)).any(axis=1) for name, some in regions.items()}
    elsewhere = edge[~np.any(list(touch.values()), axis=0)].mean()
    assert edge[touch["lips"]].mean() < 0.5 * elsewhere
    assert edge[touch["eyes"]].mean() < 0.5 * elsewhere
    assert edge[touch["brows"]].mean() < 0.75 * elsewhere
    inside = np.isin(triangles, [*regions["brows"], *RIG.mesh.among(regions["brows"])]).all(axis=1)
    assert inside.sum() > 40 and edge[inside].mean() < 0.5 * elsewhere


def test_landmarks_that_are_no_corners_ride_on_their_triangle() -> None:
    """However the face moves: so every landmark has a place on it."""
    loose, corners, shares = RIG.mesh.riders
    assert 20 < len(loose) < 60 and not np.isin(loose, RIG.mesh.triangles).any()
    assert (shares > -1e-3).all()
    np.testing.assert_allclose((REST[corners] * shares[..., None]).sum(1), REST[loose], atol=1e-9)
    named = {*points.FEATURES.values(), *points.OVAL, *points.NOSE, *points.JAW}
    assert not named & set(loose.tolist())
    flat = _flat({"happiness": 1.0}, MOUTH_SHAPES["a"])
    np.testing.assert_allclose((flat[corners] * shares[..., None]).sum(1), flat[loose], atol=1e-6)


def test_the_added_points_lie_half_way_between_landmarks_and_follow_the_brow() -> None:
    mesh = RIG.mesh
    added = np.arange(480, mesh.count)
    assert len(added) == len(mesh.between) > 20
    np.testing.assert_allclose(REST[mesh.between].mean(axis=1), REST[added], atol=0.02)
    np.testing.assert_array_equal(mesh.halfway(REST[:480])[:480], REST[:480])
    raised = (deform(RIG, units={"1": 1.0, "2": 1.0})[0] * 1000 - REST)[:, 1]
    assert raised[added].min() > 4
    assert np.abs(raised[mesh.between].mean(axis=1) - raised[added]).max() < 2.5
