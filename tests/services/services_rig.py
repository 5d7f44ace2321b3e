"""A desk with small simulated devices, and what can be seen of its services from outside."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypermask.blackboard import Record
from hypermask.rehearsal.desk import Desk, wait_for
from hypermask.workers.board import Board
from hypermask.workers.health import Healths

SERVICES = ("stage", "tracker", "voice", "pantilt", "show", "dresser")
LONG_S = 45.0
"""So long a start may take on a machine that does much else."""

SCENARIO = """
name = "small"
character = "mean"
duration_s = 60
[performer]
motion = "sway"
voice = "none"
[camera]
width = 640
height = 400
focal_px = 450
rate_hz = 60
[projector]
width = 320
height = 180
focal_px = 480
rate_hz = 30
[microphone]
block_ms = 20
"""
OPTICS = {
    "camera": {"focal_px": 450.0, "width": 640, "height": 400},
    "projector": {"focal_px": 480.0, "width": 320, "height": 180, "centre_px": [159.5, 179.5]},
}


class Show(Desk):
    """The services of the machine `sim` with a small camera and a small projector."""

    def __init__(self, folder: Path, more_of_scenario: str = "", **machine: Any) -> None:
        scenario = folder / "small.toml"
        scenario.parent.mkdir(parents=True, exist_ok=True)
        scenario.write_text(SCENARIO + more_of_scenario, "utf-8")
        self.machine = {"scenario": str(scenario), "optics": OPTICS, **machine}
        super().__init__(folder, self.machine)
        self._opened: tuple[Board, Healths] | None = None

    def start_all(self) -> None:
        for name in SERVICES:
            self.start(name)
        for name in SERVICES:
            self.await_working(name)

    def _look(self) -> tuple[Board, Healths]:
        if self._opened is None:
            self._opened = Board.shared(self.board), Healths(self.board)
        return self._opened

    @property
    def records(self) -> Board:
        return self._look()[0]

    def look_anew(self) -> None:
        """After the blackboard was made anew."""
        self._opened = None

    def health(self, name: str) -> Record | None:
        """Of the process that runs now, None before its first word."""
        record = self._look()[1].all().get(name) if self.board.is_dir() else None
        process = self.processes.get(name)
        mine = record is not None and process is not None and int(record["pid"]) == process.pid
        return record if mine else None

    def last_health(self, name: str) -> Record:
        """Of whichever process of that name was the last."""
        return self._look()[1].all()[name]

    def await_working(self, name: str) -> Record:
        def working() -> Record | None:
            process = self.processes[name]
            if process.poll() is not None:
                raise AssertionError(f"{name} ended with {process.returncode}: {self.said(name)}")
            record = self.health(name)
            return record if record is not None and record["state"] == b"working" else None

        found: Record = wait_for(working, LONG_S, f"{name} at work")
        return found

    def await_health(self, name: str, wanted: Callable[[Record], bool], what: str) -> Record:
        def right() -> Record | None:
            record = self.health(name)
            return record if record is not None and wanted(record) else None

        found: Record = wait_for(right, LONG_S, what)
        return found

    def await_said(self, name: str, code: str) -> None:
        def said() -> bool:
            if self.processes[name].poll() is not None:
                raise AssertionError(f"{name} ended: {self.said(name)}")
            return code in self.said(name)

        wait_for(said, LONG_S, f"{code} of {name}")

    def await_more(self, name: str, steps: int = 5) -> None:
        """Until a service did more work than it had done when this was called."""
        before = int(self.await_working(name)["steps"])
        self.await_health(name, lambda record: record["steps"] >= before + steps, f"{name} goes on")


def now() -> float:
    return time.monotonic()
