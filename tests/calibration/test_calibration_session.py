"""The operator's way through a calibration: keys and tracked poses in, pictures and words out."""

from __future__ import annotations

import json

import numpy as np
import pytest
from calibration_rig import MASK, Rig, reference_truth, rms, true_errors_mm, volume

from hypermask.calibration.parameters import ProCam
from hypermask.calibration.planar import Planar
from hypermask.calibration.rehearsed import rehearse
from hypermask.calibration.session import LEAST_FRAMES, STEPS_PX, Phase, Session, planned_positions
from hypermask.errors import DataError
from hypermask.geometry import Pose

POSITIONS = planned_positions(Rig().cart, "click")
BY_DISTANCE = sorted(POSITIONS, key=lambda p: p.distance_m)


def started(seed: int = 0, **options: object) -> tuple[Rig, Session]:
    """A session whose first position is set up, seen, and ready for the first click."""
    rig = Rig(seed=seed, **options)  # type: ignore[arg-type]
    session = rig.session(positions=POSITIONS)
    set_up(rig, session)
    return rig, session


def set_up(rig: Rig, session: Session) -> None:
    target = session.view().target
    assert target is not None
    rig.put(target)
    watch(rig, session, 1)
    session.key("enter", rig.time_s)
    watch(rig, session, LEAST_FRAMES + 4)


def watch(rig: Rig, session: Session, frames: int) -> None:
    for _ in range(frames):
        session.sighting(rig.sighting(), rig.time_s)


def press(rig: Rig, session: Session, *keys: str) -> None:
    for key in keys:
        session.key(key, rig.time_s)


def click(rig: Rig, session: Session) -> None:
    """Let the operator aim and accept one LED."""
    for _ in range(200):
        view = session.view()
        assert view.cross_hair is not None and view.led is not None
        key = rig.operator.key(view.cross_hair, view.led)
        session.key(key, rig.time_s)
        if key in ("enter", "0"):
            return
    raise AssertionError("the operator came to no end")


def click_all(rig: Rig, session: Session) -> None:
    while session.phase is Phase.CLICK:
        click(rig, session)


def test_it_begins_by_saying_where_to_put_the_mask() -> None:
    session = Rig().session(positions=POSITIONS)
    view = session.view()
    assert view.phase is Phase.PLACE
    assert view.cross_hair is None
    assert view.target == POSITIONS[0]
    assert view.lines[0] == f"Position 1 of 6: mask {POSITIONS[0]}"
    assert "does not see" in view.lines[1]


def test_it_says_which_way_to_bring_the_mask() -> None:
    rig = Rig()
    session = rig.session(positions=POSITIONS)
    rig.pose = Pose(
        POSITIONS[0].camera_from_mask().rotation,
        POSITIONS[0].camera_from_mask().translation + np.array([0.2, -0.15, 0.5]),
    )
    watch(rig, session, 1)
    hint = session.view().lines[1]
    assert hint == "Move it 50 cm nearer, 20 cm to the left, 15 cm down"


def test_it_does_not_begin_while_the_mask_is_unseen() -> None:
    session = Rig().session(positions=POSITIONS)
    session.key("enter", 0.1)
    assert session.phase is Phase.PLACE
    assert "does not see the mask" in session.view().lines[0]


def test_arrows_nudge_by_the_step_and_five_changes_it() -> None:
    rig, session = started()
    x, y = session.view().cross_hair or (0, 0)
    assert session.view().step_px == STEPS_PX[0]
    press(rig, session, "6")
    assert session.view().cross_hair == (x + 32, y)
    press(rig, session, "5", "2", "2")
    assert session.view().cross_hair == (x + 32, y + 16)
    press(rig, session, "5", "4", "8")
    assert session.view().cross_hair == (x + 31, y + 15)
    press(rig, session, "5")
    assert session.view().step_px == 32


def test_the_cross_hair_stays_in_the_picture() -> None:
    rig, session = started()
    press(rig, session, *["4"] * 100, *["8"] * 100)
    assert session.view().cross_hair == (0, 0)
    press(rig, session, *["6"] * 100, *["2"] * 100)
    assert session.view().cross_hair == (1279, 719)


def test_after_a_position_the_cross_hair_starts_beside_the_led() -> None:
    rig, session = started(operator_px=0.3)
    click_all(rig, session)
    set_up(rig, session)
    view = session.view()
    assert view.cross_hair is not None and view.led is not None
    true = rig.truth.project(rig.pose.apply(MASK.leds[view.led]))
    assert np.linalg.norm(true - view.cross_hair) < 12


def test_a_click_is_refused_until_the_mask_stood_still() -> None:
    rig = Rig()
    session = rig.session(positions=POSITIONS)
    rig.put(POSITIONS[0])
    watch(rig, session, 1)
    press(rig, session, "enter", "enter")
    assert session.view().led == 0
    assert session.view().lines[0] == "Hold the mask still, then press enter again."
    watch(rig, session, LEAST_FRAMES)
    press(rig, session, "enter")
    assert session.view().led == 1


