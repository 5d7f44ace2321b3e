"""A service's messages: one line each for the journal, and a short file where there is none."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from pathlib import Path

from hypermask import paths

LARGEST_BYTES = 256 * 1024
"""An events file this large is put aside as `NAME.jsonl.1`, in the place of the one before."""
ERROR, WARNING, NOTICE, INFO = 3, 4, 5, 6
_FINE = ("-BACK", "-FOUND", "-PLAYS")
_NOTICES = ("MASK-", "CAL-TAKEN", "CUE", "CHAR-JOINS", "SVC-", "NOTE", "MODE-")
_LOUD = ("CFG-", "WRK-", "SHOW-FALLBACK")


def priority_of(code: str) -> int:
    """The journal's priority of a message by its code."""
    if code.startswith(_LOUD):
        return ERROR
    if code.endswith(_FINE) or code.startswith(_NOTICES):
        return INFO if code == "CUE" else NOTICE
    return WARNING


class Messages:
    """Called as a worker's `report`; `after` gets the code of what is wrong."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._path = paths.run() / "events" / f"{name}.jsonl"
        self.last_fault = ""

    def __call__(self, time_s: float, code: str, text: str) -> None:
        self.tell(code, text, time_s)

    def tell(
        self, code: str, text: str, time_s: float | None = None, priority: int | None = None
    ) -> None:
        """text may begin with its own code, as errors do."""
        priority = priority_of(code) if priority is None else priority
        if priority <= WARNING:
            self.last_fault = code
        line = " ".join(text.split())
        line = line if line.startswith(f"{code}:") else f"{code}: {line}"
        with contextlib.suppress(OSError, ValueError):
            print(f"<{priority}>{line}", file=sys.stderr, flush=True)
        self._keep(code, line, priority, time.monotonic() if time_s is None else time_s)

    def _keep(self, code: str, line: str, priority: int, time_s: float) -> None:
        """A full disk or a folder of somebody else's costs the file its line, nothing more."""
        entry = {
            "time_s": round(time_s, 3),
            "wall_s": round(time.time(), 3),
            "worker": self._name,
            "pid": os.getpid(),
            "priority": priority,
            "code": code,
            "text": line,
        }
        with contextlib.suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            if self._path.exists() and self._path.stat().st_size > LARGEST_BYTES:
                self._path.replace(self._path.with_name(f"{self._path.name}.1"))
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(entry, ensure_ascii=False) + "\n")


def events_folder() -> Path:
    return paths.run() / "events"
