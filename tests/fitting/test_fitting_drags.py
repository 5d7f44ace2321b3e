"""Dragging handles: a point lands where it is dropped, what is far stays, nothing ever folds."""

from __future__ import annotations

import numpy as np
import pytest
from fitting_faces import ROLL, fitting
from hypothesis import given, settings
from hypothesis import strategies as st

from hypermask.errors import UsageError
from hypermask.face.features import FEATURE_POINTS
from hypermask.face.mesh import load_mesh, signed_areas
from hypermask.fitting.handles import LEVELS, load_levels
from hypermask.fitting.session import Fitting

SMALL = {"face": 12.0, "parts": 5.0, "features": 2.5, "points": 0.6}
"""Pixels by which a handle of a level can be moved without anything near folding."""


@pytest.fixture
def session() -> Fitting:
    return fitting()


def _folded(session: Fitting, before: np.ndarray) -> int:
    """Triangles that are turned over now and were upright at first."""
    mesh = load_mesh()
    corners = np.concatenate([mesh.triangles, mesh.holes])
    first, now = (-signed_areas(places, corners) for places in (before, session.vertices()))
    return int(((first > 0) & (now <= 0)).sum())


def _random_handle(session: Fitting, rng: np.random.Generator) -> tuple[str, str]:
    level = LEVELS[rng.integers(len(LEVELS))]
    names = load_levels()[level].handles
    return level, names[rng.integers(len(names))]


def test_levels_are_three_about_twelve_48_and_all(session: Fitting) -> None:
    counts = {level: len(session.handles(level)) for level in LEVELS}
    assert counts["face"] == 3 and 10 <= counts["parts"] <= 14 and counts["features"] == 48
    mesh = load_mesh()
    assert counts["points"] >= len(np.unique(mesh.triangles)) - 12
    assert {f"features/{name}" for name in FEATURE_POINTS} == set(session.handles("features"))


@settings(max_examples=60, deadline=None)
@given(
    level=st.sampled_from(LEVELS),
    number=st.integers(0, 10_000),
    angle=st.floats(0, 6.28),
    far=st.floats(0.05, 1.0),
)
def test_a_dragged_handle_lands_exactly_where_it_is_dropped(
    level: str, number: int, angle: float, far: float
) -> None:
    session = fitting()
    names = list(session.handles(level))
    name = names[number % len(names)]
    x, y = session.handles(level)[name]
    step = far * SMALL[level] * np.array([np.cos(angle), np.sin(angle)])
    done = session.drag(name, x + step[0], y + step[1])
    at = np.array(session.handles(level)[name])
    assert tuple(at) == pytest.approx(done.place, abs=1e-9)
    if not done.held:
        np.testing.assert_allclose(at, (x + step[0], y + step[1]), atol=1e-8)
    else:
        assert done.share < 1
        np.testing.assert_allclose(at - (x, y), done.share * step, atol=1e-6)


@pytest.mark.parametrize("level", ["parts", "features"])
def test_most_small_drags_are_not_held(session: Fitting, level: str) -> None:
    held = 0
    for name, (x, y) in session.handles(level).items():
        held += session.drag(name, x + 2, y - 1).held
        session.undo()
    assert held <= 0.1 * len(session.handles(level))


@pytest.mark.parametrize("level", ["parts", "features", "points"])
def test_other_handles_of_the_level_and_far_points_stay_put(session: Fitting, level: str) -> None:
    mesh, first = load_mesh(), session.vertices()
    for name, (x, y) in list(session.handles(level).items())[:: 1 if level != "points" else 23]:
        others = session.handles(level)
        session.drag(name, x + SMALL[level], y)
        now = session.handles(level)
        for other in others:
            if other != name:
                assert now[other] == pytest.approx(others[other], abs=1e-8), (name, other)
        moved = np.linalg.norm(session.vertices() - first, axis=1) > 1e-9
        row = load_levels()[level].index[name]
        own = load_levels()[level].means[row] > 0
        gaps = np.linalg.norm(mesh.rest[:, None] - mesh.rest[own], axis=2).min(axis=1)
        limit = {"parts": 0.060, "features": 0.036, "points": 1e-9}[level]
        assert moved[own].all() and not moved[gaps > limit].any(), name
        session.undo()


