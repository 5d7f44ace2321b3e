"""Puts on record why a service was given up: `python3 -m hypermask.faults UNIT`.

systemd's OnFailure tells how it ended in `$MONITOR_*` (systemd.exec(5)). One JSON file a fault in
`paths.home()/faults`, numbered, because a board without a battery clock may boot in 1970.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hypermask import paths
from hypermask.errors import HypermaskError
from hypermask.storage import write_atomically

VERSION = 1
KEPT = 50
LINES = 20
_HOW = {
    "watchdog": "its work stood still",
    "signal": "it was ended by a signal",
    "core-dump": "it crashed",
    "exit-code": "it ended with a fault",
    "timeout": "it did not start or stop in time",
    "oom-kill": "the memory was full",
    "start-limit-hit": "it failed too often",
    "resources": "the system refused what it needs",
}


def folder() -> Path:
    return paths.home() / "faults"


def record(unit: str, environment: Mapping[str, str], last: list[str]) -> Path:
    """last: what the service said last. Returns the file. Raises `HypermaskError` DISK-WRITE."""
    result = environment.get("MONITOR_SERVICE_RESULT", "unknown")
    content: dict[str, Any] = {
        "version": VERSION,
        "unit": unit,
        "result": result,
        "how": _HOW.get(result, "it failed"),
        "exit_code": environment.get("MONITOR_EXIT_CODE", ""),
        "exit_status": environment.get("MONITOR_EXIT_STATUS", ""),
        "monotonic_s": round(time.monotonic(), 3),
        "utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "last": last,
    }
    numbers = [int(path.name[:6]) for path in _files()]
    path = folder() / f"{max(numbers, default=0) + 1:06d}-{unit}.json"
    write_atomically(path, json.dumps(content, indent=1, ensure_ascii=False).encode() + b"\n")
    for old in sorted(_files())[:-KEPT]:
        old.unlink(missing_ok=True)
    return path


def latest() -> dict[str, Any] | None:
    """The last record that can be read."""
    for path in sorted(_files(), reverse=True):
        with contextlib.suppress(OSError, ValueError):
            content = json.loads(path.read_text("utf-8"))
            if isinstance(content, dict):
                return content
    return None


def _files() -> list[Path]:
    return list(folder().glob("[0-9][0-9][0-9][0-9][0-9][0-9]-*.json"))


def last_words(unit: str) -> list[str]:
    """From the journal, or else from the service's own events file."""
    with contextlib.suppress(OSError, subprocess.TimeoutExpired):
        command = ["journalctl", "--no-pager", "-q", "-o", "cat", "-n", str(LINES), "-u", unit]
        told = subprocess.run(command, capture_output=True, text=True, timeout=20)
        if told.stdout.strip():
            return told.stdout.splitlines()[-LINES:]
    events = paths.run() / "events" / f"{unit.removeprefix('hypermask-')}.jsonl"
    with contextlib.suppress(OSError, ValueError):
        lines = events.read_text("utf-8").splitlines()[-LINES:]
        return [str(json.loads(line)["text"]) for line in lines]
    return []


def main(arguments: list[str]) -> int:
    if len(arguments) != 1:
        print("usage: python3 -m hypermask.faults UNIT", file=sys.stderr)
        return 2
    unit = arguments[0].removesuffix(".service")
    try:
        path = record(unit, os.environ, last_words(unit))
    except HypermaskError as error:
        print(f"<3>{error}", file=sys.stderr)
        return error.exit_code
    how = json.loads(path.read_text("utf-8"))["how"]
    print(f"<2>SVC-GIVENUP: {unit} was given up: {how}. See {path}.", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
