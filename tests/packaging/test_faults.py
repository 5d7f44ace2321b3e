"""Why a service was given up is on record."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hypermask import faults

HUNG = {"MONITOR_SERVICE_RESULT": "watchdog", "MONITOR_EXIT_CODE": "killed"}


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("HYPERMASK_RUN", str(tmp_path / "run"))
    monkeypatch.setenv("PATH", "")  # no journal
    return tmp_path


def test_the_record_says_which_service_why_and_what_it_said_last() -> None:
    path = faults.record("hypermask-stage", HUNG, ["PRJ-HUNG: no flip"])
    content = json.loads(path.read_text("utf-8"))
    assert path.name == "000001-hypermask-stage.json"
    assert content["result"] == "watchdog"
    assert content["how"] == "its work stood still"
    assert content["last"] == ["PRJ-HUNG: no flip"]
    assert faults.latest() == content


def test_numbers_give_the_order_and_only_the_latest_stay() -> None:
    for _ in range(faults.KEPT + 5):
        faults.record("hypermask-voice", HUNG, [])
    names = sorted(path.name for path in faults.folder().iterdir())
    assert len(names) == faults.KEPT
    assert names[-1] == f"{faults.KEPT + 5:06d}-hypermask-voice.json"


def test_a_half_written_record_is_passed_over() -> None:
    faults.record("hypermask-voice", HUNG, [])
    (faults.folder() / "000002-hypermask-show.json").write_text("{", "utf-8")
    latest = faults.latest()
    assert latest is not None and latest["unit"] == "hypermask-voice"


def test_without_a_journal_the_services_own_events_are_taken(
    home: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    events = home / "run" / "events"
    events.mkdir(parents=True)
    (events / "stage.jsonl").write_text('{"text": "GPU-SWAP: no picture"}\n', "utf-8")
    monkeypatch.setenv("MONITOR_SERVICE_RESULT", "start-limit-hit")
    assert faults.main(["hypermask-stage"]) == 0
    latest = faults.latest()
    assert latest is not None
    assert latest["how"] == "it failed too often" and latest["last"] == ["GPU-SWAP: no picture"]
    assert "<2>SVC-GIVENUP: hypermask-stage was given up" in capsys.readouterr().err