def test_a_groups_pull_fades_smoothly(session: Fitting) -> None:
    first = session.vertices()
    x, y = session.handles("parts")["parts/brow_left"]
    session.drag("parts/brow_left", x, y - 6)
    moved = np.linalg.norm(session.vertices() - first, axis=1)
    corners = load_mesh().triangles
    jump = np.ptp(moved[corners], axis=1)
    assert moved.max() == pytest.approx(6, abs=1e-6) and jump.max() < 6 * 0.8
    assert ((moved > 0.3) & (moved < 5.7)).sum() > 20


def test_the_three_handles_of_the_face_turn_and_stretch_all(session: Fitting) -> None:
    first = session.vertices()
    places = session.handles("face")
    for name, (x, y) in places.items():
        session.drag(name, 1.1 * x + 7, 1.1 * y - 4)
    np.testing.assert_allclose(session.vertices(), 1.1 * first + (7, -4), atol=1e-6)


def test_finer_corrections_ride_on_coarser_ones(session: Fitting) -> None:
    bare = fitting()
    x, y = session.handles("features")["features/cheek_left"]
    session.drag("features/cheek_left", x + 3, y + 2)
    correction = session.vertices() - bare.vertices()
    for one in (session, bare):
        for name, (x, y) in one.handles("face").items():
            one.drag(name, 2 * (x - 380) + 380, 2 * (y - 440) + 440)
    carried = session.vertices() - bare.vertices()
    worst = np.abs(carried - 2 * correction).max()
    assert worst < 0.35, "doubled with the face, but for what it moved the three handles"
    x, y = session.handles("parts")["parts/nose"]
    before = session.vertices()
    session.drag("parts/nose", x, y + 5)
    nose = load_levels()["parts"].index["parts/nose"]
    own = load_levels()["parts"].means[nose] > 0
    np.testing.assert_allclose((session.vertices() - before)[own], [(0, 5)] * own.sum(), atol=1e-8)


