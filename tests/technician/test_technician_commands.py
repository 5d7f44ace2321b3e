"""The technician's commands as a terminal of 80 columns shows them: one clear line for what is
wrong, the exit code, --json, never a traceback."""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from hypermask import paths
from hypermask.cli.main import app, main
from hypermask.show.engine import ShowEngine
from hypermask.show.showfile import load_show
from hypermask.technician import screen
from hypermask.workers.board import Board
from hypermask.workers.control import ControlServer, socket_path
from hypermask.workers.health import Health
from hypermask.workers.show import ShowWorker
from hypermask_drivers.clock import RealClock

DEFAULT = Path(__file__).parents[2] / "configs" / "shows" / "default.toml"
JSON_COMMANDS = (
    ("status",), ("doctor",), ("device", "list"), ("device", "probe", "lamp"), ("log",),
    ("cue", "wink"), ("cue", "--list"), ("blackout",), ("light", "0.5"), ("character", "noh"),
    ("head", "nod"), ("press", "5"), ("mode",), ("reload",),
)  # fmt: skip

COMMANDS = (
    "status", "doctor", "device", "log", "bundle", "cue", "blackout", "light", "character",
    "head", "press", "mode", "reload",
)  # fmt: skip


@pytest.fixture(autouse=True)
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("HOME", "RUN", "ETC"):
        monkeypatch.setenv(f"HYPERMASK_{name}", str(tmp_path / name.lower()))
        (tmp_path / name.lower()).mkdir()
    (tmp_path / "etc" / "machine.toml").write_text('machine = "sim"\n')
    monkeypatch.setattr(screen, "WINDOW_S", 0.0)
    return tmp_path


def hypermask(*arguments: str) -> Result:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert "Traceback" not in result.output
    return result


@pytest.fixture
def show(machine: Path) -> Iterator[ShowWorker]:
    """A show worker without a keypad, in a thread that serves the control socket."""
    clock = RealClock()
    board = Board.shared(machine / "run" / "board")
    server = ControlServer(socket_path())
    engine = ShowEngine(load_show(DEFAULT), clock.now())
    worker = ShowWorker(None, engine, board, clock, lambda *said: None, control=server)
    health = Health(board.folder, "show", clock)
    health.say("working")
    health.publish(now=True)
    over = threading.Event()

    def serve() -> None:
        while not over.wait(0.001):
            worker.step()

    thread = threading.Thread(target=serve)
    thread.start()
    yield worker
    over.set()
    thread.join()
    worker.stop()


@pytest.mark.parametrize(
    ("arguments", "code", "status"),
    [
        (("status",), "SHOW-NONE", 1),
        (("cue", "wink"), "CTL-NONE", 1),
        (("cue", "--list"), "CTL-NONE", 1),
        (("cue",), "CUE-NAME", 2),
        (("cue", "wink", "--list"), "CUE-NAME", 2),
        (("blackout",), "CTL-NONE", 1),
        (("blackout", "maybe"), "CTL-VALUE", 2),
        (("light", "0.5"), "CTL-NONE", 1),
        (("character", "noh"), "CTL-NONE", 1),
        (("head", "nod"), "CTL-NONE", 1),
        (("press", "5"), "CTL-NONE", 1),
        (("mode",), "CTL-NONE", 1),
        (("reload",), "CTL-NONE", 1),
        (("log",), "LOG-NONE", 1),
        (("log", "-n", "0"), "LOG-COUNT", 2),
        (("log", "--worker", "cook"), "LOG-WORKER", 2),
        (("device", "probe", "oven"), "DEV-KIND", 2),
        (("device", "test", "oven"), "DEV-KIND", 2),
        (("device", "test", "pantilt"), "DEV-MOVES", 2),
        (("bundle", "--out", "/dev/null/b.tar.gz"), "DISK-WRITE", 1),
    ],
)
def test_what_is_wrong_is_one_line(arguments: tuple[str, ...], code: str, status: int) -> None:
    result = hypermask(*arguments)
    assert result.exit_code == status
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"{code}: ") and result.stdout == ""
    told: Any = json.loads(hypermask(*arguments, "--json").stdout)
    assert told["error"]["code"] == code


