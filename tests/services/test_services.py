"""The services as processes: killed, stopped, misconfigured, and looked at from outside."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from services_rig import LONG_S, SERVICES, Show

from hypermask.calibration import storage
from hypermask.calibration.outcome import Outcome
from hypermask.calibration.quality import Quality
from hypermask.rehearsal.desk import wait_for
from hypermask.services.rig import nominal_projector
from hypermask.show.scene import characters_at

SOON_S = 1.0
"""A service that is told to end has ended within this time."""


@pytest.fixture(scope="module")
def show(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Show]:
    """All six services, started once for this file; each test leaves them all at work."""
    with Show(tmp_path_factory.mktemp("show")) as desk:
        desk.start_all()
        yield desk


def test_a_face_is_lit(show: Show) -> None:
    record = show.await_health("stage", lambda stage: stage["first_s"] > 0, "the first face")
    assert record["ready"] and record["fault"] == b"CAL-NONE"
    scene = show.records.scene.latest()
    assert scene is not None and characters_at(scene, time.monotonic()) == [("mean", 1.0)]


def test_every_worker_tells_how_it_is(show: Show) -> None:
    for name in SERVICES:
        record = show.await_working(name)
        assert int(record["pid"]) == show.processes[name].pid
        assert 0 < record["started_s"] <= record["time_s"] <= time.monotonic()
    for name in ("tracker", "voice", "stage", "pantilt"):
        record = show.await_health(name, lambda one: one["steps"] > 5, f"work of {name}")
        assert 0 <= record["p50_ms"] <= record["p99_ms"] <= record["max_ms"]
    assert show.await_working("tracker")["max_ms"] > 0


def test_the_show_makes_its_configuration_the_last_good_one(show: Show) -> None:
    wait_for((show.home / "machine" / "last-good.toml").is_file, LONG_S, "last-good.toml")


@pytest.mark.parametrize("name", ["tracker", "voice", "pantilt", "show"])
def test_the_picture_goes_on_when_a_worker_is_killed(show: Show, name: str) -> None:
    restarts = int(show.await_working(name)["restarts"])
    show.kill(name)
    show.await_more("stage")
    show.start(name)
    assert show.await_working(name)["restarts"] == restarts + 1
    show.await_more("stage")


def test_a_tracker_that_was_stopped_follows_what_is_now(show: Show) -> None:
    """Frames that waited meanwhile are dropped: none of them moves the face afterwards."""
    process = show.processes["tracker"]
    process.send_signal(signal.SIGSTOP)
    stopped_s = time.monotonic()
    wait_for(lambda: time.monotonic() > stopped_s + 0.6, 5, "0.6 s")
    process.send_signal(signal.SIGCONT)
    resumed_s = time.monotonic()

    def fresh() -> bool:
        track = show.records.track.latest()
        return track is not None and bool(track["locked"]) and track["time_s"] > resumed_s - 0.1

    wait_for(fresh, 5, "a fresh track")
    show.await_more("tracker")


def test_a_stage_that_was_stopped_goes_on(show: Show) -> None:
    process = show.processes["stage"]
    process.send_signal(signal.SIGSTOP)
    stopped_s = time.monotonic()
    wait_for(lambda: time.monotonic() > stopped_s + 0.4, 5, "0.4 s")
    process.send_signal(signal.SIGCONT)
    show.await_more("stage", 20)


def test_a_head_whose_worker_was_stopped_is_not_gone(show: Show) -> None:
    process = show.processes["pantilt"]
    process.send_signal(signal.SIGSTOP)
    stopped_s = time.monotonic()
    wait_for(lambda: time.monotonic() > stopped_s + 0.6, 5, "0.6 s")
    process.send_signal(signal.SIGCONT)
    show.await_said("pantilt", "NECK-SILENT")
    show.await_more("pantilt")


def test_a_new_calibration_is_taken_while_the_show_runs(
    show: Show, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hypermask.machine.files import load_machine

    for name, path in (("HYPERMASK_HOME", show.home), ("HYPERMASK_ETC", show.etc)):
        monkeypatch.setenv(name, str(path))
    projector = nominal_projector(load_machine(lambda code, text: None))
    quality = Quality(0.3, ((1.2, 0.3), (1.8, 0.3), (2.4, 0.3)), 1.0, 30, (), None, 0.0)
    storage.save(Outcome(projector, quality, ()), "click")
    show.await_said("stage", "CAL-TAKEN")
    show.await_more("stage")


def test_nothing_grows_when_workers_come_and_go(show: Show) -> None:
    stage = show.processes["stage"].pid
    folders = [Path(f"/proc/{stage}/fd"), Path(f"/proc/{stage}/task"), show.board]
    before = [len(list(folder.iterdir())) for folder in folders]
    for _ in range(2):
        show.kill("tracker")
        show.start("tracker")
        show.await_working("tracker")
    assert [len(list(folder.iterdir())) for folder in folders] == before
    assert {path.name for path in show.run.iterdir()} == {
        "board", "control.sock", "events", "origin", ".board.lock",
    }  # fmt: skip


def test_the_stage_is_back_with_the_character_that_was_on(show: Show) -> None:
    """From what the dresser prepared, it is lit before the program is loaded."""
    wait_for((show.home / "cache" / "costumes").is_dir, LONG_S, "costumes")
    show.kill("stage")
    show.start("stage")
    record = show.await_health("stage", lambda stage: stage["first_s"] > 0, "the face")
    assert record["restarts"] >= 1
    show.await_more("stage")


def test_every_service_ends_soon_and_cleanly(show: Show) -> None:
    """The last test of this file: afterwards nothing runs any more."""
    for name in SERVICES:
        show.await_working(name)
    for name in SERVICES:
        began_s = time.monotonic()
        assert show.stop(name) == 0, show.said(name)
        assert time.monotonic() - began_s < SOON_S + 0.1, name
        assert show.last_health(name)["state"] == b"stopped"
        assert "Traceback" not in show.said(name) and "Error" not in show.said(name)
    assert not (show.run / "control.sock").exists()