@pytest.mark.parametrize("roll", [0.0, ROLL, -0.5])
def test_mirror_lock_moves_the_other_side_about_the_faces_own_midline(roll: float) -> None:
    session = fitting(roll)
    session.mirror = True
    across = np.array([np.cos(roll), np.sin(roll)])
    for level in LEVELS:
        names = list(session.handles(level))
        for name in names[:: max(1, len(names) // 12)]:
            other = session.mirrored(name)
            before = session.handles(level)
            step = SMALL[level] * 0.5 * np.array([0.8, -0.6])
            done = session.drag(name, *(np.array(before[name]) + step))
            after = session.handles(level)
            own, its = (np.subtract(after[n], before[n]) for n in (name, other))
            np.testing.assert_allclose(own, done.share * step, atol=1e-7)
            if other == name:
                assert done.mirror is None
            else:
                assert done.mirror == other and session.mirrored(other) == name
                np.testing.assert_allclose(its, own - 2 * (own @ across) * across, atol=0.02)
                # along the midline alike, across it opposite
                along = np.array([-across[1], across[0]])
                assert its @ along == pytest.approx(own @ along, abs=0.02)
                assert its @ across == pytest.approx(-(own @ across), abs=0.02)
            session.undo()


def test_without_mirror_lock_the_other_side_stays(session: Fitting) -> None:
    before = session.handles("parts")
    x, y = before["parts/brow_left"]
    assert session.drag("parts/brow_left", x, y - 4).mirror is None
    assert session.handles("parts")["parts/brow_right"] == before["parts/brow_right"]


def test_a_thousand_random_drags_fold_nothing(session: Fitting) -> None:
    rng, first = np.random.default_rng(11), session.vertices()
    held = 0
    for number in range(1000):
        session.mirror = bool(number % 3 == 0)
        level, name = _random_handle(session, rng)
        place = np.array(session.handles(level)[name]) + rng.normal(0, 12, 2)
        try:
            held += session.drag(name, *place).held
        except UsageError as error:
            assert error.code == "FIT-PLACE"
        assert _folded(session, first) == 0, (number, name)
    assert held > 50, "some of them must have asked for a fold"
    assert np.isfinite(session.vertices()).all()


def test_a_drag_across_a_neighbour_is_held_before_it_and_says_so(session: Fitting) -> None:
    level = load_levels()["points"]
    row = len(level.handles) // 2
    x, y = session.handles("points")[level.handles[row]]
    done = session.drag(level.handles[row], x + 90, y)
    assert done.held and 0 < done.share < 0.5
    again = session.drag(level.handles[row], x + 90, y)
    assert again.held and again.place[0] - done.place[0] < 0.5 * (done.place[0] - x)


def test_undo_and_redo_bring_back_exactly_what_was(session: Fitting) -> None:
    rng = np.random.default_rng(2)
    seen = [session.vertices()]
    for number in range(120):
        session.mirror = bool(number % 2)
        if number % 40 == 39:
            assert session.reset(LEVELS[number // 40 + 1])
        else:
            level, name = _random_handle(session, rng)
            session.drag(name, *(np.array(session.handles(level)[name]) + rng.normal(0, 3, 2)))
        seen.append(session.vertices())
    steps = session.steps[0]
    distinct = [seen[0]]
    for places in seen[1:]:
        if not np.array_equal(places, distinct[-1]):
            distinct.append(places)
    assert len(distinct) == steps + 1
    for before in distinct[-2::-1]:
        assert session.undo()
        np.testing.assert_array_equal(session.vertices(), before)
    assert not session.undo() and session.steps == (0, steps)
    for after in distinct[1:]:
        assert session.redo()
        np.testing.assert_array_equal(session.vertices(), after)
    assert not session.redo()


def test_a_drag_is_one_step_however_often_it_moves(session: Fitting) -> None:
    first = session.vertices()
    x, y = session.handles("parts")["parts/nose"]
    session.begin("parts/nose")
    for far in (9.0, -4.0, 2.0):
        session.move(x + far, y)
    assert session.end() and session.steps == (1, 0)
    direct = fitting()
    direct.drag("parts/nose", x + 2.0, y)
    np.testing.assert_allclose(session.vertices(), direct.vertices(), atol=1e-9)
    session.undo()
    np.testing.assert_array_equal(session.vertices(), first)


def test_a_click_is_no_step_and_cancel_puts_everything_back(session: Fitting) -> None:
    first = session.vertices()
    session.begin("features/chin")
    assert not session.end() and session.steps == (0, 0)
    session.begin("features/chin")
    session.move(400, 700)
    session.cancel()
    np.testing.assert_array_equal(session.vertices(), first)
    assert session.steps == (0, 0) and session.dragging is None


def test_a_new_step_forgets_what_was_undone(session: Fitting) -> None:
    x, y = session.handles("parts")["parts/chin"]
    session.drag("parts/chin", x, y + 3)
    session.undo()
    session.drag("parts/chin", x, y - 3)
    assert session.steps == (1, 0) and not session.redo()


def test_the_history_is_long_but_its_memory_is_bounded(session: Fitting) -> None:
    from fitting_faces import landmarks, photo

    small = Fitting(photo(), landmarks(), history_bytes=20_000)
    for number in range(300):
        x, y = small.handles("features")["features/cheek_left"]
        small.drag("features/cheek_left", x + (1 if number % 2 else -1), y)
    kept = small.steps[0]
    assert 20 < kept < 80
    while small.undo():
        pass
    assert small.steps == (0, kept)
    for number in range(300):
        x, y = session.handles("features")["features/cheek_left"]
        session.drag("features/cheek_left", x + (1 if number % 2 else -1), y)
    assert session.steps[0] == 300


def test_reset_of_a_level_keeps_the_others_and_of_all_is_the_automatic_fit(
    session: Fitting,
) -> None:
    first = session.vertices()
    for name in ("parts/brow_left", "features/chin", "points/4"):
        x, y = session.handles(name.split("/")[0])[name]
        session.drag(name, x + 1, y + 1)
    assert session.reset("features")
    assert not session.moved["features"].any() and session.moved["parts"].any()
    assert not session.reset("features"), "nothing is left to reset"
    assert session.reset()
    np.testing.assert_array_equal(session.vertices(), first)
    session.undo()
    session.undo()
    assert session.moved["features"].any()


def test_a_reset_that_would_fold_the_mesh_takes_the_finer_levels_along(session: Fitting) -> None:
    first = session.vertices()
    x, y = session.handles("parts")["parts/brow_left"]
    session.drag("parts/brow_left", x, y - 25)
    corner = session.handles("features")["features/brow_middle_left"]
    for name in list(session.handles("points")):
        at = session.handles("points")[name]
        if np.hypot(at[0] - corner[0], at[1] - corner[1]) < 25:
            session.drag(name, at[0], at[1] + 12)
    session.reset("parts")
    assert _folded(session, first) == 0


def test_the_nearest_handle_within_a_radius_is_found(session: Fitting) -> None:
    for level in LEVELS:
        name, (x, y) = list(session.handles(level).items())[-1]
        assert session.nearest(level, x + 0.01, y, 5) == name
    assert session.nearest("face", -200, -200, 50) is None


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (lambda s: s.handles("eyes"), "FIT-LEVEL"),
        (lambda s: s.handles(None), "FIT-LEVEL"),
        (lambda s: s.reset("eyes"), "FIT-LEVEL"),
        (lambda s: s.begin("parts/tail"), "FIT-HANDLE"),
        (lambda s: s.begin("points/99999"), "FIT-HANDLE"),
        (lambda s: s.begin(4), "FIT-HANDLE"),
        (lambda s: s.begin(""), "FIT-HANDLE"),
        (lambda s: s.drag("parts/nose", float("nan"), 3), "FIT-PLACE"),
        (lambda s: s.drag("parts/nose", 3, float("inf")), "FIT-PLACE"),
        (lambda s: s.drag("parts/nose", "3", 3), "FIT-PLACE"),
        (lambda s: s.drag("parts/nose", True, 3), "FIT-PLACE"),
        (lambda s: s.drag("parts/nose", None, 3), "FIT-PLACE"),
        (lambda s: s.drag("parts/nose", 10**400, 3), "FIT-PLACE"),
        (lambda s: s.drag("parts/nose", 5000, 300), "FIT-PLACE"),
        (lambda s: s.nearest("parts", 1, 2, float("nan")), "FIT-PLACE"),
        (lambda s: s.move(3, 4), "FIT-DRAG"),
        (lambda s: s.end(), "FIT-DRAG"),
        (lambda s: s.cancel(), "FIT-DRAG"),
        (lambda s: s.texture(300), "FIT-SIZE"),
    ],
)
def test_what_cannot_be_meant_has_a_code_and_changes_nothing(
    session: Fitting, call, code: str
) -> None:
    before = session.vertices()
    with pytest.raises(UsageError) as caught:
        call(session)
    assert caught.value.code == code and caught.value.remedy
    assert session.dragging is None and session.steps == (0, 0)
    np.testing.assert_array_equal(session.vertices(), before)


@pytest.mark.parametrize("what", ["undo", "redo", "reset"])
def test_nothing_else_goes_while_a_handle_is_held(session: Fitting, what: str) -> None:
    session.begin("parts/nose")
    with pytest.raises(UsageError, match="FIT-DRAG"):
        getattr(session, what)()
    with pytest.raises(UsageError, match="FIT-DRAG"):
        session.begin("parts/chin")
    assert session.dragging == "parts/nose"
