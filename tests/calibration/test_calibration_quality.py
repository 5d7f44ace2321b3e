"""The figure that the operator is told is the error that he gets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration_rig import (
    CAMERA,
    MASK,
    Rig,
    data_sheet,
    placements,
    reference_truth,
    rms,
    true_errors_mm,
    volume,
)

from hypermask.calibration.parameters import updated
from hypermask.calibration.positions import (
    Position,
    candidates,
    eyes,
    fits,
    information,
    plan,
    recentred,
)
from hypermask.calibration.procam import solve
from hypermask.calibration.quality import assess
from hypermask.calibration.session import planned_positions
from hypermask.geometry import attitude_from_rotation

TRUTH = reference_truth()
POSITIONS = planned_positions(Rig().cart, "click")
BY_DISTANCE = sorted(POSITIONS, key=lambda p: p.distance_m)


def clicked(positions: list[Position], seed: int, sigma: float = 1.0):  # type: ignore[no-untyped-def]
    random = np.random.default_rng(seed)
    return placements(TRUTH, positions, lambda: random.normal(0, sigma, (5, 2)))


def test_the_working_volume_covers_the_papers_working_range() -> None:
    poses = volume().poses
    assert len(poses) == 150
    depths = [p.translation[2] for p in poses]
    assert 1.2 <= min(depths) < 1.3 and 2.3 < max(depths) <= 2.4
    angles = np.degrees([attitude_from_rotation(np.diag([1, -1, -1]) @ p.rotation) for p in poses])
    assert np.all(np.abs(angles[:, 1]) <= 20.01) and np.all(np.abs(angles[:, 2]) <= 30.01)
    assert angles[:, 0].min() < -150 and angles[:, 0].max() > 150
    assert all(fits(p, MASK.leds, *eyes(CAMERA, TRUTH)) for p in poses)


def test_errors_are_measured_on_the_tilted_mask() -> None:
    """The derivative is where the light, drawn by a slightly wrong projector, meets the mask."""
    where = volume()
    step = np.array([0.1, 0.2, -0.1, 1e-5, -2e-5, 3e-5, 1e-5, 2e-5, -1e-5])
    inverse = TRUTH.projector_from_camera.inverse()
    for pose in where.poses[:5]:
        points = pose.apply(where.points)
        pixels = 2 * TRUTH.project(points) - updated(TRUTH, step).project(points)
        homogeneous = np.column_stack([pixels, np.ones(len(pixels))])
        rays = homogeneous @ np.linalg.inv(TRUTH.projector.matrix).T @ inverse.rotation.T
        normal = pose.rotation[:, 2]
        reach = (points - inverse.translation) @ normal / (rays @ normal)
        lit = inverse.translation + rays * reach[:, None]
        missed = ((points - lit) @ pose.rotation)[:, :2]
        told = where.error_jacobian(TRUTH, pose) @ step
        np.testing.assert_allclose(told, missed, atol=0.01 * np.abs(missed).max())


def test_the_expected_error_is_that_of_many_repetitions() -> None:
    """Bootstrap: new clicks with the same sigma, solved anew, against the linearised figure."""
    first = solve(clicked(POSITIONS, 1), MASK.leds, data_sheet())
    told = assess(replace(first, sigma_px=1.0), MASK, CAMERA).expected_mm / first.sigma_px
    errors = []
    for seed in range(40):
        again = solve(clicked(POSITIONS, seed), MASK.leds, data_sheet()).procam
        errors.append(rms(true_errors_mm(again, TRUTH, volume())))
    assert rms(np.array(errors)) == pytest.approx(told, rel=0.15)


def test_a_shaky_operator_is_told_so() -> None:
    steady, shaky = (
        assess(solve(clicked(POSITIONS, 5, s), MASK.leds, data_sheet()), MASK, CAMERA)
        for s in (1.0, 4.0)
    )
    assert shaky.sigma_px > 2.5 * steady.sigma_px
    assert shaky.expected_mm > 2.5 * steady.expected_mm
    assert steady.grade == "good" and shaky.grade in ("fair", "poor")
    assert steady.lines()[0].startswith("good: 0.")
    assert any(line.startswith("add a position ") for line in shaky.lines())


def test_the_suggested_position_does_what_it_promises() -> None:
    few = [BY_DISTANCE[0], BY_DISTANCE[2]]
    solution = solve(clicked(few, 2), MASK.leds, data_sheet())
    before = assess(solution, MASK, CAMERA)
    assert before.add is not None
    after = assess(solve(clicked([*few, before.add], 2), MASK.leds, data_sheet()), MASK, CAMERA)
    assert before.add_mm < 0.7 * before.expected_mm
    assert after.expected_mm == pytest.approx(before.add_mm, rel=0.35)


def test_near_clicks_only_make_the_suggestion_a_far_one() -> None:
    near = [p for p in POSITIONS if p.distance_m < 2.0]
    quality = assess(solve(clicked(near, 3), MASK.leds, data_sheet()), MASK, CAMERA)
    assert quality.add is not None and quality.add.distance_m == 2.4
    assert "2.4 m away" in str(quality.add)
    errors = [mm for _, mm in quality.by_distance]
    assert errors == sorted(errors)


def test_the_plan_is_spread_in_depth_and_better_than_chance() -> None:
    assert sorted(p.distance_m for p in POSITIONS) == [1.2, 1.2, 1.8, 1.8, 2.4, 2.4]
    assert len({(p.x_m, p.y_m, p.distance_m) for p in POSITIONS}) == 6
    assert any(abs(p.yaw) > 0.2 for p in POSITIONS)
    weight = volume().weight(TRUTH)

    def error(positions: list[Position]) -> float:
        known = np.diag([1e-4, 1e-3, 1e-3, 400, 400, 400, 2500, 2500, 2500.0])
        known += sum(information(p, MASK.leds, TRUTH, 1.0) for p in positions)
        return float(np.sqrt(np.trace(np.linalg.solve(known, weight))))

    random = np.random.default_rng(0)
    possible = candidates(MASK.leds, CAMERA, TRUTH)
    by_chance = [
        error([possible[i] for i in random.choice(len(possible), 6, replace=False)])
        for _ in range(50)
    ]
    assert error(POSITIONS) < min(by_chance)


def test_the_first_position_is_the_most_central_one() -> None:
    """A data sheet that is wrong by two degrees must not push the first clicks off the picture."""
    centres = [data_sheet().project([p.x_m, p.y_m, p.distance_m]) for p in POSITIONS]
    off = [np.linalg.norm(c - np.array([640, 360])) for c in centres]
    assert off[0] == min(off)


def test_a_position_keeps_its_place_in_the_picture_when_the_projector_is_known() -> None:
    for position in POSITIONS:
        planned = data_sheet().project([position.x_m, position.y_m, position.distance_m])
        moved = recentred(position, data_sheet(), TRUTH)
        now = TRUTH.project([moved.x_m, moved.y_m, moved.distance_m])
        np.testing.assert_allclose(now, planned, atol=1e-6)


def test_a_distance_at_which_the_mask_does_not_fit_is_left_out() -> None:
    weight = volume().weight(TRUTH)
    found = plan(MASK.leds, CAMERA, TRUTH, weight, (0.3, 1.8), 2)
    assert [p.distance_m for p in found] == [1.8, 1.8]


def test_positions_are_told_in_words() -> None:
    position = Position(-0.3, -0.5, 1.2, np.radians(20), np.radians(-25), side=-1, level=1)
    assert str(position) == (
        "1.2 m away, to the left, high in the picture, nose turned 25° to the left, 20° down"
    )
    assert str(Position(0, 0, 2.4)) == "2.4 m away, in the middle"
