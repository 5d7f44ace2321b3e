"""The pan-tilt driver over a real pseudo-terminal, and everything that goes wrong on it."""

import math
import termios
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost
from hypermask_drivers.pantilt.ptu import DirectedPerceptionPtu, PtuSettings
from hypermask_drivers.pantilt.ptu_protocol import Answer
from hypermask_drivers.pantilt.serial_line import SerialLine
from hypermask_sim.emulators.ptu import PtuData, PtuUnit
from hypermask_sim.emulators.ptu_line import PtuLine

STEP_RAD = math.radians(185.1428 / 3600)


class Bench:
    def __init__(self, folder: Path, **settings: object) -> None:
        self.clock = VirtualClock(100.0)
        self.unit = PtuUnit(PtuData(baud=None))
        self.line = PtuLine(self.unit, self.clock, folder / "ptu")
        self.line.plug()
        chosen = PtuSettings.model_validate(
            {"device": str(folder / "ptu"), "silence_s": 0.15, **settings}
        )
        self.settings = chosen
        self.ptu = DirectedPerceptionPtu(chosen, self.clock, self.line.connect)

    def next_process(self) -> DirectedPerceptionPtu:
        """Opens the unit and knows nothing of what was before; the first one was killed."""
        assert self.ptu._line is not None
        self.ptu._line.close()
        self.ptu = DirectedPerceptionPtu(self.settings, self.clock, self.line.connect)
        self.ptu.open()
        return self.ptu

    def wait(self, seconds: float) -> None:
        self.line.catch_up()
        self.clock.sleep_until(self.clock.now() + seconds)
        self.line.settle()

    def ready(self) -> DirectedPerceptionPtu:
        self.ptu.open()
        self.ptu.home()
        self.wait(3.1)
        assert self.ptu.read().homed
        return self.ptu


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path)
    yield bench
    bench.ptu.close()
    bench.line.close()


# --- opening ----------------------------------------------------------------------------------


def test_opening_halts_first_and_reads_what_the_unit_can_do(bench: Bench) -> None:
    bench.ptu.open()
    assert bench.unit.heard[0] == "H"
    assert {"PR", "PN", "PX", "PL", "PU", "TR", "TN", "TX", "TL", "TU"} <= set(bench.unit.heard)
    limits = bench.ptu.limits
    assert limits.pan_rad == pytest.approx((-3090 * STEP_RAD, 3090 * STEP_RAD))
    assert limits.tilt_rad == pytest.approx((-907 * STEP_RAD, 604 * STEP_RAD))
    assert limits.speed_rad_s == pytest.approx(2902 * STEP_RAD)


def test_a_head_that_still_moves_is_stopped_by_opening(bench: Bench) -> None:
    bench.ready().move(2.0, 0.0, 0.3)
    bench.wait(0.5)
    bench.line.unplug()
    bench.line.plug()
    with pytest.raises(DeviceLost):
        bench.ptu.read()
    bench.ptu.open()
    stopped = bench.ptu.read().pan_rad
    bench.wait(2.0)
    assert bench.ptu.read().pan_rad == stopped < 0.3


def test_a_power_cycled_unit_is_told_from_one_that_was_only_unplugged(bench: Bench) -> None:
    ptu = bench.ready()
    assert ptu.restarted
    bench.line.unplug()
    bench.line.plug()
    with pytest.raises(DeviceLost):
        ptu.read()
    ptu.open()
    assert not ptu.restarted and ptu.read().homed
    ptu.close()
    bench.unit.power_cycle(bench.clock.now())
    bench.wait(4.0)
    ptu.open()
    assert ptu.restarted and not ptu.read().homed


def test_a_unit_that_is_still_starting_is_absent_and_then_there(bench: Bench) -> None:
    bench.unit.power_cycle(bench.clock.now())
    with pytest.raises(DeviceAbsent) as caught:
        bench.ptu.open()
    assert caught.value.code == "PTU-SILENT"
    bench.wait(5.0)
    bench.ptu.open()
    assert bench.ptu.limits.pan_rad[1] > 2.7