def test_a_click_is_refused_while_the_mask_is_unseen() -> None:
    rig, session = started()
    session.sighting(None, rig.time_s + 1.0)
    session.key("enter", rig.time_s + 1.0)
    assert session.view().led == 0
    assert "not accepted" in session.view().lines[0]


def test_backspace_takes_the_last_click_back() -> None:
    rig, session = started()
    before = session.view().cross_hair
    press(rig, session, "6", "enter")
    assert session.view().led == 1
    press(rig, session, "backspace")
    view = session.view()
    assert view.led == 0
    assert before is not None and view.cross_hair == (before[0] + 32, before[1])
    press(rig, session, "backspace")
    assert session.phase is Phase.PLACE


def test_a_whole_position_is_undone_only_when_asked_twice() -> None:
    rig, session = started()
    click_all(rig, session)
    assert session.phase is Phase.PLACE and len(session.placements) == 1
    press(rig, session, "backspace")
    assert len(session.placements) == 1
    assert session.view().lines[0] == "Press backspace again to do position 1 anew."
    press(rig, session, "backspace")
    assert session.placements == []
    assert session.view().target == POSITIONS[0]


def test_zero_skips_an_led_or_a_position() -> None:
    rig, session = started()
    press(rig, session, "0")
    assert session.view().led == 1
    click_all(rig, session)
    assert list(session.placements[0].clicked) == [1, 2, 3, 4]
    press(rig, session, "0")
    assert session.view().lines[0].endswith("Position skipped.") and len(session.ends) == 2


def test_an_unknown_key_changes_nothing() -> None:
    rig, session = started()
    before = session.view()
    press(rig, session, "numlock", "slash", "dot")
    assert session.view() == before


def test_a_moved_mask_is_noticed_and_the_clicks_made_are_kept() -> None:
    rig, session = started()
    click(rig, session)
    click(rig, session)
    there = rig.pose
    rig.pose = Pose(there.rotation, there.translation + np.array([0.006, 0.0, 0.0]))
    watch(rig, session, 30)
    assert "moved by 6 mm" in session.view().lines[0]
    assert session.view().led == 2
    click_all(rig, session)
    first, second = session.placements
    assert list(first.clicked) == [0, 1] and list(second.clicked) == [2, 3, 4]
    np.testing.assert_allclose(first.pose.translation[:2], there.translation[:2], atol=5e-4)
    np.testing.assert_allclose(second.pose.translation[:2], rig.pose.translation[:2], atol=5e-4)


def test_a_single_stray_frame_is_no_movement() -> None:
    rig, session = started()
    click(rig, session)
    there = rig.pose
    rig.pose = Pose(there.rotation, there.translation + np.array([0.05, 0.0, 0.0]))
    watch(rig, session, 2)
    rig.pose = there
    watch(rig, session, 10)
    assert session.view().led == 1
    assert not any("moved" in line for line in session.view().lines)


def test_tracking_noise_is_no_movement() -> None:
    rig, session = started(noise_px=0.3)
    watch(rig, session, 500)
    assert not any("moved" in line for line in session.view().lines)


def test_the_pose_is_averaged_over_the_time_of_the_still_mask() -> None:
    rig, session = started(noise_px=0.2)
    watch(rig, session, 200)
    click_all(rig, session)
    averaged = session.placements[0]
    frame = rig.sighting()
    assert np.trace(averaged.covariance) < 0.15 * np.trace(frame.covariance)
    off = np.linalg.norm(averaged.pose.translation - rig.pose.translation)
    assert off < 3 * np.sqrt(np.trace(averaged.covariance[3:, 3:]))


def test_the_whole_session_ends_with_a_projector_and_its_quality() -> None:
    rig = Rig(seed=3)
    views = []
    result = rehearse(rig.session(positions=POSITIONS), rig.measure, rig.operator.key, views.append)
    procam = result.outcome.calibration
    assert isinstance(procam, ProCam)
    assert rms(true_errors_mm(procam, rig.truth, volume())) < 1.0
    assert [p.distance_m for p in result.positions] == [p.distance_m for p in POSITIONS]
    assert views[-1].lines[0] == "Calibration done."
    assert "mm expected" in views[-1].lines[1]
    assert sum(v.phase is Phase.CLICK for v in views) == result.key_presses - len(POSITIONS) - 1


def test_the_same_session_twice_is_the_same_to_the_last_digit() -> None:
    outcomes = []
    for _ in range(2):
        rig = Rig(seed=4)
        outcomes.append(rehearse(rig.session(), rig.measure, rig.operator.key).outcome)
    first, second = (o.calibration for o in outcomes)
    assert isinstance(first, ProCam) and isinstance(second, ProCam)
    np.testing.assert_array_equal(first.projector.matrix, second.projector.matrix)
    assert outcomes[0].expected_mm == outcomes[1].expected_mm


