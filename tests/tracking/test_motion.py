"""The motion filter and its prediction: what the stage may rely on."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from hypermask.geometry import FACING, Array, Pose, rotation_from_vector
from hypermask.tracking.motion import MODES, MOTION, MotionFilter, PredictedPose, predict
from hypermask.tracking.motion_bench import displacements_mm
from hypermask.tracking.motion_clips import measurement_covariance

Path = Callable[[float], Pose]

LEAD_S = 0.0425
RATE_HZ = 120.0


def still(_time_s: float) -> Pose:
    return Pose(FACING @ rotation_from_vector([0.1, 0.2, 0.0]), np.array([0.1, 0.0, 1.8]))


def walk(time_s: float) -> Pose:
    """A sway of 0.2 m, a bob of 40 mm, and a turning head."""
    x = 0.2 * np.sin(2 * np.pi * 0.5 * time_s)
    y = 0.04 * np.sin(2 * np.pi * 1.9 * time_s)
    turn = [0.1 * np.sin(2 * time_s), 0.4 * np.sin(3 * time_s), 0.1 * np.sin(5 * time_s)]
    return Pose(FACING @ rotation_from_vector(turn), np.array([x, y, 1.8]))


def spin(time_s: float) -> Pose:
    """A mask that looks aside and rolls once a second."""
    roll = rotation_from_vector([0.0, 0.0, 2 * np.pi * time_s])
    return Pose(FACING @ rotation_from_vector([0.0, 0.3, 0.0]) @ roll, np.array([0.0, 0.0, 1.8]))


def measured(truth: Pose, rng: np.random.Generator, covariance: Array) -> Pose:
    error = np.linalg.cholesky(covariance) @ rng.standard_normal(6)
    turned = rotation_from_vector(error[:3]) @ truth.rotation
    return Pose(turned, truth.translation + error[3:])


def follow(
    motion: MotionFilter,
    path: Path,
    times: Array,
    seed: int = 0,
    visible: tuple[int, ...] = (0, 1, 2, 3, 4),
) -> None:
    rng = np.random.default_rng(seed)
    for time_s in times:
        covariance = measurement_covariance(path(time_s), visible)
        motion.update(time_s, measured(path(time_s), rng, covariance), covariance)


def distance_mm(predicted: PredictedPose, truth: Pose) -> float:
    pose = predicted.pose
    return float(
        displacements_mm(
            pose.rotation[None],
            pose.translation[None],
            truth.rotation[None],
            truth.translation[None],
        )[0]
    )


def errors_mm(
    path: Path,
    lead_s: float = LEAD_S,
    rate_hz: float = RATE_HZ,
    mode: str = "default",
    duration_s: float = 2.0,
    settled_s: float = 0.5,
) -> Array:
    motion = MotionFilter()
    found: list[float] = []
    times = np.arange(0, duration_s, 1 / rate_hz)
    rng = np.random.default_rng(0)
    for time_s in times:
        covariance = measurement_covariance(path(time_s))
        motion.update(time_s, measured(path(time_s), rng, covariance), covariance)
        if time_s >= settled_s:
            predicted = motion.predict(time_s + lead_s, mode)
            found.append(distance_mm(predicted, path(time_s + lead_s)))
    return np.array(found)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_nothing_is_predicted_before_the_first_measurement() -> None:
    with pytest.raises(ValueError, match="no measurement"):
        MotionFilter().predict(1.0)
    motion = MotionFilter()
    follow(motion, still, np.array([0.0]))
    motion.reset()
    with pytest.raises(ValueError, match="no measurement"):
        predict(motion.record(), 0.0)


def test_an_unknown_mode_is_refused() -> None:
    motion = MotionFilter()
    follow(motion, still, np.array([0.0]))
    with pytest.raises(ValueError, match="clairvoyant"):
        predict(motion.record(), 0.1, "clairvoyant")


def test_off_holds_the_latest_measured_pose() -> None:
    motion = MotionFilter()
    follow(motion, walk, np.arange(0, 0.5, 1 / RATE_HZ))
    record = motion.record()
    for lead in (0.0, 0.05, 10.0):
        predicted = predict(record, float(record["time_s"]) + lead, "off")
        np.testing.assert_array_equal(predicted.pose.translation, record["translation"])
        np.testing.assert_array_equal(predicted.pose.rotation, record["rotation"])


def test_the_record_alone_predicts_as_the_filter_does_and_survives_shared_memory() -> None:
    motion = MotionFilter()
    follow(motion, walk, np.arange(0, 0.5, 1 / RATE_HZ))
    record = motion.record()
    copied = np.frombuffer(record.tobytes(), MOTION)[0]
    here, there = motion.predict(0.54), predict(copied, 0.54)
    np.testing.assert_array_equal(here.pose.matrix(), there.pose.matrix())
    np.testing.assert_array_equal(here.covariance, there.covariance)
    assert record.tobytes() == motion.record().tobytes()


def test_a_record_is_a_copy() -> None:
    motion = MotionFilter()
    follow(motion, walk, np.arange(0, 0.5, 1 / RATE_HZ))
    record = motion.record()
    before = record.tobytes()
    follow(motion, walk, np.arange(0.5, 0.6, 1 / RATE_HZ))
    assert record.tobytes() == before


@pytest.mark.parametrize("rate_hz", [30, 60, 120, 240, 400])
@pytest.mark.parametrize("lead_s", [0.0, 0.02, 0.0425, 0.12])
def test_a_walk_is_foreseen_at_any_rate_and_lead(rate_hz: float, lead_s: float) -> None:
    foreseen = rms(errors_mm(walk, lead_s, rate_hz))
    held = rms(errors_mm(walk, lead_s, rate_hz, "off"))
    assert foreseen <= max(0.4 * held, 0.3)


def test_constant_velocity_is_followed_without_lag() -> None:
    def glide(time_s: float) -> Pose:
        return Pose(FACING, np.array([0.3 * time_s - 0.5, 0.0, 1.8]))

    assert rms(errors_mm(glide)) < 1.0
    assert rms(errors_mm(glide, mode="kalman")) < 1.0
    assert rms(errors_mm(glide, mode="off")) == pytest.approx(1e3 * 0.3 * LEAD_S, rel=0.05)


def test_a_spinning_mask_is_followed_through_all_angles() -> None:
    found = errors_mm(spin, duration_s=4.0)
    assert rms(found) < 2.0
    assert found.max() < 4.0
    assert rms(errors_mm(spin, mode="off")) > 20


@pytest.mark.parametrize("distance_m", [1.8, 2.4])
@pytest.mark.parametrize(("rate_hz", "lead_s"), [(120, 0.0425), (240, 0.0215)])
def test_a_still_mask_does_not_tremble(rate_hz: float, lead_s: float, distance_m: float) -> None:
    def rest(time_s: float) -> Pose:
        return Pose(still(time_s).rotation, np.array([0.0, 0.0, distance_m]))

    assert rms(errors_mm(rest, lead_s, rate_hz)) <= 0.3


def test_the_start_of_a_track_is_sane() -> None:
    motion = MotionFilter()
    follow(motion, walk, np.array([0.0]))
    assert distance_mm(motion.predict(LEAD_S), walk(0.0)) < 0.5  # no velocity from one pose
    found: list[float] = []
    rng = np.random.default_rng(1)
    motion.reset()
    for time_s in np.arange(0, 0.5, 1 / RATE_HZ):
        covariance = measurement_covariance(walk(time_s))
        motion.update(time_s, measured(walk(time_s), rng, covariance), covariance)
        predicted = motion.predict(time_s + LEAD_S)
        found.append(distance_mm(predicted, walk(time_s + LEAD_S)))
    held = 1e3 * np.linalg.norm(walk(LEAD_S).translation - walk(0.0).translation)
    assert max(found) < 1.2 * held  # never worse than no prediction
    assert max(found[12:]) < 0.25 * held  # right within 100 ms


def test_after_a_loss_the_prediction_does_not_fly_away() -> None:
    motion = MotionFilter()
    follow(motion, walk, np.arange(0, 1.0 + 1e-9, 1 / RATE_HZ))
    speed = 2 * np.pi * np.hypot(0.5 * 0.2, 1.9 * 0.04)
    last = motion.record()["translation"]
    for lead in (0.05, 0.15, 1.0, 60.0):
        predicted = motion.predict(1.0 + lead)
        assert np.isfinite(predicted.covariance).all()
        moved = float(np.linalg.norm((predicted.pose.translation - last)[:2]))
        assert moved < speed * min(lead, 0.4)


def test_an_uncertainty_grows_with_the_lead() -> None:
    motion = MotionFilter()
    follow(motion, walk, np.arange(0, 1.0, 1 / RATE_HZ))
    spreads = [np.diagonal(motion.predict(1.0 + lead).covariance) for lead in (0, 0.02, 0.1, 0.5)]
    for near, far in pairwise(spreads):
        assert (far > near).all()


def test_after_a_second_out_of_sight_the_picture_is_right_within_100_ms() -> None:
    motion = MotionFilter()
    follow(motion, walk, np.arange(0, 1.0, 1 / RATE_HZ))
    follow(motion, walk, np.arange(2.0, 2.1, 1 / RATE_HZ), seed=1)
    assert distance_mm(motion.predict(2.1 + LEAD_S), walk(2.1 + LEAD_S)) < 3.0


@pytest.mark.parametrize("gap_s", [0.1, 0.5, 1.5])
def test_a_gap_leaves_no_trace_after_100_ms(gap_s: float) -> None:
    motion, unbroken = MotionFilter(), MotionFilter()
    back = 1.0 + gap_s
    follow(motion, walk, np.arange(0, 1.0, 1 / RATE_HZ))
    follow(unbroken, walk, np.arange(0, back, 1 / RATE_HZ))
    for each in (motion, unbroken):
        follow(each, walk, np.arange(back, back + 0.1, 1 / RATE_HZ), seed=2)
    truth = walk(back + 0.1 + LEAD_S)
    usual = distance_mm(unbroken.predict(back + 0.1 + LEAD_S), truth)
    assert distance_mm(motion.predict(back + 0.1 + LEAD_S), truth) < usual + 2.0


def test_dropped_frames_cost_little() -> None:
    times = np.arange(0, 3.0, 1 / RATE_HZ)
    kept = times[np.random.default_rng(4).random(len(times)) > 0.3]
    motion = MotionFilter()
    found: list[float] = []
    rng = np.random.default_rng(0)
    for time_s in kept:
        covariance = measurement_covariance(walk(time_s))
        motion.update(time_s, measured(walk(time_s), rng, covariance), covariance)
        if time_s > 1:
            found.append(distance_mm(motion.predict(time_s + LEAD_S), walk(time_s + LEAD_S)))
    assert rms(np.array(found)) < 1.5 * rms(errors_mm(walk))


def test_a_late_or_repeated_measurement_is_ignored() -> None:
    motion = MotionFilter()
    follow(motion, walk, np.arange(0, 0.5, 1 / RATE_HZ))
    before = motion.record().tobytes()
    follow(motion, still, np.array([0.1]))
    follow(motion, still, np.array([float(motion.record()["time_s"])]))
    assert motion.record().tobytes() == before


def test_the_past_is_reached_back_to_a_little_and_then_held() -> None:
    motion = MotionFilter()
    follow(motion, walk, np.arange(0, 1.0 + 1e-9, 1 / RATE_HZ))
    assert distance_mm(motion.predict(1.0 - 0.005), walk(1.0 - 0.005)) < 0.5
    early, earlier = motion.predict(0.9), motion.predict(0.0)
    np.testing.assert_array_equal(early.pose.matrix(), earlier.pose.matrix())
    assert distance_mm(early, walk(1.0)) < 8.0


@pytest.mark.parametrize("visible", [(2, 3, 4), (0, 3, 4), (0, 2, 4)])
def test_two_hidden_leds_at_most_double_the_error_and_their_return_is_no_jump(
    visible: tuple[int, ...],
) -> None:
    motion = MotionFilter()
    seen: list[float] = []
    hidden: list[float] = []
    rng = np.random.default_rng(0)
    shown = None
    for time_s in np.arange(0, 3.0, 1 / RATE_HZ):
        few = 1.5 <= time_s < 2.0
        covariance = measurement_covariance(walk(time_s), visible if few else (0, 1, 2, 3, 4))
        motion.update(time_s, measured(walk(time_s), rng, covariance), covariance)
        predicted, truth = motion.predict(time_s + LEAD_S), walk(time_s + LEAD_S)
        offset = predicted.pose.translation - truth.translation
        if shown is not None:
            assert 1e3 * float(np.linalg.norm((offset - shown)[:2])) < 5.0
        if time_s > 1.0:
            (hidden if few else seen).append(distance_mm(predicted, truth))
            shown = offset
    assert rms(np.array(hidden)) <= 2 * rms(np.array(seen))


def test_an_attitude_too_vague_for_small_angles_does_no_harm() -> None:
    # Three LEDs can leave one direction open: radians of error, coupled to centimetres.
    motion = MotionFilter()
    rng = np.random.default_rng(0)
    follow(motion, walk, np.arange(0, 1.0, 1 / RATE_HZ))
    open_direction = np.array([1.0, 0.5, 0.0, 0.0, 0.02, 0.1])
    found: list[float] = []
    for time_s in np.arange(1.0, 1.5, 1 / RATE_HZ):
        covariance = measurement_covariance(walk(time_s), (0, 1, 2))
        covariance += np.outer(open_direction, open_direction)
        motion.update(time_s, measured(walk(time_s), rng, covariance), covariance)
        found.append(distance_mm(motion.predict(time_s + LEAD_S), walk(time_s + LEAD_S)))
    assert max(found) < 6.0


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_gives_a_rotation_and_a_covariance(mode: str) -> None:
    motion = MotionFilter()
    follow(motion, spin, np.arange(0, 1.0, 1 / RATE_HZ))
    predicted = predict(motion.record(), 1.05, mode)
    rotation = predicted.pose.rotation
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(predicted.covariance, predicted.covariance.T, atol=1e-12)
    assert (np.linalg.eigvalsh(predicted.covariance) > 0).all()


def test_the_rotation_stays_a_rotation_over_a_long_show() -> None:
    motion = MotionFilter()
    follow(motion, spin, np.arange(0, 20.0, 1 / 30))
    rotation = motion.record()["default"]["rotation"]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