def test_verbose_units_are_understood(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some firmware ignores FT."""
    stubborn = property(lambda unit: True, lambda unit, value: None)
    monkeypatch.setattr(PtuUnit, "verbose", stubborn, raising=False)
    bench.ready().move(0.4, 0.1, 1.0)
    bench.wait(2.0)
    assert bench.ptu.read().pan_rad == pytest.approx(0.4, abs=STEP_RAD)


def test_soft_limits_lie_inside_the_units(tmp_path: Path) -> None:
    bench = Bench(tmp_path, pan_limits_deg=(-30, 40), tilt_limits_deg=(-90, 10))
    bench.ready().move(3.0, 1.0, 2.0)
    bench.wait(4.0)
    state = bench.ptu.read()
    assert math.degrees(state.pan_rad) == pytest.approx(40, abs=0.06)
    assert math.degrees(state.tilt_rad) == pytest.approx(10, abs=0.06)
    assert bench.ptu.limits.tilt_rad[0] == pytest.approx(-907 * STEP_RAD)
    bench.line.close()


def test_a_unit_upside_down_turns_the_other_way(tmp_path: Path) -> None:
    bench = Bench(tmp_path, pan_sign=-1, tilt_sign=-1)
    bench.ready().move(0.5, 0.2, 2.0)
    bench.wait(2.0)
    assert bench.unit.axes["P"].position(bench.clock.now()) == -round(0.5 / STEP_RAD)
    assert bench.ptu.read().tilt_rad == pytest.approx(0.2, abs=STEP_RAD)
    assert bench.ptu.limits.tilt_rad == pytest.approx((-604 * STEP_RAD, 907 * STEP_RAD))
    bench.line.close()


def test_soft_limits_that_leave_nothing_are_refused(tmp_path: Path) -> None:
    bench = Bench(tmp_path, tilt_limits_deg=(60, 80))
    with pytest.raises(DeviceAbsent) as caught:
        bench.ptu.open()
    assert caught.value.code == "PTU-LIMITS"
    bench.line.close()


def test_something_else_on_the_line_is_no_pan_tilt_unit(bench: Bench) -> None:
    bench.unit._axis_command = lambda *_: "* OK\r\n"  # type: ignore[method-assign]
    with pytest.raises(DeviceAbsent) as caught:
        bench.ptu.open()
    assert caught.value.code == "PTU-STRANGE" and "OK" in caught.value.what


@pytest.mark.parametrize("late", ["* 185.1428\r\n", "* 5\r\n"])
def test_two_answers_at_once_are_asked_for_again(bench: Bench, late: str) -> None:
    """The answer to an earlier question came late."""
    answer, before = bench.unit._axis_command, [late]

    def doubled(*command: Any) -> str:
        late_one = before.pop() if before and command[:2] == ("P", "R") else ""
        return late_one + answer(*command)

    bench.unit._axis_command = doubled  # type: ignore[method-assign]
    bench.ptu.open()
    assert bench.unit.heard.count("PR") == 2
    assert bench.ptu.limits.pan_rad == pytest.approx((-3090 * STEP_RAD, 3090 * STEP_RAD))


def test_what_came_too_late_is_not_the_next_answer(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    ask, late = DirectedPerceptionPtu._ask, []

    def slowly(ptu: DirectedPerceptionPtu, *commands: str, share: float = 1.0) -> list[Answer]:
        answers = ask(ptu, *commands, share=share)
        if commands == ("pn",) and not late:
            late.append(answers)
            bench.unit.intrude("* -9 ", bench.clock.now())  # its end is lost in noise
            bench.line.settle()
            raise TimeoutError
        return answers

    monkeypatch.setattr(DirectedPerceptionPtu, "_ask", slowly)
    bench.ptu.open()
    assert bench.ptu.limits.pan_rad[0] == pytest.approx(-3090 * STEP_RAD)


def test_a_converter_that_vanishes_while_it_is_set_up_is_absent(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def vanish(*_: object) -> None:
        raise termios.error(5, "Input/output error")

    monkeypatch.setattr(termios, "tcsetattr", vanish)
    with pytest.raises(DeviceAbsent) as caught:
        bench.ptu.open()
    assert caught.value.code == "PTU-ABSENT"


def test_a_line_in_use_says_so(bench: Bench) -> None:
    other = SerialLine(str(bench.line.link), 9600)
    with pytest.raises(DeviceAbsent) as caught:
        bench.ptu.open()
    assert caught.value.code == "PTU-BUSY"
    other.close()


def test_a_line_without_the_right_to_it_says_so(bench: Bench) -> None:
    def refuse(path: str, baud: int) -> SerialLine:
        raise PermissionError(13, "Permission denied")

    ptu = DirectedPerceptionPtu(PtuSettings(), bench.clock, refuse)
    with pytest.raises(DeviceAbsent) as caught:
        ptu.open()
    assert caught.value.code == "PTU-RIGHTS" and "dialout" in caught.value.remedy


# --- the watchdog -----------------------------------------------------------------------------


def test_a_silent_unit_is_given_up_with_a_halt(bench: Bench) -> None:
    ptu = bench.ready()
    ptu.move(1.0, 0.0, 0.5)
    bench.unit.fall_silent(until_s=1e9)
    with pytest.raises(DeviceLost) as caught:
        ptu.read()
    assert caught.value.code == "PTU-SILENT"
    assert bench.unit.heard[-1] != "H"  # it could not hear it


def test_the_halt_is_heard_where_only_the_way_back_is_broken(bench: Bench) -> None:
    ptu = bench.ready()
    ptu.move(1.0, 0.0, 0.5)
    bench.unit._emit = lambda *_: None  # type: ignore[method-assign, assignment]
    with pytest.raises(DeviceLost):
        ptu.read()
    bench.line.catch_up()
    assert bench.unit.heard[-1] == "H"


def test_the_halt_is_heard_after_a_command_that_broke_off(bench: Bench) -> None:
    ptu = bench.ready()
    ptu.move(1.0, 0.0, 0.5)
    assert ptu._line is not None
    ptu._line.write(b"pp12")
    ptu.close()
    bench.line.catch_up()
    assert bench.unit.heard[-1] == "H"


@pytest.mark.parametrize("fault", ["garble", "halve"])
def test_one_spoilt_answer_is_asked_for_again(bench: Bench, fault: str) -> None:
    ptu = bench.ready()
    ptu.move(0.3, 0.0, 1.0)
    bench.wait(2.0)
    getattr(bench.unit, fault)()
    state = ptu.read()
    assert state.pan_rad == pytest.approx(0.3, abs=STEP_RAD)
    assert state.tilt_rad == 0.0


def test_a_power_cycle_in_the_middle_is_a_loss(bench: Bench) -> None:
    ptu = bench.ready()
    ptu.move(1.0, 0.0, 0.5)
    bench.unit.power_cycle(bench.clock.now())
    bench.line.settle()
    with pytest.raises(DeviceLost):
        for _ in range(3):
            ptu.read()
    bench.wait(5.0)
    ptu.open()
    assert ptu.restarted and not ptu.read().homed


def test_a_limit_hit_costs_the_zero(bench: Bench) -> None:
    ptu = bench.ready()
    bench.unit.intrude("!P", bench.clock.now())
    bench.line.settle()
    state = ptu.read()
    assert state.limit_hits == 1 and not state.homed


def test_the_next_process_finds_the_zero_that_the_unit_kept(bench: Bench) -> None:
    bench.ready().move(0.4, 0.1, 1.0)
    bench.wait(2.0)
    state = bench.next_process().read()
    assert state.homed and state.pan_rad == pytest.approx(0.4, abs=STEP_RAD)


def test_the_next_process_does_not_believe_a_unit_that_was_never_homed(bench: Bench) -> None:
    bench.ptu.open()
    assert not bench.ptu.read().homed
    assert not bench.next_process().read().homed


def test_the_next_process_does_not_believe_one_that_was_without_power(bench: Bench) -> None:
    bench.ready()
    bench.unit.power_cycle(bench.clock.now())
    bench.wait(4.0)
    assert not bench.next_process().read().homed
    assert not bench.next_process().read().homed  # though its echo is off now


def test_the_next_process_does_not_believe_one_that_hit_a_limit(bench: Bench) -> None:
    ptu = bench.ready()
    bench.unit.intrude("!P", bench.clock.now())
    bench.line.settle()
    assert not ptu.read().homed
    assert not bench.next_process().read().homed


def test_the_next_process_does_not_believe_a_reset_that_nobody_saw_end(bench: Bench) -> None:
    bench.ready().home()
    bench.wait(3.1)
    assert not bench.next_process().read().homed


def test_a_limit_hit_just_before_a_loss_is_not_forgotten(bench: Bench) -> None:
    ptu = bench.ready()
    bench.unit.intrude("!P", bench.clock.now())
    bench.line.settle()
    ptu.move(0.1, 0.0, 1.0)  # hears of it
    ptu.close()
    ptu.open()
    assert not ptu.read().homed and not bench.next_process().read().homed


def test_a_reset_that_finds_no_zero_is_over(bench: Bench) -> None:
    bench.ptu.open()
    bench.unit.jam()
    bench.ptu.home()
    bench.wait(3.1)
    states = [bench.ptu.read() for _ in range(2)]
    assert not states[-1].homed and not states[-1].moving


def test_homing_that_never_ends_is_given_up(bench: Bench) -> None:
    bench.ptu.open()
    bench.ptu.home()
    bench.unit.fall_silent(until_s=1e9)
    bench.wait(60.0)
    with pytest.raises(DeviceLost) as caught:
        bench.ptu.read()
    assert caught.value.code == "PTU-HOMING-LONG"


def test_no_moves_while_homing(bench: Bench) -> None:
    bench.ptu.open()
    bench.ptu.home()
    with pytest.raises(DeviceError) as caught:
        bench.ptu.move(0.1, 0.0, 1.0)
    assert caught.value.code == "PTU-HOMING"
    assert bench.ptu.read().moving


def test_an_unchanged_target_costs_no_bytes(bench: Bench) -> None:
    ptu = bench.ready()
    ptu.move(0.1, 0.0, 1.0)
    before = len(bench.unit.heard)
    ptu.move(0.1, 0.0, 1.0)
    assert len(bench.unit.heard) == before