def test_plus_adds_the_position_that_helps_most() -> None:
    rig = Rig(seed=5)
    session = rig.session(positions=BY_DISTANCE[:4:2])
    plain = rehearse(
        Rig(seed=5).session(positions=BY_DISTANCE[:4:2]), rig.measure, rig.operator.key
    )
    rig = Rig(seed=5)
    more = rehearse(session, rig.measure, rig.operator.key, extra_positions=2)
    assert len(more.positions) == 4
    assert more.outcome.expected_mm < 0.7 * plain.outcome.expected_mm


def test_a_session_at_one_distance_is_refused_and_offers_another_distance() -> None:
    rig = Rig(seed=6)
    session = rig.session(positions=BY_DISTANCE[2:4])
    for _ in range(2):
        set_up(rig, session)
        click_all(rig, session)
    assert session.phase is Phase.REVIEW
    assert session.outcome is None
    assert session.view().lines[0].startswith("CAL-DEPTH: ")
    press(rig, session, "enter")
    target = session.view().target
    assert target is not None and abs(target.distance_m - 1.8) > 0.5
    set_up(rig, session)
    click_all(rig, session)
    assert session.outcome is not None
    press(rig, session, "enter")
    assert session.phase is Phase.DONE


def test_star_ends_the_clicking_early() -> None:
    rig, session = started()
    for _ in range(3):
        click_all(rig, session)
        set_up(rig, session)
    click(rig, session)
    press(rig, session, "star")
    assert session.phase is Phase.REVIEW
    assert session.outcome is not None
    assert sum(len(p.clicked) for p in session.placements) == 16


def test_a_misplaced_click_is_named_in_the_review() -> None:
    rig = Rig(seed=7)
    session = rig.session(positions=POSITIONS)
    while session.phase is Phase.PLACE:
        set_up(rig, session)
        if len(session.ends) == 2:
            click(rig, session)
            press(rig, session, *["6"] * 15, "enter")
        click_all(rig, session)
    assert session.outcome is not None
    lines = session.view().lines
    assert any(line.startswith("left out: position 3, upper right LED: ") for line in lines)


def test_an_interrupted_session_goes_on_where_it_was() -> None:
    rig, session = started(seed=8)
    click_all(rig, session)
    set_up(rig, session)
    click(rig, session)
    click(rig, session)
    saved = json.loads(json.dumps(session.snapshot()))
    resumed = Session.resume(rig.cart, saved)
    assert resumed.phase is Phase.PLACE
    assert resumed.view().lines[0].startswith("Position 2 of 6: ")
    assert [len(p.clicked) for p in resumed.placements] == [5, 2]
    set_up(rig, resumed)
    assert resumed.view().led == 2
    while resumed.phase is not Phase.REVIEW:
        click_all(rig, resumed)
        if resumed.phase is Phase.PLACE:
            set_up(rig, resumed)
    assert sum(len(p.clicked) for p in resumed.placements) == 30
    assert resumed.outcome is not None and resumed.outcome.expected_mm < 0.7


def test_a_damaged_interrupted_session_is_refused_clearly() -> None:
    rig, session = started()
    saved = session.snapshot()
    for damage in ({"method": "guess"}, {"positions": [{}]}, {"placements": [{"pose": 1}]}):
        with pytest.raises(DataError) as caught:
            Session.resume(rig.cart, {**saved, **damage})
        assert caught.value.code == "CAL-READ"


@pytest.mark.parametrize("method", ["affine", "projective"])
def test_the_papers_session_is_four_clicks_at_one_pose(method: str) -> None:
    rig = Rig(reference_truth(0.03), seed=9)
    session = rig.session(method)
    assert len(session.positions) == 1 and session.positions[0].distance_m == 1.8
    set_up(rig, session)
    leds = []
    while session.phase is Phase.CLICK:
        leds.append(session.view().led)
        click(rig, session)
    assert leds == [0, 1, 2, 3]
    assert session.outcome is not None
    planar = session.outcome.calibration
    assert isinstance(planar, Planar)
    assert planar.distance_m == pytest.approx(rig.pose.translation[2], abs=0.01)
    assert any(" mm expected at " in line for line in session.view().lines)
    press(rig, session, "enter")
    assert session.phase is Phase.DONE


def test_a_mask_that_moved_during_the_papers_four_points_starts_them_anew() -> None:
    """One map needs one pose."""
    rig = Rig(seed=10)
    session = rig.session("affine")
    set_up(rig, session)
    click(rig, session)
    rig.pose = Pose(rig.pose.rotation, rig.pose.translation + np.array([0.0, 0.01, 0.0]))
    watch(rig, session, 30)
    assert session.view().led == 0
    assert "four corners again" in session.view().lines[0]


def test_a_rehearsal_without_a_mask_fails_clearly() -> None:
    rig = Rig()
    with pytest.raises(DataError) as caught:
        rehearse(rig.session(positions=POSITIONS), lambda _: [], rig.operator.key)
    assert caught.value.code == "CAL-UNSEEN"


def test_a_rehearsal_at_one_distance_fails_as_the_session_would() -> None:
    rig = Rig()
    with pytest.raises(DataError) as caught:
        rehearse(rig.session(positions=BY_DISTANCE[2:4]), rig.measure, rig.operator.key)
    assert caught.value.code == "CAL-DEPTH"
