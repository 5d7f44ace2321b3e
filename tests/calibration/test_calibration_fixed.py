"""A fixed screen: control points, keys, and what they make of a lens that is not as drawn."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hypermask.calibration import records, storage
from hypermask.calibration.fixed import (
    Fixed,
    control_points,
    moved,
    nominal_fixed,
    pixel_size_m,
    solve,
)
from hypermask.calibration.nudging import Nudging
from hypermask.calibration.outcome import Outcome
from hypermask.calibration.session import Phase
from hypermask.errors import DataError
from hypermask.geometry import Array, Fisheye
from hypermask.mask import Mask, load_mask

MASK = load_mask(Path(__file__).parents[2] / "configs" / "masks" / "maskbot")
NOMINAL = nominal_fixed((1280, 800), 440.0, k=(0.02, -0.006, 0.0, 0.0))
OFF = np.array(
    [6, 3, -4, 0.01, -0.004, 0.001, 0, *np.radians([1.2, -0.9, 0.8]), 0.002, -0.0015, 0.002]
)
"""A lens and a mounting that are not as the builder believes."""
TRUTH = moved(NOMINAL, OFF)
POINTS = control_points(MASK)
SCREEN = control_points(MASK, 13, 19)


def on_marks(rng: np.random.Generator, error_mm: float = 0.5) -> Array:
    """Whole pixels that light each point, as an operator with that error an axis lays them."""
    beside = POINTS.copy()
    beside[:, :2] += rng.normal(0, error_mm * 1e-3, (len(POINTS), 2))
    beside[:, 2] = MASK.height(beside[:, 0], beside[:, 1])
    return np.round(TRUTH.project(beside))


def error_mm(fixed: Fixed, truth: Callable[[Array], Array] = TRUTH.project) -> float:
    gaps = np.linalg.norm(fixed.project(SCREEN) - truth(SCREEN), axis=1)
    return float(np.sqrt(np.mean((gaps * pixel_size_m(NOMINAL, SCREEN)) ** 2)) * 1e3)


def test_the_lens_is_that_of_opencv() -> None:
    lens = Fisheye(NOMINAL.lens.matrix, np.array([0.03, -0.01, 0.002, 0.001]), (1280, 800))
    points = np.random.default_rng(0).normal([0, 0, 0.15], 0.1, (50, 3))
    points = points[points[:, 2] > 0.01]
    theirs = cv2.fisheye.projectPoints(
        points.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), lens.matrix, lens.k
    )[0]
    assert np.abs(lens.project(points) - theirs.reshape(-1, 2)).max() < 1e-6
    assert lens.project(np.array([[0, 0, 1.0]]))[0] == pytest.approx([639.5, 399.5])


def test_control_points_stand_on_the_screen_from_the_middle_outwards() -> None:
    assert len(POINTS) == 35
    assert MASK.inside(POINTS[:, 0], POINTS[:, 1]).all()
    assert POINTS[:, 2] == pytest.approx(MASK.height(POINTS[:, 0], POINTS[:, 1]))
    distances = np.hypot(POINTS[:, 0], POINTS[:, 1])
    assert (np.diff(distances) > -1e-5).all()
    # The outermost reach nearly to the rim: nothing of the face lies far outside of them.
    assert distances.max() > 0.125


def test_the_builders_figures_alone_are_millimetres_off() -> None:
    assert error_mm(NOMINAL) > 2.0


def test_exact_points_give_the_exact_map() -> None:
    found = solve(POINTS, TRUTH.project(POINTS), NOMINAL, MASK, sigma_px=0.01)
    assert error_mm(found.fixed) < 0.005
    assert found.left_out == ()


@pytest.mark.parametrize("seed", range(8))
def test_an_operator_half_a_millimetre_off_gives_half_a_millimetre_or_better(seed: int) -> None:
    found = solve(POINTS, on_marks(np.random.default_rng(seed)), NOMINAL, MASK)
    assert error_mm(found.fixed) <= 0.45
    assert found.fixed.expected_mm == pytest.approx(0.28, abs=0.12)


def test_a_bend_that_no_lens_makes_is_carried_over_the_screen() -> None:
    """Such as a screen that was not printed as it was drawn."""

    def bent(points: Array) -> Array:
        wave = np.sin(points[:, 0] / 0.035) * np.cos(points[:, 1] / 0.05)
        return TRUTH.project(points) + 5.0 * np.stack([wave, -0.7 * wave], axis=1)

    found = solve(POINTS, bent(POINTS), NOMINAL, MASK, sigma_px=0.3)
    lens_alone = Fixed(found.fixed.lens, found.fixed.projector_from_mask)
    assert len(found.fixed.anchors) > 0
    assert error_mm(found.fixed, bent) < 0.4 * error_mm(lens_alone, bent)


def test_the_operators_own_error_is_not_taken_for_a_bend() -> None:
    bends = [
        len(solve(POINTS, on_marks(np.random.default_rng(seed)), NOMINAL, MASK).fixed.anchors)
        for seed in range(8)
    ]
    assert sum(count > 0 for count in bends) <= 2


def test_a_point_that_was_not_laid_on_its_mark_is_left_out_and_named() -> None:
    pixels = on_marks(np.random.default_rng(1))
    pixels[11] += [25, -14]
    found = solve(POINTS, pixels, NOMINAL, MASK)
    assert found.left_out == (11,)
    assert error_mm(found.fixed) <= 0.45


def test_too_few_points_and_points_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(DataError) as few:
        solve(POINTS[:5], TRUTH.project(POINTS[:5]), NOMINAL, MASK)
    assert few.value.code == "CAL-FEW"
    rng = np.random.default_rng(3)
    with pytest.raises(DataError) as wild:
        solve(POINTS, TRUTH.project(POINTS) + rng.normal(0, 60, POINTS[:, :2].shape), NOMINAL, MASK)
    assert wild.value.code == "CAL-CLICKS"


def test_density_says_where_the_screen_is_bright() -> None:
    flat = np.array([[0.0, 0, 0.03], [0.0, 0.12, 0.0]])
    middle, rim = NOMINAL.density(flat, np.array([[0, 0, 1.0], [0, 0, 1.0]]))
    # At 0.15 m, straight on: (440 / 0.15)^2 pixels a square metre.
    assert middle == pytest.approx((440 / 0.15) ** 2, rel=0.01)
    assert rim < 0.7 * middle


# --- on disk ----------------------------------------------------------------------------------


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path))
    return tmp_path / "calibration"


def test_it_is_stored_and_read_back_to_the_last_digit(home: Path) -> None:
    pixels = on_marks(np.random.default_rng(2)) + 4 * np.sin(POINTS[:, :1] / 0.03)
    fixed = solve(POINTS, pixels, NOMINAL, MASK, sigma_px=0.3).fixed
    assert len(fixed.anchors)
    path = storage.save(Outcome(fixed, None, (), ("left out: point 3",)), "fixed")
    assert path.name == "0001-fixed.json"
    stored, warning = storage.load_current()
    assert warning is None
    assert isinstance(stored.calibration, Fixed)
    assert np.array_equal(stored.calibration.project(SCREEN), fixed.project(SCREEN))
    assert stored.expected_mm == fixed.expected_mm
    assert stored.lines[-1] == "left out: point 3"


@pytest.mark.parametrize(
    "change",
    [{"k": [0.1, 0.2, 0.3]}, {"weights_px": []}, {"reach_m": 0}, {"size": [3]}, {"matrix": None}],
)
def test_a_damaged_one_is_refused(change: dict[str, Any]) -> None:
    pixels = on_marks(np.random.default_rng(2)) + 4 * np.sin(POINTS[:, :1] / 0.03)
    table = records.fixed_table(solve(POINTS, pixels, NOMINAL, MASK, sigma_px=0.3).fixed)
    with pytest.raises((ValueError, TypeError, KeyError)):
        records.fixed_from(table | change)


# --- the operator's way -------------------------------------------------------------------------


def nudging() -> Nudging:
    return Nudging(NOMINAL, MASK)


def lay(session: Nudging, truth: Fixed = TRUTH) -> None:
    """The light of the next point exactly on its mark."""
    point = session.point
    assert point is not None
    session._put(*(float(v) for v in truth.project(POINTS[point][None])[0]))
    session.key("enter", 0.0)


@pytest.mark.parametrize(
    ("key", "right", "up"), [("6", 1, 0), ("4", -1, 0), ("8", 0, 1), ("2", 0, -1), ("9", 1, 1)]
)
@pytest.mark.parametrize("roll", [0, 180])
def test_keys_move_the_light_as_seen_from_the_front(
    key: str, right: int, up: int, roll: int
) -> None:
    nominal = nominal_fixed((1280, 800), 440.0, attitude_deg=(roll, 0, 0))
    session = Nudging(nominal, MASK)
    before = np.array(session.view().cross_hair)
    session.key(key, 0.0)
    step = np.array(session.view().cross_hair) - before
    ahead = nominal.project(np.array([[1e-3 * right, 1e-3 * up, 0.0]])) - nominal.project(
        np.zeros((1, 3))
    )
    assert np.sign(np.round(step)).tolist() == np.sign(np.round(ahead[0], 2)).tolist()
    assert np.abs(step).max() == 32


def test_each_point_brings_the_next_nearer_to_its_mark() -> None:
    session = nudging()
    gaps = []
    while session.phase is Phase.CLICK:
        point = session.point
        assert point is not None
        wanted = TRUTH.project(POINTS[point][None])[0]
        gaps.append(float(np.linalg.norm(wanted - session.view().cross_hair)))
        lay(session)
    assert gaps[0] > 10
    assert max(gaps[12:]) < 6
    assert session.phase is Phase.REVIEW
    assert session.outcome is not None
    session.key("enter", 0.0)
    assert session.phase is Phase.DONE
    assert session.outcome.expected_mm < 0.3


def test_undo_goes_back_to_where_the_light_was() -> None:
    session = nudging()
    lay(session)
    where = session.pixels[0].copy()
    session.key("backspace", 0.0)
    assert session.point == 0
    assert session.view().cross_hair == tuple(where)
    session.key("backspace", 0.0)
    assert "nothing to undo" in session.view().lines[0]


def test_a_skipped_point_is_left_out_and_an_early_end_needs_enough() -> None:
    session = nudging()
    session.key("0", 0.0)
    for _ in range(5):
        lay(session)
    session.key("star", 0.0)
    assert session.problem is not None
    assert session.problem.code == "CAL-FEW"
    session.key("backspace", 0.0)
    for _ in range(5):
        lay(session)
    session.key("star", 0.0)
    assert session.problem is None
    assert np.isnan(session.pixels[0]).all()


def test_in_the_review_all_points_are_lit_where_the_result_puts_them() -> None:
    session = nudging()
    for _ in range(12):
        lay(session)
    assert len(session.marks()) == 12
    session.key("star", 0.0)
    gaps = np.linalg.norm(session.marks() - TRUTH.project(POINTS), axis=1)
    assert len(gaps) == 35
    assert np.median(gaps) < 3


def test_an_interrupted_session_goes_on_where_it_was() -> None:
    session = nudging()
    for _ in range(9):
        lay(session)
    session.key("0", 0.0)
    table = json.loads(json.dumps(session.snapshot()))
    again = Nudging.resume(NOMINAL, MASK, table)
    assert again.point == session.point == 10
    assert again.view().cross_hair == session.view().cross_hair
    assert again.key_presses == session.key_presses
    for broken in ({"order": [99]}, {"pixels_px": "x"}, {"method": "click"}):
        with pytest.raises(DataError) as caught:
            Nudging.resume(NOMINAL, MASK, table | broken)
        assert caught.value.code == "CAL-READ"


def test_another_mask_gets_points_of_its_own() -> None:
    other: Mask = load_mask(Path(__file__).parents[2] / "configs" / "masks" / "reference")
    assert len(control_points(other, 3, 3)) == 9
