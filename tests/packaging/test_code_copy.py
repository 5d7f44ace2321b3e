"""The running show's own copy of the program: debian/libexec/code, run as the service runs it."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "debian" / "libexec" / "code"


class Machine:
    def __init__(self, folder: Path) -> None:
        self.share, self.run = folder / "share", folder / "run"
        self.share.mkdir()
        self.run.mkdir()
        self.publish("1")

    def publish(self, version: str) -> None:
        (self.share / "release").write_text(f"{version}+abc\n", "utf-8")
        (self.share / "code.py").write_text(version, "utf-8")

    def start(self) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["sh", str(SCRIPT)],
            env={
                **os.environ,
                "HYPERMASK_SHARE": str(self.share),
                "HYPERMASK_RUN": str(self.run),
            },
            capture_output=True,
            text=True,
        )

    @property
    def code(self) -> str:
        return (self.run / "code" / "code.py").read_text("utf-8")


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def test_an_upgrade_does_not_change_the_running_copy(machine: Machine) -> None:
    assert machine.start().returncode == 0
    machine.publish("2")
    assert machine.code == "1"


def test_a_new_start_takes_the_new_code_and_only_that(machine: Machine) -> None:
    machine.start()
    machine.publish("2")
    assert machine.start().returncode == 0
    assert machine.code == "2"
    assert [path.name for path in (machine.run / "versions").iterdir()] == ["2+abc"]


def test_the_blackboard_lives_as_long_as_its_code(machine: Machine) -> None:
    machine.start()
    board = machine.run / "board" / "scene"
    board.parent.mkdir()
    board.touch()
    machine.start()
    assert board.exists()
    machine.publish("2")
    machine.start()
    assert not board.exists()


def test_two_builds_of_one_version_are_two_releases(machine: Machine) -> None:
    machine.start()
    (machine.share / "release").write_text("1+def\n", "utf-8")
    (machine.share / "code.py").write_text("1 again", "utf-8")
    machine.start()
    assert machine.code == "1 again"


def test_an_interrupted_copy_is_made_again(machine: Machine) -> None:
    half = machine.run / "versions" / ".new"
    half.mkdir(parents=True)
    (half / "release").touch()
    assert machine.start().returncode == 0
    assert machine.code == "1"
    assert not half.exists()


def test_without_room_the_installed_program_plays(machine: Machine) -> None:
    (machine.run / "versions").write_text("in the way", "utf-8")
    done = machine.start()
    assert done.returncode == 0
    assert "UPD-COPY" in done.stderr
    assert machine.code == "1" and (machine.run / "code").resolve() == machine.share
