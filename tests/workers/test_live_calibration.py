"""Calibrating while the show is on: all workers on one board, an operator with eyes and keys."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_calibration_rig import LiveCart, cross_seen, operate, operator_of

from hypermask.bench.runs import scenario
from hypermask.blackboard import Record
from hypermask.calibration import storage
from hypermask.calibration.outcome import Outcome
from hypermask.calibration.positions import Position
from hypermask.errors import HypermaskError, UsageError
from hypermask.rehearsal.cart import true_screen
from hypermask.stage.marks import MOST_MARKS, marks_of, new_overlay
from hypermask.workers.background import OnTheSpot
from hypermask.workers.board import Board
from hypermask.workers.calibration_mode import CalibrationMode, Subject, calibration_modes
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World

FEW = [Position(0.15, -0.36, 2.0, 0.0, 0.0, 0, 0), Position(0.12, -0.25, 1.3, 0.2, -0.2, 0, 0)]
"""Positions at two distances, chosen already: finding the best ones takes a second."""


SMALL = ("projector.width=640", "projector.height=400", "projector.focal_px=220")


def maskbot(*more: str) -> Scenario:
    dots = ("character=dots", "projector.rate_hz=30", "performer.keys=[]")
    return scenario("maskbot", *dots, *(more or SMALL))


def cart(*more: str) -> Scenario:
    return scenario(
        "reference-cart",
        "performer.motion=still",
        "projector.rate_hz=30",
        "camera.rate_hz=60",
        *more,
    )


Live = Callable[..., LiveCart]


@pytest.fixture
def live(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Live]:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path))
    carts: list[LiveCart] = []

    def make(*arguments: Any, **named: Any) -> LiveCart:
        carts.append(LiveCart(*arguments, **named))
        return carts[-1]

    yield make
    for made in carts:
        made.close()


def test_a_screen_is_calibrated_in_the_running_show(live: Live) -> None:
    head = live(maskbot("projector.width=1280"))
    head.flip(5)
    assert head.rms_mm > 2.0
    head.begin()
    assert "mark 1 of 35" in head.lockstep.show.keeper.words
    operate(head, operator_of(head, 0.5), lambda: False)
    assert not head.active
    assert len(head.said("CAL-DONE")) == 1
    head.flip(20)
    assert len(head.said("CAL-TAKEN")) == 1
    assert head.rms_mm <= 0.5
    stored, warning = storage.load_current()
    assert (stored.name, warning) == ("0001-fixed.json", None)
    assert storage.load_progress() is None


def test_a_cart_is_calibrated_by_clicks_in_the_running_show(live: Live) -> None:
    mobile = live(cart(), positions=FEW)
    mobile.flip(10)
    assert mobile.rms_mm > 5.0
    mobile.begin()
    operate(mobile, operator_of(mobile, 1.0), lambda: False)
    assert len(mobile.said("CAL-DONE")) == 1
    mobile.flip(20)
    assert mobile.rms_mm <= 2.0
    stored, _ = storage.load_current()
    assert stored.method == "click"
    assert sum(len(placement.clicked) for placement in stored.placements) == 10


def test_the_papers_calibration_too(live: Live) -> None:
    mobile = live(cart(), positions=FEW[:1])
    mobile.flip(5)
    mobile.begin("calibrate-affine")
    operate(mobile, operator_of(mobile, 1.0), lambda: False)
    mobile.flip(20)
    assert len(mobile.said("CAL-TAKEN")) == 1
    assert storage.load_current()[0].method == "affine"
    assert mobile.rms_mm < 6.0


def test_meanwhile_the_face_is_dark_and_only_the_cross_is_lit(live: Live) -> None:
    head = live(maskbot())
    assert (head.flip(3).shown.max(axis=2) > 40).sum() > 1000
    head.begin()
    flip = head.flip(2)
    x, y = cross_seen(flip)
    assert (x, y) == pytest.approx(head.session.view().cross_hair, abs=0.1)
    rows, columns = np.nonzero(flip.shown.max(axis=2) > 10)
    assert np.abs(columns - x).max() < 25
    assert np.abs(rows - y).max() < 25


def test_points_that_are_done_stay_lit_faintly(live: Live) -> None:
    head = live(maskbot())
    head.begin()
    for _ in range(3):
        head.press("enter")
    flip = head.flip(2)
    level = flip.shown.max(axis=2).astype(int)
    for x, y in head.session.pixels[:3]:
        near = level[int(y) - 2 : int(y) + 3, int(x) - 2 : int(x) + 3]
        assert 30 < near.max() < 120
    assert cross_seen(flip) == pytest.approx(head.session.view().cross_hair, abs=0.1)


def test_left_early_the_show_and_the_old_calibration_are_back(live: Live) -> None:
    exact = true_screen(World(maskbot()))
    head = live(maskbot(), exact)
    head.begin()
    head.press("6")
    head.press("enter")
    head.lockstep.show.keeper.cancel(head.cart.clock.now())
    assert (head.flip(3).shown.max(axis=2) > 40).sum() > 1000
    assert head.rms_mm <= 0.1
    assert storage.history() == []
    head.press("5")  # the keys call cues again
    assert head.said("CUE") == ["Key 5: happiness"]


def test_holding_numlock_begins_and_leaves_it(live: Live) -> None:
    head = live(maskbot(*SMALL, "projector.rate_hz=5"))
    head.flip(2)
    for wanted in (True, False):
        head.cart.keypad.press("numlock", held_s=2.5)
        head.flip(15)
        assert head.active is not wanted  # not long enough
        head.cart.keypad.press("numlock", held_s=3.1)
        head.flip(17)
        assert head.active is wanted


def test_a_power_cut_in_the_middle_keeps_the_last_good_and_what_was_done(live: Live) -> None:
    kept = true_screen(World(maskbot()))
    storage.save(Outcome(kept, None, ()), "fixed")
    first = live(maskbot(), kept)
    first.begin()
    operate(first, operator_of(first, 0.5), lambda: len(first.session.order) == 6)
    done = first.session.pixels[:6].copy()
    # Here the power goes: nothing is told to anybody. A new board, new workers:
    again = live(maskbot(), kept)
    assert storage.load_current()[0].name == "0001-fixed.json"
    again.flip(3)
    assert again.rms_mm <= 0.1
    again.begin()
    assert "goes on where it was left" in again.lockstep.show.keeper.words
    assert np.array_equal(again.session.pixels[:6], done)
    assert again.session.point == 6


def test_what_was_done_can_be_thrown_away_by_pressing_slash_twice(live: Live) -> None:
    head = live(maskbot())
    head.begin()
    head.press("enter")
    head.press("enter")
    head.press("slash")
    assert "slash again" in head.lockstep.show.keeper.words
    head.press("enter")  # something else: not thrown away
    head.press("slash")
    assert head.session.point == 3
    head.press("slash")
    assert head.session.point == 0
    assert storage.load_progress() is None


def test_a_damaged_interrupted_session_begins_anew_and_says_so(live: Live) -> None:
    head = live(maskbot())
    storage.save_progress({"method": "fixed", "points_m": "?"})
    head.begin()
    assert head.session.point == 0
    (storage.folder() / storage.PROGRESS).write_text("{")
    head.lockstep.show.keeper.cancel(head.cart.clock.now())
    head.begin()
    assert head.session.point == 0
    assert len(head.said("CAL-READ")) == 1


def test_points_that_contradict_each_other_store_nothing(live: Live) -> None:
    head = live(maskbot())
    head.begin()
    rng = np.random.default_rng(1)
    for _ in range(12):
        head.session._put(*rng.uniform([300, 100], [900, 700]))
        head.session.key("enter", 0.0)
    head.press("star")
    assert "CAL-CLICKS" in head.lockstep.show.keeper.words
    head.press("backspace")
    assert head.active
    assert storage.history() == []


def test_a_full_disk_ends_it_with_one_message_and_the_show_goes_on(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = live(maskbot())
    head.begin()

    def full(*arguments: object) -> None:
        raise HypermaskError("DISK-WRITE", "there is no room", "Free some.")

    monkeypatch.setattr(storage, "write_atomically", full)
    head.press("enter")
    assert not head.active
    assert len(head.said("DISK-WRITE")) == 1
    assert (head.flip(3).shown.max(axis=2) > 40).sum() > 1000


def test_the_face_comes_back_when_the_show_worker_dies_in_the_middle(live: Live) -> None:
    head = live(maskbot())
    head.begin()
    head.lockstep.show.step = lambda timeout_s=0.0: False  # type: ignore[method-assign]
    assert (head.flip(15).shown.max(axis=2) > 40).sum() < 1000
    assert (head.flip(25).shown.max(axis=2) > 40).sum() > 1000


def test_a_mask_that_is_not_seen_is_said_and_a_moving_one_keeps_its_clicks(live: Live) -> None:
    hidden = 'faults=[{kind="leds_hidden", from_s=0.0, to_s=2.0}]'
    mobile = live(cart(hidden), positions=FEW)
    mobile.flip(5)
    mobile.begin()
    assert "does not see the mask" in mobile.lockstep.show.keeper.words
    mobile.press("enter")
    assert mobile.session.phase.value == "place"
    mobile.flip(80)
    mobile.press("enter")
    assert mobile.session.phase.value == "click"


def modes(subject: Subject, method: str = "calibrate") -> Any:
    report = lambda time_s, code, text: None  # noqa: E731
    return calibration_modes(subject, Board.local(), report, OnTheSpot())[method]


def test_a_machine_offers_what_it_can_do() -> None:
    world = World(maskbot())
    nothing: Any = lambda: None  # noqa: E731
    report: Any = nothing
    fixed = Subject("fixed", lambda: world.mask, None, nothing)
    mobile = Subject("procam", lambda: world.mask, nothing)
    blind = Subject("procam", lambda: world.mask)
    offers = [
        sorted(calibration_modes(subject, Board.local(), report))
        for subject in (fixed, mobile, blind)
    ]
    assert offers == [
        ["calibrate", "calibrate-fixed"],
        ["calibrate", "calibrate-affine", "calibrate-click", "calibrate-projective"],
        ["calibrate"],
    ]
    with pytest.raises(UsageError) as caught:
        modes(blind)()
    assert caught.value.code == "CAL-CAMERA"


class Slow:
    """A background whose work is done when the test says so."""

    def __init__(self) -> None:
        self.waiting: list[Callable[[], None]] = []

    @property
    def busy(self) -> bool:
        return bool(self.waiting)

    def start(self, action: Callable[[], None]) -> None:
        self.waiting.append(action)

    def work(self) -> None:
        self.waiting.pop(0)()


def test_what_takes_long_holds_up_no_turn_of_the_show(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path))
    world, slow, board = World(maskbot()), Slow(), Board.local()
    from hypermask.rehearsal.cart import nominal_screen

    subject = Subject("fixed", lambda: world.mask, None, lambda: nominal_screen(world))
    made = calibration_modes(subject, board, lambda *told: None, slow)["calibrate"]()
    assert isinstance(made, CalibrationMode)
    made.begin(10.0)
    overlay = board.overlay.latest()
    assert overlay is not None  # already dark
    assert bool(overlay["on"])
    assert "in a moment" in made.words()
    for time_s in (10.1, 10.5, 11.2):
        assert made.step(time_s)
        made.press("enter", time_s)
    overlay = board.overlay.latest()
    assert overlay is not None
    assert float(overlay["time_s"]) == 11.2  # and it stays dark
    slow.work()
    assert made.course is not None
    made.step(11.3)
    while slow.busy:  # the keys that waited, in their turn
        slow.work()
        made.step(11.4)
    assert made.course.session.point == 3  # type: ignore[attr-defined]


def test_an_overlay_has_room_for_all_marks_and_takes_no_nonsense() -> None:
    record: Record = new_overlay(1.0, True, None, np.full((100, 2), 7.0))
    assert len(marks_of(record)) == MOST_MARKS
    record = new_overlay(1.0, True, (1.0, 2.0), [[np.nan, 1], [3, 4]])
    assert marks_of(record).tolist() == [[3, 4]]
