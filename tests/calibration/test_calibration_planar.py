"""The paper's four points: exact where they were laid, and honest about where they stop."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_rig import CAMERA, MASK, Rig, data_sheet, reference_truth, rms

from hypermask.calibration.parallax import Parallax, surface
from hypermask.calibration.parameters import ProCam, point_jacobian
from hypermask.calibration.planar import Planar, affine, calibrate, projective
from hypermask.calibration.rehearsed import rehearse
from hypermask.calibration.session import planned_positions
from hypermask.errors import DataError
from hypermask.geometry import FACING, Pose, homogeneous_apply

SQUARE = np.array([[600.0, 350], [700, 360], [690, 480], [605, 470]])


def facing(x: float, y: float, z: float) -> Pose:
    return Pose(FACING, np.array([x, y, z]))


def laid_at(pose: Pose, truth: ProCam, kind: str, aim_px: np.ndarray | float = 0.0) -> Planar:
    corners = pose.apply(MASK.leds)[:4]
    return calibrate(
        kind,  # type: ignore[arg-type]
        CAMERA.project(corners),
        truth.project(corners) + aim_px,
        pose,
        truth.projector_from_camera.inverse().translation,
        MASK,
        aim_m=1e-5,
    )


def error_on_mask_mm(planar: Planar, pose: Pose, truth: ProCam) -> float:
    """rms over the relief of where the true light of each drawn point falls."""
    drawn_map = planar.projector_from_mask(CAMERA.project(pose.apply(MASK.leds)), MASK)
    points = surface(MASK)
    there = pose.apply(points)
    off = homogeneous_apply(drawn_map, points) - truth.project(there)
    across = point_jacobian(truth, there) @ pose.rotation[:, :2]
    on_mask = np.linalg.solve(across, off[..., None])[..., 0]
    return rms(np.linalg.norm(on_mask, axis=1)) * 1e3


def test_the_projective_form_solves_the_papers_eight_equations() -> None:
    true = np.array([[1.9, 0.03, -400], [-0.02, 2.1, 250], [1e-5, -2e-5, 1.0]])
    solved, condition = projective(SQUARE, homogeneous_apply(true, SQUARE))
    np.testing.assert_allclose(solved, true, rtol=1e-6, atol=1e-9)
    assert 1e3 < condition < 1e14  # reported: why the paper found this form unstable


def test_the_affine_form_is_the_least_squares_solution() -> None:
    noisy = SQUARE * 2 + np.random.default_rng(3).normal(0, 1, SQUARE.shape)
    solved, condition = affine(SQUARE, noisy)
    design = np.column_stack([SQUARE, np.ones(4)])
    expected = np.linalg.lstsq(design, noisy, rcond=None)[0].T
    np.testing.assert_allclose(solved[:2], expected, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(solved[2], [0, 0, 1])
    assert np.isfinite(condition)


def test_an_affine_map_bears_aiming_errors_better_than_a_projective_one() -> None:
    """Why the paper chose it: away from the calibrated place the perspective terms run off."""
    truth = reference_truth(0.03)
    here, elsewhere = facing(0.03, -0.34, 1.8), facing(0.60, -0.34, 1.8)
    random = np.random.default_rng(4)
    aims = random.normal(0, 1, (20, 4, 2))
    worst = {
        kind: max(error_on_mask_mm(laid_at(here, truth, kind, a), elsewhere, truth) for a in aims)
        for kind in ("affine", "projective")
    }
    assert worst["affine"] < 0.5 * worst["projective"]


@pytest.mark.parametrize("points", [np.zeros((4, 2)), np.arange(8.0).reshape(4, 2)])
@pytest.mark.parametrize("solve", [affine, projective])
def test_points_on_a_line_are_refused(solve, points) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(DataError) as caught:
        solve(points, SQUARE)
    assert caught.value.code == "CAL-PLANAR"


@pytest.mark.parametrize("kind", ["affine", "projective"])
@pytest.mark.parametrize("points", [4, 5])
def test_the_four_corner_leds_land_where_the_map_sends_them(kind: str, points: int) -> None:
    pose = facing(0.05, -0.3, 1.8)
    planar = laid_at(pose, reference_truth(0.03), kind)
    seen = CAMERA.project(pose.apply(MASK.leds))[:points]
    drawn = homogeneous_apply(planar.projector_from_mask(seen, MASK), MASK.leds[:4])
    np.testing.assert_allclose(drawn, homogeneous_apply(planar.homography, seen[:4]), atol=1e-6)
    np.testing.assert_array_equal(planar.projector_from_mask(seen, MASK)[:, 2], 0)


def test_the_band_is_that_of_the_facts_for_a_flat_mask() -> None:
    """Baseline 150 mm, 2 m, tolerance 2 mm: 27 mm to either side."""
    flat = Parallax(2.0, (0.150, 0.0), (0.0, 0.0), 0.0, 0.0)
    near, far = flat.band_m(0.002)
    assert (2.0 - near, far - 2.0) == pytest.approx((0.0267, 0.0267), abs=1e-4)
    assert flat.error_m(1.5) == pytest.approx(0.0375)
    nose = Parallax(2.0, (0.150, 0.0), (0.003, 0.0), 0.003, 0.0)
    assert nose.error_m(2.0) == pytest.approx(0.003)


def test_relief_and_aiming_move_the_band_but_do_not_narrow_it() -> None:
    proud = Parallax(2.0, (0.1, 0.0), (0.003, 0.0), 0.006, 0.003)
    near, far = proud.band_m(0.002)
    assert far - near == pytest.approx(2 * 0.002 * 2.0 / 0.1)
    assert (near + far) / 2 == pytest.approx(2.0 * (1 + 0.003 / 0.1))
    for end in (near, far):
        assert proud.error_m(end) == pytest.approx(np.hypot(proud.least_error_m, 0.002))


def test_without_a_baseline_the_map_holds_at_every_distance() -> None:
    assert Parallax(2.0, (0.0, 0.0), (0.0, 0.0), 0.0, 0.001).band_m(0.002)[1] == np.inf


@pytest.mark.parametrize("baseline", [0.03, 0.15])
@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.05, -0.34), (-0.4, -0.2)])
@pytest.mark.parametrize("off_m", [-0.3, -0.1, 0.0, 0.1, 0.3])
def test_the_measured_error_agrees_with_the_reported_one(
    baseline: float, centre: tuple[float, float], off_m: float
) -> None:
    truth = reference_truth(baseline)
    planar = laid_at(facing(*centre, 1.8), truth, "affine")
    z = 1.8 + off_m
    moved = facing(centre[0] * z / 1.8, centre[1] * z / 1.8, z)
    measured = error_on_mask_mm(planar, moved, truth)
    assert measured == pytest.approx(planar.expected_error_m(z) * 1e3, rel=0.12, abs=0.15)


def test_at_the_ends_of_the_band_the_distance_has_added_the_tolerance() -> None:
    truth = reference_truth(0.03)
    planar = laid_at(facing(0.0, -0.1, 1.8), truth, "affine")
    near, far = planar.band_m
    assert 1.5 < near < 1.8 < far < 2.1
    for end in (near, far):
        measured = error_on_mask_mm(planar, facing(0.0, -0.1 * end / 1.8, end), truth)
        least = planar.parallax.least_error_m * 1e3
        assert np.sqrt(measured**2 - least**2) == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize("kind", ["affine", "projective"])
def test_an_operator_with_one_pixel_of_error_stays_under_three_millimetres(kind: str) -> None:
    """30 mm baseline, at the calibrated distance, mask straight: over twenty operators."""
    errors, expected = [], []
    for seed in range(20):
        rig = Rig(reference_truth(0.03), data_sheet(0.03), seed)
        positions = planned_positions(rig.cart, kind)  # type: ignore[arg-type]
        result = rehearse(rig.session(kind, positions=positions), rig.measure, rig.operator.key)
        planar = result.outcome.calibration
        assert isinstance(planar, Planar) and planar.kind == kind
        pose = Pose(FACING, rig.pose.translation)
        errors.append(error_on_mask_mm(planar, pose, rig.truth))
        expected.append(result.outcome.expected_mm)
    assert rms(np.array(errors)) < 3.0
    assert rms(np.array(errors)) == pytest.approx(rms(np.array(expected)), rel=0.3)
