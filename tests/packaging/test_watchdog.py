"""How long a service may stand still: the machine file's word counts, not the unit's."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from hypermask.services.notify import Notifier


@pytest.fixture
def systemd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> socket.socket:
    end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    end.bind(str(tmp_path / "notify"))
    end.setblocking(False)
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", "5000000")
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()))
    return end


def test_the_units_patience_is_replaced_by_the_machines(systemd: socket.socket) -> None:
    notifier = Notifier()
    assert notifier.watchdog_s == 5.0
    notifier.watch(20.0)
    assert systemd.recv(1000) == b"WATCHDOG_USEC=20000000"
    assert notifier.watchdog_s == 20.0


def test_zero_switches_it_off(systemd: socket.socket) -> None:
    notifier = Notifier()
    notifier.watch(0.0)
    assert systemd.recv(1000) == b"WATCHDOG_USEC=0"
    assert notifier.watchdog_s is None


def test_nobody_is_asked_where_nobody_listens(
    systemd: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("WATCHDOG_USEC")
    notifier = Notifier()
    notifier.watch(20.0)
    with pytest.raises(BlockingIOError):
        systemd.recv(1000)
