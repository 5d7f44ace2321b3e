"""Every worker and device on one screen of 80 columns."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from hypermask.blackboard import Record
from hypermask.show.engine import ShowEngine
from hypermask.show.showfile import ShowFile
from hypermask.technician import screen
from hypermask.technician.crew import OWNS, Member, crew, short
from hypermask.technician.screen import Screen, survey
from hypermask.workers.board import MACHINE, MOUTH, PACE, TRACK, WORDS, Board
from hypermask.workers.health import HEALTH, Health
from hypermask.workers.status import look
from hypermask_drivers.clock import VirtualClock

NOW = 1000.0
ALL = tuple(kind for kind in OWNS.values() if kind)


def health(**changes: object) -> Record:
    record = np.zeros((), HEALTH)
    values = {
        "pid": 4711, "started_s": NOW - 100, "time_s": NOW - 0.2, "ready": True,
        "state": b"working", "steps": 6000, "p50_ms": 1.2, "p99_ms": 3.4, "max_ms": 56.7,
        "granted": b"SCHED_FIFO 50, CPU 2, memory locked",
    } | changes  # fmt: skip
    for key, value in values.items():
        record[key] = value
    return record


def only(name: str, living: bool = True, kinds: tuple[str, ...] = ALL, **changes: object) -> Member:
    found = crew({name: health(**changes)}, NOW, kinds, is_alive=lambda pid: living)
    return next(member for member in found if member.name == name)


@pytest.mark.parametrize(
    ("name", "changes", "state", "fine"),
    [
        ("tracker", {}, "working", True),
        ("tracker", {"ready": False}, "waits", False),
        ("tracker", {"time_s": NOW - 4.0}, "hung", False),
        ("tracker", {"state": b"stopped"}, "stopped", False),
        ("tracker", {"state": b"starting"}, "starting", False),
        ("show", {"ready": False}, "working", False),
        ("dresser", {"ready": False}, "working", True),
    ],
)
def test_how_a_worker_is(name: str, changes: dict[str, object], state: str, fine: bool) -> None:
    member = only(name, **changes)
    assert (member.state, member.fine) == (state, fine)


def test_a_worker_whose_process_is_gone_is_dead() -> None:
    assert only("voice", living=False).state == "dead"


def test_a_machine_without_the_device_is_no_fault() -> None:
    member = only("pantilt", kinds=("camera",), ready=False)
    assert member.state == "no device" and member.fine


def test_a_worker_that_never_began_is_absent() -> None:
    states = {member.name: member.state for member in crew({}, NOW)}
    assert set(states.values()) == {"absent"} and set(states) == set(OWNS)


def test_the_rate_comes_from_two_looks() -> None:
    before = health(time_s=NOW - 1.2, steps=5880)
    (member,) = [m for m in crew({"tracker": health()}, NOW, None, {"tracker": before},
                                 lambda pid: True) if m.name == "tracker"]  # fmt: skip
    assert member.rate_hz == pytest.approx(120)
    again = crew({"tracker": health(pid=9)}, NOW, None, {"tracker": before}, lambda pid: True)
    assert next(m for m in again if m.name == "tracker").rate_hz is None


def test_what_was_granted_fits_its_column() -> None:
    assert short("SCHED_FIFO 50, CPU 2, memory locked") == "rt50 cpu2 locked"


@pytest.fixture
def board(tmp_path: Path) -> Board:
    board = Board.shared(tmp_path / "board")
    now_s = time.monotonic()
    track, mouth, pace = (np.zeros((), dtype) for dtype in (TRACK, MOUTH, PACE))
    track["time_s"] = track["seen_s"] = mouth["time_s"] = pace["flip_s"] = now_s + 100
    track["locked"] = track["camera_ready"] = True
    pace["period_s"] = 1 / 60
    board.track.publish(track)
    board.mouth.publish(mouth)
    board.pace.publish(pace)
    board.scene.publish(
        ShowEngine(ShowFile(version=1, name="x", characters=("mean",)), now_s).scene
    )
    return board


def machine(board: Board, **changes: object) -> None:
    record = np.zeros((), MACHINE)
    values: dict[str, object] = {
        "time_s": time.monotonic(), "power": b"ready", "volts": 12.41, "amps": 3.2, "charge": 0.64,
        "level": b"good", "lamp": b"ready", "lamp_on": True, "lamp_c": 44.0, "temperature_c": 61.0,
        "throttling_known": True, "usb_resets": 0,
    }  # fmt: skip
    for key, value in (values | changes).items():
        record[key] = value
    board.machine.publish(record)


def texts(board: Board) -> dict[str, tuple[bool, str]]:
    assert board.folder is not None
    return {line.name: (line.fine, line.text) for line in look(board.folder).lines}


def test_battery_lamp_and_heat_have_a_line_each(board: Board) -> None:
    machine(board)
    found = texts(board)
    assert found["battery"] == (True, "12.4 V, 3.2 A, 64% left: good")
    assert found["lamp"] == (True, "on, 44 degrees C")
    assert found["processor"] == (True, "61 degrees C, not slowed down")


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"power": b"lost"}, "battery"),
        ({"level": b"critical"}, "battery"),
        ({"lamp": b"lost"}, "lamp"),
        ({"lamp_faults": b"the red LED fails"}, "lamp"),
        ({"temperature_c": 88.0}, "processor"),
        ({"throttled": 4}, "processor"),
    ],
)
def test_what_is_wrong_is_marked(board: Board, changes: dict[str, object], line: str) -> None:
    machine(board, **changes)
    assert [name for name, (fine, _) in texts(board).items() if not fine] == [line]


def test_throttling_in_the_past_is_said_and_no_fault(board: Board) -> None:
    machine(board, throttled=0x40000)
    assert texts(board)["processor"] == (True, "61 degrees C, slowed down earlier")


def test_old_figures_are_not_shown_as_new(board: Board) -> None:
    machine(board, time_s=time.monotonic() - 60)
    found = texts(board)
    assert "battery" not in found and "60 s ago" in found["slow"][1]


def test_a_mode_shows_its_words(board: Board) -> None:
    record = np.zeros((), WORDS)
    record["mode"], record["words"] = b"calibrate", b"Lay the cross on LED 3."
    board.words.publish(record)
    assert texts(board)["mode"] == (True, "calibrate: Lay the cross on LED 3.")


@pytest.fixture
def cart(board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Six workers, the longest figures that can be."""
    for name in ("HOME", "RUN", "ETC"):
        monkeypatch.setenv(f"HYPERMASK_{name}", str(tmp_path / name.lower()))
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc" / "machine.toml").write_text('machine = "sim"\n')
    monkeypatch.setattr(screen, "WINDOW_S", 0.0)
    assert board.folder is not None
    for name in OWNS:
        one = Health(board.folder, name, VirtualClock(time.monotonic()))
        one.record["pid"] = os.getpid()
        one.record["ready"], one.record["restarts"] = name != "voice", 12345
        one.record["steps"], one.record["missed"] = 10**10, 123456789
        one.record["max_ms"] = one.record["p99_ms"] = 123456.7
        one.record["granted"] = b"SCHED_FIFO 50, CPU 0,1,2,3,4,5,6,7, memory locked"
        one.fault("SND-LOST")
        one.say("working")
        one.publish(now=True)
    machine(board, lamp_faults=b"the red LED fails, the green LED fails, the blue LED fails, its x")
    return board.folder


