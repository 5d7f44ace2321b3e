"""The head follows its master, stops without one, parks, and survives its unit."""

import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest

from hypermask.blackboard import Record
from hypermask.neck.record import BEAT_S, beat, new_neck, order
from hypermask.neck.settings import NeckSettings
from hypermask.workers.board import Board
from hypermask.workers.pantilt import PERIOD_S, PanTiltWorker
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.pantilt.ptu import DirectedPerceptionPtu, PtuSettings
from hypermask_drivers.pantilt.serial_line import SerialLine
from hypermask_sim.emulators.ptu import PtuData, PtuUnit
from hypermask_sim.emulators.ptu_line import PtuLine


class Stage:
    """The worker, the driver, a pty, and an emulated unit that answers at once."""

    def __init__(
        self, folder: Path, settings: NeckSettings | None = None, alone: bool = False
    ) -> None:
        self.clock = VirtualClock(100.0)
        self.unit = PtuUnit(PtuData(baud=None, homing_s=2.0))
        self.line = PtuLine(self.unit, self.clock, folder / "ptu")
        self.line.plug()
        wiring = PtuSettings(device=str(folder / "ptu"), silence_s=0.15)
        self.connects = 0
        self.ptu = DirectedPerceptionPtu(wiring, self.clock, self._connect)
        self.board = Board.local()
        self.told: list[str] = []
        self.worker = PanTiltWorker(self.ptu, self.board, self.clock, self._report, settings, alone)
        self.neck: Record = new_neck(self.clock.now())
        self.master = True
        self.places: list[tuple[float, float, float]] = []

    def _connect(self, path: str, baud: int) -> SerialLine:
        self.connects += 1
        return self.line.connect(path, baud)

    def restart(self, alone: bool = False) -> None:
        """Another process in the place of this one, which was killed."""
        assert self.ptu._line is not None
        self.ptu._line.close()
        self.ptu = DirectedPerceptionPtu(self.ptu.settings, self.clock, self._connect)
        self.worker = PanTiltWorker(
            self.ptu, self.board, self.clock, self._report, self.worker.settings, alone
        )

    def _report(self, time_s: float, code: str, text: str) -> None:
        self.told.append(code)

    def run(self, seconds: float, working: bool = True) -> None:
        """Both processes for so long; the master's word is at most a beat old."""
        end_s = self.clock.now() + seconds
        while self.clock.now() < end_s - 1e-9:
            if self.master and self.clock.now() - float(self.neck["time_s"]) >= BEAT_S - 1e-9:
                self.neck = beat(self.neck, self.clock.now())
            if self.master:
                self.board.neck.publish(self.neck)
            if working:
                self.worker.step()
            self.line.catch_up()
            self.clock.sleep_until(self.clock.now() + PERIOD_S)
            self.line.settle()
            self.places.append((self.clock.now(), *self.axes()))

    def order(self, gesture: str, **changes: object) -> None:
        self.neck = order(self.neck, self.clock.now(), gesture, **changes)  # type: ignore[arg-type]

    def axes(self) -> tuple[float, float]:
        """Where the unit really is, rad."""
        step = 185.1428 / 3600 * 0.017453292519943295
        now = self.clock.now()
        return self.unit.axes["P"].exact(now) * step, self.unit.axes["T"].exact(now) * step

    @property
    def head(self) -> Record:
        record = self.board.head.latest()
        assert record is not None
        return record

    @property
    def state(self) -> str:
        return bytes(self.head["state"].item()).decode()


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    stage = Stage(tmp_path)
    yield stage
    stage.worker.stop()
    stage.line.close()


@pytest.fixture
def homed(stage: Stage) -> Stage:
    stage.run(3.0)
    assert stage.state == "still" and stage.head["homed"]
    return stage


def test_it_homes_first(stage: Stage) -> None:
    stage.run(0.5)
    assert stage.state == "homing" and not stage.head["homed"]
    stage.run(2.5)
    assert stage.state == "still" and stage.axes() == (0, 0)