@pytest.mark.parametrize(
    "arguments", [("light", "bright"), ("dance",), ("cue", "--now"), ("face", "build")]
)
def test_wrong_usage_is_json_where_json_is_asked_for(
    arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["hypermask", *arguments, "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "USAGE"


def test_json_has_the_exit_codes_of_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, code in ((("status",), 1), (("config", "show"), 0)):
        monkeypatch.setattr(sys, "argv", ["hypermask", *arguments, "--json"])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == code
        json.loads(capsys.readouterr().out)


def test_a_show_that_somebody_may_not_ask_is_not_called_absent(
    machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another's folder: as /run/hypermask for who is not in the group."""
    monkeypatch.delenv("HYPERMASK_RUN")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(machine))
    monkeypatch.setattr(paths, "APPLIANCE_RUN", machine / "run")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    stat_of = Path.stat

    def refused(path: Path, **options: bool) -> os.stat_result:
        if path.parent.is_relative_to(machine / "run"):
            raise PermissionError(13, "Permission denied")
        return stat_of(path, **options)

    monkeypatch.setattr(Path, "stat", refused)
    assert hypermask("status").stderr.startswith("BOARD-RIGHTS: ")
    server = ControlServer(machine / "run" / "control.sock")
    monkeypatch.setattr(
        socket.socket, "connect", lambda *where: (_ for _ in ()).throw(PermissionError(13, "no"))
    )
    assert hypermask("cue", "wink").stderr.startswith("CTL-RIGHTS: ")
    server.close()


@pytest.mark.parametrize("arguments", JSON_COMMANDS)
def test_every_command_speaks_json(show: ShowWorker, arguments: tuple[str, ...]) -> None:
    json.loads(hypermask(*arguments, "--json").stdout)


@pytest.mark.parametrize(
    "arguments", [("status",), ("doctor",), ("device", "list"), ("cue", "--list"), ("log",)]
)
def test_no_row_is_wider_than_a_terminal(
    show: ShowWorker, machine: Path, arguments: tuple[str, ...]
) -> None:
    rows = hypermask(*arguments).stdout.splitlines()
    assert all(len(row) <= 80 for row in rows), [row for row in rows if len(row) > 80]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str) -> None:
    result = hypermask(command, "--help")
    assert result.exit_code == 0 and len(result.stdout.splitlines()) > 5


def test_a_cue_is_called(show: ShowWorker) -> None:
    result = hypermask("cue", "anger")
    assert (result.exit_code, result.stdout) == (0, "The cue 'anger' is called.\n")
    assert bytes(show.engine.scene["mood"].item()) == b"anger"


def test_an_unknown_cue_is_wrong_usage(show: ShowWorker) -> None:
    result = hypermask("cue", "dance")
    assert result.exit_code == 2 and result.stderr.startswith("CUE-NAME: ")


def test_blackout_without_a_word_makes_it_dark(show: ShowWorker) -> None:
    assert hypermask("blackout").stdout == "The stage is dark.\n"
    assert hypermask("blackout").stdout == "The stage is dark.\n"
    assert hypermask("blackout", "toggle").stdout == "The stage is lit.\n"
    assert show.engine.blackout is False


def test_several_keys_are_pressed_in_turn(show: ShowWorker) -> None:
    rows = hypermask("press", "5", "numlock", "star").stdout.splitlines()
    assert rows == [
        "The key '5' is pressed. It calls 'happiness'.", "The key 'numlock' is pressed.",
        "The key 'star' is pressed. It calls 'character-next'.",
    ]  # fmt: skip


def test_the_head_is_told_where_to_look(show: ShowWorker) -> None:
    assert hypermask("head", "look", "--pan", "20").exit_code == 0
    assert float(show.engine.neck["pan_rad"]) == pytest.approx(0.349, abs=1e-3)
    assert hypermask("head", "look").exit_code == 2


def test_devices_of_the_running_show_are_asked_for(show: ShowWorker) -> None:
    result = hypermask("device", "probe", "lamp")
    assert result.exit_code == 1 and result.stderr.startswith("DEV-NONE")


def test_a_status_in_which_all_is_not_well_ends_with_1(show: ShowWorker) -> None:
    result = hypermask("status")
    assert result.exit_code == 1 and result.stdout.startswith("Not well: ")


def test_a_bundle_is_written(machine: Path) -> None:
    out = machine / "b.tar.gz"
    result = hypermask("bundle", "--out", str(out), "--json")
    assert result.exit_code == 0 and out.stat().st_size > 500
    assert "README.txt" in json.loads(result.stdout)["parts"]


def test_doctor_says_what_it_mended(machine: Path) -> None:
    before = hypermask("doctor")
    assert before.exit_code == 1 and "doctor --fix may mend" in before.stdout
    after = hypermask("doctor", "--fix")
    assert after.exit_code == 0, after.stdout
    assert "fixed folders: [made " in after.stdout
    assert hypermask("doctor").exit_code == 0