def test_it_fits_a_terminal_of_80_columns_and_24_rows(cart: Path) -> None:
    rows = survey(cart, 0.0).rows()
    assert max(map(len, rows)) <= 80
    assert len(rows) <= 24, "\n".join(rows)


def test_the_first_row_says_what_is_wrong(cart: Path) -> None:
    found = survey(cart, 0.0)
    assert found.headline.startswith("Not well: voice")
    assert any("the sound is away; last fault: SND-LOST" in row for row in found.rows())


def test_a_configuration_that_is_not_used_is_said(cart: Path, tmp_path: Path) -> None:
    (tmp_path / "etc" / "machine.toml").write_text('machine = "sim"\nnonsense = 1\n')
    line = next(line for line in survey(cart, 0.0).lines if line.name == "config")
    assert not line.fine and "CFG-LASTGOOD" in line.text and "nonsense" in line.text


def test_as_data_it_names_every_worker(cart: Path) -> None:
    data = survey(cart, 0.0).as_data()
    assert set(data["workers"]) == set(OWNS) and data["fine"] is False
    assert data["workers"]["voice"]["device"] == "away"
    assert data["lines"]["battery"]["volts"] == pytest.approx(12.41)


def test_a_stopped_show_is_called_so() -> None:
    gone = tuple(Member(name, "stopped", None, 0, 0, 0, 0, 0, 0, "", "", "") for name in OWNS)
    from hypermask.workers.status import Status

    assert Screen(Status(()), gone).headline == "The show is stopped."


def test_looking_makes_no_files(tmp_path: Path) -> None:
    (tmp_path / "board").mkdir()
    look(tmp_path / "board")
    assert list((tmp_path / "board").iterdir()) == []
