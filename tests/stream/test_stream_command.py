"""`hypermask stream`, as a technician meets it."""

import json
import socket
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from hypermask.cli import stream

app = typer.Typer()
app.add_typer(stream.app, name="stream")


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path / "home"))


def run(*arguments: str) -> tuple[int, list[dict]]:
    result = CliRunner().invoke(app, ["stream", *arguments, "--json"])
    lines = result.stdout.strip()
    if result.exit_code:
        return result.exit_code, [json.loads(lines[: lines.rindex("}") + 1])]
    return result.exit_code, [json.loads(line) for line in lines.splitlines()]


def test_a_second_of_sending(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = str(other.getsockname()[1])
        code, lines = run("send", "--port", port, "--board", str(tmp_path), "--seconds", "0.3")
        assert code == 0 and lines[-1]["result"]["sent"] >= 1
        assert len(other.recv(2048)) <= 68
    assert (tmp_path / "home" / "stream-sent").exists()


def test_receiving_nothing_says_absent(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    code, lines = run("receive", "--port", port, "--board", str(tmp_path), "--seconds", "0.05")
    assert code == 0 and lines[-1]["result"]["state"] == "absent"


@pytest.mark.parametrize(
    ("arguments", "code", "exit_code"),
    [
        (("send", "--host", "no such host"), "STREAM-HOST", 1),
        (("receive", "--host", "192.0.2.1"), "STREAM-PORT", 1),
        (("send", "--key-file", "/nowhere/key"), "STREAM-KEY", 2),
        (("send", "--port", "0"), "CFG-VALUE", 2),
        (("receive", "--machine", "/nowhere.toml"), "CFG-ABSENT", 2),
    ],
)
def test_mistakes_are_told_in_one_line(
    tmp_path: Path, arguments: tuple[str, ...], code: str, exit_code: int
) -> None:
    given, lines = run(*arguments, "--board", str(tmp_path), "--seconds", "0.1")
    assert given == exit_code and lines[0]["error"]["code"] == code