def test_it_does_not_home_without_a_master(stage: Stage) -> None:
    stage.master = False
    stage.run(3.0)
    assert stage.state == "halted" and "R" not in stage.unit.heard


def test_alone_it_homes_and_parks(tmp_path: Path) -> None:
    stage = Stage(tmp_path, NeckSettings(park_deg=(20.0, 10.0)), alone=True)
    stage.master = False
    stage.run(12.0)
    assert stage.state == "parked" and stage.unit.heard.count("R") == 1
    assert stage.axes() == pytest.approx((0.349, 0.1745), abs=1e-3)
    stage.worker.stop()
    stage.line.close()


@pytest.mark.parametrize("alone", [True, False])
def test_a_unit_that_kept_its_zero_is_not_homed_by_the_next_process(
    homed: Stage, alone: bool
) -> None:
    homed.order("look", look=(0.5, 0.0))
    homed.run(2.0)
    homed.master = not alone
    homed.restart(alone)
    homed.run(8.0)
    assert homed.unit.heard.count("R") == 1
    assert homed.axes()[0] == pytest.approx(0.0 if alone else 0.5, abs=1e-3)


def test_a_reset_that_finds_no_zero_is_told_once_and_tried_again(stage: Stage) -> None:
    stage.unit.jam()
    stage.run(3.0)
    assert stage.state == "halted" and stage.told == ["NECK-HOME"]
    stage.unit.jam()
    stage.run(10.0)
    assert stage.unit.heard.count("R") == 2 and stage.told == ["NECK-HOME"]
    stage.run(16.0)
    assert stage.state == "still" and stage.head["homed"]
    assert stage.unit.heard.count("R") == 3 and stage.told == ["NECK-HOME"]


def test_it_looks_where_it_is_told(homed: Stage) -> None:
    homed.order("look", look=(0.5, -0.2))
    homed.run(3.0)
    assert homed.axes() == pytest.approx((0.5, -0.2), abs=1e-3)
    assert homed.state == "still"
    assert (float(homed.head["pan_rad"]), float(homed.head["tilt_rad"])) == pytest.approx(
        (0.5, -0.2), abs=1e-3
    )


def test_a_nod_is_seen_at_the_head(homed: Stage) -> None:
    homed.places.clear()
    homed.order("nod", amplitude_rad=0.2, cycles=1, vigour=0.5)
    homed.run(4.0)
    tilts = [tilt for _, _, tilt in homed.places]
    assert min(tilts) == pytest.approx(-0.2, abs=0.03)
    assert max(tilts) == pytest.approx(0.07, abs=0.03)
    assert tilts[-1] == pytest.approx(0.0, abs=1e-3)


def test_soft_limits_hold_at_the_head(tmp_path: Path) -> None:
    stage = Stage(tmp_path, NeckSettings(pan_deg=(-10, 10), tilt_deg=(-5, 5)))
    stage.run(3.0)
    stage.order("look", look=(2.0, 1.0))
    stage.run(3.0)
    assert stage.axes() == pytest.approx((0.1745, 0.0873), abs=1e-3)
    stage.line.close()


def test_the_head_halts_when_the_show_is_silent_and_parks_later(homed: Stage) -> None:
    homed.order("look", look=(0.9, 0.3))
    homed.run(0.4)
    silent_from = homed.clock.now()
    homed.master = False
    homed.places.clear()
    homed.run(2.0)
    moved = [
        time_s for (_, *a), (time_s, *b) in itertools.pairwise(homed.places)
        if max(abs(x - y) for x, y in zip(a, b, strict=True)) > 1e-6
    ]  # fmt: skip
    assert max(moved, default=silent_from) - silent_from <= 0.5 + 2 * PERIOD_S
    assert homed.state == "halted" and homed.head["master_silent"]
    homed.run(6.0)
    assert homed.state == "parked" and homed.axes() == pytest.approx((0, 0), abs=1e-3)
    assert homed.told == ["NECK-SILENT"]


