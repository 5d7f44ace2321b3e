"""A service tells systemd that it lives only while its work advances."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hypermask.errors import DeviceLost, HypermaskError
from hypermask.services import service
from hypermask.services.messages import Messages
from hypermask.services.notify import Notifier
from hypermask.services.service import Service
from hypermask.workers.board import Board
from hypermask.workers.health import Health, Healths
from hypermask_drivers.clock import RealClock

WATCHDOG_S = 0.2


class Work:
    """Turns that advance or not, and end the service after `turns`."""

    def __init__(self, advances: bool, turns: int = 60, fails: bool = False) -> None:
        self.advances, self.left, self.fails = advances, turns, fails
        self.stopped = False

    def begin(self) -> None:
        """Nothing."""

    def turn(self) -> bool:
        time.sleep(0.005)
        self.left -= 1
        if self.left == 0:
            os.kill(os.getpid(), signal.SIGTERM)
        if self.fails and self.left < 50:
            raise DeviceLost("X-LOST", "it is gone", "Look.")
        return self.advances

    def status(self) -> str:
        return "at work"

    def stop(self) -> None:
        self.stopped = True


@pytest.fixture
def heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """systemd's end; 0.2 s is the watchdog's time."""
    for name in ("RUN", "HOME", "ETC"):
        monkeypatch.setenv(f"HYPERMASK_{name}", str(tmp_path / name))
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", "200000")
    before = [signal.getsignal(one) for one in (signal.SIGTERM, signal.SIGINT, signal.SIGALRM)]
    end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    end.bind(str(tmp_path / "notify"))
    end.setblocking(False)
    yield end
    signal.setitimer(signal.ITIMER_REAL, 0)
    for one, handler in zip((signal.SIGTERM, signal.SIGINT, signal.SIGALRM), before, strict=True):
        signal.signal(one, handler)
    end.close()


def lines(end: socket.socket) -> list[str]:
    found: list[str] = []
    while True:
        try:
            found += end.recv(4096).decode().splitlines()
        except BlockingIOError:
            return found


def served(work: Work, tmp_path: Path) -> int:
    board = Board.shared(tmp_path / "RUN" / "board")
    health = Health(board.folder, "tracker", RealClock())
    return Service(work, health, WATCHDOG_S).serve(Notifier(), Messages("tracker"))


def test_work_feeds_the_watchdog(heard: socket.socket, tmp_path: Path) -> None:
    assert served(Work(True), tmp_path) == service.STOPPED
    told = lines(heard)
    assert told[:3] == ["WATCHDOG_USEC=200000", "READY=1", "STATUS=at work"]
    assert told[-1] == "STOPPING=1"
    assert told.count("WATCHDOG=1") >= 3


def test_turning_without_work_does_not(heard: socket.socket, tmp_path: Path) -> None:
    served(Work(False), tmp_path)
    assert "WATCHDOG=1" not in lines(heard)


def test_what_fails_is_left_as_it_should_be(heard: socket.socket, tmp_path: Path) -> None:
    work = Work(True, fails=True)
    with pytest.raises(HypermaskError):
        served(work, tmp_path)
    assert work.stopped and lines(heard)[-1] == "STOPPING=1"
    assert Healths(tmp_path / "RUN" / "board").all()["tracker"]["state"] == b"stopped"


def test_without_systemd_nobody_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    monkeypatch.delenv("WATCHDOG_USEC", raising=False)
    notifier = Notifier()
    notifier.send("READY=1")
    assert notifier.watchdog_s is None


def test_anothers_watchdog_is_not_fed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "1000000")
    monkeypatch.setenv("WATCHDOG_PID", "1")
    assert Notifier().watchdog_s is None


def test_an_error_of_the_program_is_one_message_and_exit_code_1(
    heard: socket.socket, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*parts: object) -> None:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(service, "_set_up", broken)
    assert service.run("tracker") == service.FAILED
    said = capsys.readouterr().err
    assert said.startswith("<3>SVC-FAULT: the tracker service failed: ZeroDivisionError")
    assert said.count("\n") == 1
