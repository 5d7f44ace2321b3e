"""The real services as processes of this machine, with folders of their own and no hardware."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from hypermask.machine.toml import dumps

END_S = 5.0


class Desk:
    """Folders `run`, `home` and `etc`, and the services that were started with them.

    machine: what stands in `etc/machine.toml`, over the machine file `sim` unless it names another.
    """

    def __init__(self, folder: Path, machine: Mapping[str, Any] | None = None) -> None:
        self.run, self.home, self.etc = (folder / name for name in ("run", "home", "etc"))
        for path in (self.run, self.home, self.etc):
            path.mkdir(parents=True, exist_ok=True)
        self.configure({"machine": "sim", **(machine or {})})
        self.environment = os.environ | {
            "HYPERMASK_RUN": str(self.run),
            "HYPERMASK_HOME": str(self.home),
            "HYPERMASK_ETC": str(self.etc),
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        }
        self.environment.pop("NOTIFY_SOCKET", None)
        self.processes: dict[str, subprocess.Popen[str]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for name in list(self.processes):
            self.kill(name)

    @property
    def board(self) -> Path:
        return self.run / "board"

    def configure(self, table: Mapping[str, Any], name: str = "machine.toml") -> None:
        (self.etc / name).write_text(dumps(table), "utf-8")

    def start(self, name: str, **environment: str) -> subprocess.Popen[str]:
        """Begin a service; what it says is in `said`."""
        with self._log(name).open("a") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "hypermask.services", name],
                env=self.environment | environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                text=True,
            )
        self.processes[name] = process
        return process

    def said(self, name: str) -> str:
        """All messages of a service since the desk was set up."""
        log = self._log(name)
        return log.read_text("utf-8") if log.exists() else ""

    def stop(self, name: str) -> int:
        """SIGTERM; the exit code. One that does not end is killed."""
        process = self.processes.pop(name)
        process.terminate()
        try:
            return process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()

    def kill(self, name: str) -> None:
        process = self.processes.pop(name)
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.wait()

    def _log(self, name: str) -> Path:
        return self.run.parent / f"{name}.log"


def wait_for(wanted: Any, timeout_s: float, what: str, every_s: float = 0.01) -> Any:
    """The first true answer of `wanted()`. Raises `TimeoutError`."""
    deadline_s = time.monotonic() + timeout_s
    while True:
        found = wanted()
        if found:
            return found
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"{what} did not come in {timeout_s} s")
        time.sleep(every_s)
