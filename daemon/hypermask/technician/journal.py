"""What the workers said: from systemd's journal where there is one, else from their own files."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from hypermask import paths
from hypermask.errors import HypermaskError, UsageError
from hypermask.technician.units import Run, run

WORKERS = ("stage", "tracker", "voice", "pantilt", "show", "dresser", "safe")
MOST = 100_000
_NAMES = {3: "ERROR", 4: "warn", 5: "", 6: "", 7: ""}


@dataclass(frozen=True)
class Said:
    """wall_s: seconds since 1970 by the machine's clock, which may be wrong; priority: syslog's."""

    wall_s: float
    worker: str
    priority: int
    text: str

    def row(self) -> str:
        """Time of day, worker and text, in one line."""
        moment = datetime.fromtimestamp(self.wall_s)
        stamp = (
            f"{moment:%H:%M:%S}"
            if abs(time.time() - self.wall_s) < 43200
            else (f"{moment:%Y-%m-%d %H:%M:%S}")
        )
        mark = _NAMES.get(self.priority, "ERROR")
        return f"{stamp} {self.worker:8} {mark + ' ' if mark else ''}{self.text}"

    def as_data(self) -> dict[str, Any]:
        return {
            "wall_s": round(self.wall_s, 3),
            "worker": self.worker,
            "priority": self.priority,
            "text": self.text,
        }


def said(
    count: int,
    worker: str | None = None,
    run_it: Run = run,
    has_journal: Callable[[], bool] | None = None,
) -> list[Said]:
    """The last `count` messages, oldest first.

    Raises `UsageError` LOG-WORKER, LOG-COUNT, `HypermaskError` LOG-NONE where nothing is kept.
    """
    if worker is not None and worker not in WORKERS:
        raise UsageError(
            "LOG-WORKER", f"there is no worker '{worker}'", f"Workers: {', '.join(WORKERS)}."
        )
    if not 1 <= count <= MOST:
        raise UsageError("LOG-COUNT", f"{count} messages are not possible", f"Say 1 to {MOST}.")
    if (has_journal or _has_journal)():
        found = from_journal(count, worker, run_it)
        if found:
            return found
    found = from_files(worker)[-count:]
    if not found:
        raise HypermaskError(
            "LOG-NONE",
            "no message of a show can be read on this machine",
            "Start a show; to read the journal join the group systemd-journal, or use sudo.",
        )
    return found


def _has_journal() -> bool:
    return shutil.which("journalctl") is not None and Path("/run/systemd/system").is_dir()


def from_journal(count: int, worker: str | None, run_it: Run = run) -> list[Said]:
    """Of systemd's journal, empty where it may not be read."""
    unit = f"hypermask-{worker}.service" if worker else "hypermask*"
    code, output = run_it(
        [
            "journalctl",
            "--no-pager",
            "--quiet",
            "--output=json",
            f"--lines={count}",
            f"--unit={unit}",
        ]
    )
    return [one for one in map(_from_json, output.splitlines()) if one] if code == 0 else []


def _from_json(line: str) -> Said | None:
    try:
        entry = json.loads(line)
        message = entry["MESSAGE"]
        if isinstance(message, list):  # bytes that are no text
            message = bytes(message).decode(errors="replace")
        unit = str(entry.get("_SYSTEMD_UNIT") or entry.get("UNIT") or "systemd")
        wall_s = int(entry["__REALTIME_TIMESTAMP"]) / 1e6
        priority = int(entry.get("PRIORITY", 6))
    except (ValueError, KeyError, TypeError):
        return None
    name = unit.removeprefix("hypermask-").removesuffix(".service")
    return Said(wall_s, name, priority, printable(str(message)))


def from_files(worker: str | None = None, folder: Path | None = None) -> list[Said]:
    """Of the workers' own files, also those put aside; a damaged line is left out."""
    folder = folder or paths.run() / "events"
    found = []
    for suffix in (".jsonl.1", ".jsonl"):
        for path in sorted(folder.glob(f"{worker or '*'}{suffix}")):
            found += [one for one in map(_from_event, _lines(path)) if one]
    # By the clock that never jumps: the other may have begun in 1970.
    return [one for _, one in sorted(found, key=lambda pair: pair[0])]


def _lines(path: Path) -> Sequence[str]:
    try:
        return path.read_text("utf-8", errors="replace").splitlines()
    except OSError:
        return ()


def _from_event(line: str) -> tuple[float, Said] | None:
    """With its moment of CLOCK_MONOTONIC: the folder does not outlive a boot."""
    try:
        entry = json.loads(line)
        return float(entry["time_s"]), Said(
            float(entry["wall_s"]),
            str(entry["worker"]),
            int(entry["priority"]),
            printable(str(entry["text"])),
        )
    except (ValueError, KeyError, TypeError):
        return None


def printable(text: str) -> str:
    """One line without control characters, which would play tricks on a terminal."""
    return "".join(sign if sign.isprintable() else " " for sign in text).strip()
