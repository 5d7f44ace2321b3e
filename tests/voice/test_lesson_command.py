"""`hypermask voice calibrate --live`: with the running show's microphone, or the machine's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_voice_lesson import Rehearsal, said
from typer.testing import CliRunner
from voice_sounds import needs_data

from hypermask.cli import voice as command
from hypermask.voice import speaker
from hypermask.voice.takes import PROMPTS
from hypermask.workers import lesson_live
from hypermask.workers.board import Board
from hypermask.workers.lesson import LEAD_S
from hypermask.workers.lesson_teacher import InlineTeacher
from hypermask.workers.running import announced
from hypermask.workers.voice import VoiceWorker
from hypermask_drivers.clock import VirtualClock
from hypermask_sim.devices.sound import SimSoundIn

pytestmark = needs_data


@pytest.fixture(autouse=True)
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("HYPERMASK_RUN", str(tmp_path / "run"))
    return tmp_path


def calibrate(*arguments: str) -> tuple[int, dict[str, Any]]:
    done = CliRunner().invoke(command.app, ["calibrate", "--live", "--json", *arguments])
    return done.exit_code, json.loads(done.stdout)


class ShowClock(VirtualClock):
    """While one process sleeps, the show in the other goes on."""

    show: Rehearsal

    def sleep_until(self, time_s: float) -> None:
        super().sleep_until(time_s)
        self.show._act()
        self.show.clock.sleep_until(self.now())
        while self.show.worker.step():
            pass


def test_the_show_that_runs_is_asked(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    show = Rehearsal(lambda asked, before: said("m31", asked), board=Board.shared(machine / "b"))
    show.play(0.1)
    clock = ShowClock(show.clock.now())
    clock.show = show
    monkeypatch.setattr(lesson_live, "RealClock", lambda: clock)
    Board.shared(machine / "b").scene.publish(
        np.zeros((), Board.shared(machine / "b").scene._dtype)
    )
    with announced(machine / "b"):
        status, result = calibrate("--name", "anna")
    assert status == 0
    assert result["kept"] and result["repeated"] == []
    assert result["held_out_after"] >= result["held_out_before"]
    assert speaker.load_current()[0].name == "anna"  # type: ignore[union-attr]


def test_without_a_show_the_machine_s_own_microphone_is_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The actor reads what is printed."""
    actor = Rehearsal(lambda asked, before: np.zeros(0))
    printed: list[str] = []

    def read(text: str) -> None:
        printed.append(text)
        for asked, prompt in PROMPTS.items():
            if text[0].isdigit() and prompt in text:
                wrong = asked == "o" and sum(prompt in line for line in printed) == 1
                sound = said("m31", "i" if wrong else asked)
                actor.say(sound, actor.clock.now() + LEAD_S + 0.35)

    monkeypatch.setattr(command, "_say", read)
    monkeypatch.setattr(lesson_live, "RealClock", lambda: actor.clock)
    monkeypatch.setattr(
        lesson_live, "open_microphone", lambda *names: SimSoundIn(actor.world, actor.clock)
    )
    status, result = calibrate()
    assert status == 0
    assert result["repeated"] == [{"asked": "o", "code": "VOICE-WRONG"}]
    assert result["kept"]


def test_a_mute_actor_is_an_error_with_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    actor = Rehearsal(lambda asked, before: np.zeros(0))
    monkeypatch.setattr(lesson_live, "RealClock", lambda: actor.clock)
    monkeypatch.setattr(
        lesson_live, "open_microphone", lambda *names: SimSoundIn(actor.world, actor.clock)
    )
    status, result = calibrate()
    assert status == 1
    assert result["error"]["code"] == "VOICE-SOFT"
    assert "Speak up" in result["error"]["remedy"]
    assert speaker.load_current() == (None, None)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("--sound", "radio"), "DRV-NAME"),
        (("--device", "hw:0"), "CFG-VALUE"),
        (("a.wav",), "VOICE-TAKES"),
        (("--dry-run",), "VOICE-TAKES"),
    ],
)
def test_what_cannot_be_meant_is_refused(arguments: tuple[str, ...], code: str) -> None:
    status, result = calibrate(*arguments)
    assert (status, result["error"]["code"]) == (2, code)


def test_a_process_is_used_where_time_is_real() -> None:
    from hypermask.workers.lesson_teacher import TeacherProcess
    from hypermask_drivers.clock import RealClock

    show = Rehearsal(lambda asked, before: np.zeros(0))
    assert show.worker._lesson._make is InlineTeacher
    real = VoiceWorker(
        SimSoundIn(show.world, RealClock()), Board.local(), RealClock(), lambda *said: None
    )
    assert real._lesson._make is TeacherProcess
