"""The last messages: from the journal, or the workers' own files, also where some are damaged."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from hypermask.errors import HypermaskError, UsageError
from hypermask.services.messages import Messages
from hypermask.technician.journal import from_files, said


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HYPERMASK_RUN", str(tmp_path))
    return tmp_path


def no_journal() -> bool:
    return False


def rows(count: int = 30, worker: str | None = None) -> list[str]:
    return [one.text for one in said(count, worker, has_journal=no_journal)]


def test_what_workers_report_is_read_back_in_order(run: Path) -> None:
    for number in range(5):
        Messages("show").tell("CUE", f"number {number}", float(number))
        Messages("tracker").tell("MASK-LOST", f"lost {number}", number + 0.5)
    assert rows(3) == ["MASK-LOST: lost 3", "CUE: number 4", "MASK-LOST: lost 4"]
    assert rows(2, "show") == ["CUE: number 3", "CUE: number 4"]


def test_a_clock_that_jumps_does_not_change_the_order(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import time

    for moment, wall_s in ((10.0, 100.0), (20.0, 1.8e9), (30.0, 1.7e9)):
        monkeypatch.setattr(time, "time", lambda wall_s=wall_s: wall_s)
        Messages("show").tell("CUE", f"at {moment:.0f}", moment)
    assert rows() == ["CUE: at 10", "CUE: at 20", "CUE: at 30"]


def test_a_file_that_was_put_aside_is_read_too(run: Path) -> None:
    Messages("show").tell("CUE", "old")
    (run / "events" / "show.jsonl").rename(run / "events" / "show.jsonl.1")
    Messages("show").tell("CUE", "new")
    assert rows() == ["CUE: old", "CUE: new"]


def test_damaged_lines_are_left_out(run: Path) -> None:
    Messages("show").tell("CUE", "good")
    with (run / "events" / "show.jsonl").open("ab") as file:
        file.write(b'{"half": \n\xff\xfe\x00\n[]\n{"wall_s": "x"}\n')
    assert [one.text for one in from_files()] == ["CUE: good"]


def test_control_characters_do_not_reach_the_terminal(run: Path) -> None:
    (run / "events").mkdir()
    entry = {
        "time_s": 1.0,
        "wall_s": 1.0,
        "worker": "show",
        "priority": 4,
        "text": "a\x1b[2Jb\rc\nd",
    }
    (run / "events" / "show.jsonl").write_text(json.dumps(entry))
    (one,) = from_files()
    assert one.text == "a [2Jb c d" and one.row().isprintable()


def test_nothing_said_is_told(run: Path) -> None:
    with pytest.raises(HypermaskError, match="LOG-NONE"):
        said(5, has_journal=no_journal)


@pytest.mark.parametrize(
    ("count", "worker", "code"), [(0, None, "LOG-COUNT"), (5, "cook", "LOG-WORKER")]
)
def test_what_cannot_be_meant(run: Path, count: int, worker: str | None, code: str) -> None:
    with pytest.raises(UsageError, match=code):
        said(count, worker, has_journal=no_journal)


def test_the_journal_comes_first(run: Path) -> None:
    asked: list[Sequence[str]] = []

    def journalctl(command: Sequence[str]) -> tuple[int, str]:
        asked.append(command)
        lines = [
            {"MESSAGE": "CAM-LOST: gone", "PRIORITY": "4",
             "__REALTIME_TIMESTAMP": "1700000000000000",
             "_SYSTEMD_UNIT": "hypermask-tracker.service"},
            {"MESSAGE": [72, 105, 255], "PRIORITY": "6",
             "__REALTIME_TIMESTAMP": "1700000001000000", "UNIT": "hypermask-show.service"},
            {"no": "message"},
        ]  # fmt: skip
        return 0, "\n".join([*(json.dumps(line) for line in lines), "rubbish"])

    found = said(10, "tracker", journalctl, lambda: True)
    assert [(one.worker, one.priority, one.text) for one in found] == [
        ("tracker", 4, "CAM-LOST: gone"), ("show", 6, "Hi\ufffd"),
    ]  # fmt: skip
    assert "--unit=hypermask-tracker.service" in asked[0] and "--lines=10" in asked[0]


def test_a_journal_that_may_not_be_read_gives_way_to_the_files(run: Path) -> None:
    Messages("show").tell("CUE", "here")
    found = said(10, None, lambda command: (1, "No permission"), lambda: True)
    assert [one.text for one in found] == ["CUE: here"]
