"""`hypermask calibrate start`, `key`, `cancel`, `status`: what the technician types and reads."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from live_calibration_rig import LiveCart
from typer.testing import CliRunner

from hypermask.bench.runs import scenario
from hypermask.calibration import storage
from hypermask.calibration.outcome import Outcome
from hypermask.cli import calibrate as command
from hypermask.cli.main import app
from hypermask.rehearsal.cart import true_screen
from hypermask.workers import control
from hypermask_sim.world import World

SMALL = ("projector.width=640", "projector.height=400", "projector.focal_px=220")
HEAD = ("character=dots", "projector.rate_hz=20", "performer.keys=[]", *SMALL)


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("HYPERMASK_RUN", str(tmp_path / "run"))
    monkeypatch.setattr(command, "SETTLED_S", 0.0)
    return tmp_path


@pytest.fixture
def head(monkeypatch: pytest.MonkeyPatch) -> Iterator[LiveCart]:
    """A running show whose desk answers; a turn of the show passes before each answer."""
    live = LiveCart(scenario("maskbot", *HEAD))
    live.flip(2)

    def ask(request: dict[str, Any], *rest: object) -> dict[str, Any]:
        live.flip()
        return live.lockstep.show._commands.carry_out(request, live.cart.clock.now())

    monkeypatch.setattr(control, "ask", ask)
    yield live
    live.close()


def run(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["calibrate", *words])
    return result.exit_code, result.output


def test_started_steered_and_left_from_the_command_line(head: LiveCart) -> None:
    code, said = run("start")
    assert (code, head.active) == (0, True)
    assert "mark 1 of 35" in said
    before = head.session.view().cross_hair
    assert run("key", "6")[0] == 0
    assert head.session.view().cross_hair != before
    _, said = run("key", "enter")
    assert "mark 2 of 35" in said
    assert "mark 2 of 35" in run("status")[1]
    assert run("cancel")[0] == 0
    assert not head.active
    assert "No calibration is on." in run("status")[1]


def test_a_method_that_the_machine_cannot_do_and_one_that_nobody_knows(head: LiveCart) -> None:
    code, said = run("start", "--method", "click")
    assert code == 2
    assert "MODE-NAME" in said
    code, said = run("start", "--method", "magic")
    assert code == 2
    assert "CAL-METHOD" in said
    assert run("start", "--method", "fixed")[0] == 0
    code, said = run("start")
    assert code == 2
    assert "MODE-BUSY" in said


def test_what_is_in_use_is_told_also_without_a_show() -> None:
    code, said = run("status")
    assert code == 0
    assert "CAL-NONE" in said
    storage.save(Outcome(true_screen(World(scenario("maskbot"))), None, ()), "fixed")
    told = json.loads(run("status", "--json")[1])
    assert told["in_use"] == "0001-fixed.json"
    assert told["mode"] == ""
    assert told["warning"] is None


@pytest.mark.parametrize("words", [["start"], ["key", "5"], ["cancel"]])
def test_without_a_show_there_is_nothing_to_steer(words: list[str]) -> None:
    code, said = run(*words)
    assert code == 1
    assert "CTL-NONE" in said


def test_a_simulated_head_is_calibrated_and_stored() -> None:
    path = str(Path(__file__).parents[2] / "configs/scenarios/maskbot.toml")
    assignments = [word for item in SMALL for word in ("--set", item)]
    code, said = run("rehearse", path, *assignments)
    assert code == 0
    assert "mm expected on the screen" in said
    assert storage.load_current()[0].method == "fixed"
    assert "fixed" in run("history")[1]