def test_a_show_that_is_back_is_followed_without_repeating_old_gestures(homed: Stage) -> None:
    homed.order("shake", look=(0.3, 0.0), amplitude_rad=0.4)
    homed.run(0.5)
    homed.master = False
    homed.run(8.0)
    homed.master = True
    homed.places.clear()
    homed.run(3.0)
    assert homed.told == ["NECK-SILENT", "NECK-BACK"]
    assert homed.axes()[0] == pytest.approx(0.3, abs=1e-3)
    assert max(pan for _, pan, _ in homed.places) < 0.31


@pytest.mark.parametrize("gesture", ["look", "shake"])
def test_a_worker_that_dies_leaves_a_head_that_stops_by_itself(homed: Stage, gesture: str) -> None:
    """Nothing is sent any more: the unit ends its last short move."""
    homed.order(gesture, look=(0.9, 0.3), vigour=1.0)
    homed.run(0.4)
    died = homed.clock.now()
    before = homed.axes()
    homed.places.clear()
    homed.run(2.0, working=False)
    assert homed.axes() != before
    after = [place for time_s, *place in homed.places if time_s >= died + 0.4]
    assert all(place == pytest.approx(after[0], abs=1e-6) for place in after)


def test_a_worker_that_was_stopped_for_a_while_halts_before_it_goes_on(homed: Stage) -> None:
    homed.order("look", look=(0.9, 0.0), vigour=0.3)
    homed.run(0.5)
    homed.run(2.0, working=False)
    homed.run(0.05)
    assert homed.state == "halted" and homed.unit.heard[-3:].count("H") == 1
    homed.run(5.0)
    assert homed.axes()[0] == pytest.approx(0.9, abs=1e-3)


def test_unplugged_and_plugged_in_again_it_goes_on_without_homing(homed: Stage) -> None:
    homed.order("look", look=(0.6, 0.0))
    homed.run(0.3)
    homed.line.unplug()
    homed.run(1.0)
    assert homed.state == "absent" and not homed.head["ready"]
    resets = homed.unit.heard.count("R")
    homed.line.plug()
    homed.run(4.0)
    assert homed.told == ["PTU-LOST", "PANTILT-BACK"]
    assert int(homed.head["losses"]) == 1 and homed.unit.heard.count("R") == resets
    assert homed.axes()[0] == pytest.approx(0.6, abs=1e-3)


def test_after_a_power_cycle_it_homes_again(homed: Stage) -> None:
    homed.order("look", look=(0.6, 0.0))
    homed.run(2.0)
    homed.line.unplug()
    homed.run(0.2)
    homed.unit.power_cycle(homed.clock.now())
    homed.line.plug()
    resets = homed.unit.heard.count("R")
    homed.run(9.0)
    assert homed.unit.heard.count("R") == resets + 1
    assert homed.axes()[0] == pytest.approx(0.6, abs=1e-3)


def test_a_limit_hit_is_told_and_homed_away(homed: Stage) -> None:
    homed.unit.intrude("!T", homed.clock.now())
    homed.run(4.0)
    assert homed.told == ["NECK-LIMIT"]
    assert homed.head["homed"] and int(homed.head["limit_hits"]) == 1


def test_a_silent_unit_is_asked_for_every_second(homed: Stage) -> None:
    homed.unit.fall_silent(until_s=homed.clock.now() + 2.0)
    homed.run(5.0)
    assert homed.told == ["PTU-SILENT", "PANTILT-BACK"]
    assert homed.state == "still"


def test_stopping_halts(homed: Stage) -> None:
    homed.order("look", look=(0.9, 0.0))
    homed.run(0.5)
    homed.worker.stop()
    homed.line.catch_up()
    assert homed.unit.heard[-1] == "H"


def test_stopping_does_not_seek_a_unit_that_is_lost(homed: Stage) -> None:
    """It would take seconds, and the service has less than one to end."""
    homed.unit.fall_silent(until_s=1e9)
    homed.run(3.5)
    before = homed.connects
    homed.clock.sleep_until(homed.clock.now() + 2.0)
    homed.worker.stop()
    assert homed.connects == before
