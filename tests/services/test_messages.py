"""Messages: one line each with the journal's priority, and a short file of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hypermask.services import messages
from hypermask.services.messages import Messages, events_folder, priority_of


@pytest.fixture(autouse=True)
def _run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HYPERMASK_RUN", str(tmp_path))


def test_a_message_is_one_line_with_its_priority(capsys: pytest.CaptureFixture[str]) -> None:
    Messages("tracker")(12.0, "CAM-LOST", "CAM-LOST: the camera\nvanished. Check the cable.")
    assert capsys.readouterr().err == "<4>CAM-LOST: the camera vanished. Check the cable.\n"


def test_a_message_without_its_code_gets_it(capsys: pytest.CaptureFixture[str]) -> None:
    Messages("tracker")(12.0, "MASK-FOUND", "The mask is seen.")
    assert capsys.readouterr().err == "<5>MASK-FOUND: The mask is seen.\n"


@pytest.mark.parametrize(
    ("code", "priority"),
    [
        ("CFG-LASTGOOD", 3),
        ("SHOW-FALLBACK", 3),
        ("CAM-LOST", 4),
        ("CAMERA-BACK", 5),
        ("MASK-LOST", 5),
        ("CAL-TAKEN", 5),
        ("CUE", 6),
    ],
)
def test_what_is_loud_and_what_is_not(code: str, priority: int) -> None:
    assert priority_of(code) == priority


def test_the_file_keeps_when_and_who() -> None:
    Messages("voice")(12.3456, "SND-LOST", "SND-LOST: the microphone vanished. Plug it.")
    (line,) = (events_folder() / "voice.jsonl").read_text().splitlines()
    entry = json.loads(line)
    assert (entry["worker"], entry["code"], entry["time_s"]) == ("voice", "SND-LOST", 12.346)
    assert entry["wall_s"] > 1e9 and entry["priority"] == 4


def test_the_file_stays_short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(messages, "LARGEST_BYTES", 2000)
    tell = Messages("voice")
    for number in range(200):
        tell(number, "NOTE", f"number {number}")
    files = sorted(events_folder().iterdir())
    assert [file.name for file in files] == ["voice.jsonl", "voice.jsonl.1"]
    assert sum(file.stat().st_size for file in files) < 5000
    assert "number 199" in files[0].read_text()


def test_a_file_that_cannot_be_written_costs_only_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "events").write_text("in the way")
    Messages("voice")(1.0, "SND-LOST", "SND-LOST: it vanished. Plug it.")
    assert "SND-LOST" in capsys.readouterr().err


def test_the_last_thing_that_went_wrong_is_remembered() -> None:
    tell = Messages("voice")
    tell(1.0, "SND-LOST", "it vanished")
    tell(2.0, "SOUND-BACK", "it is back")
    assert tell.last_fault == "SND-LOST"
