"""What systemd says of the services."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

WORKERS = ("stage", "tracker", "voice", "pantilt", "show", "dresser")
TARGET = "hypermask.target"
SAFE = "hypermask-safe.service"
Run = Callable[[Sequence[str]], tuple[int, str]]
"""Runs a program: its exit code and output."""
_TIMEOUT_S = 20


@dataclass(frozen=True)
class Unit:
    """enabled: as `systemctl is-enabled` says; result: why it ended, `success` or a word."""

    name: str
    active: str
    sub: str
    result: str
    restarts: int
    enabled: str

    @property
    def there(self) -> bool:
        return self.active != "" and self.enabled != "not-found"


def run(command: Sequence[str]) -> tuple[int, str]:
    """Never raises: a program that is absent or hangs has exit code 127."""
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_TIMEOUT_S,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return 127, str(error)
    return done.returncode, done.stdout + done.stderr


def booted(root: Path = Path("/")) -> bool:
    """Whether systemd runs this machine (sd_booted(3))."""
    return (root / "run/systemd/system").is_dir() and shutil.which("systemctl") is not None


def unit_names() -> tuple[str, ...]:
    return (TARGET, *(f"hypermask-{name}.service" for name in WORKERS), SAFE)


def units(names: Sequence[str] | None = None, run_it: Run = run) -> dict[str, Unit]:
    """By name; those that systemd does not know are left out."""
    keys = ("Id", "LoadState", "ActiveState", "SubState", "Result", "NRestarts", "UnitFileState")
    asked = ["systemctl", "show", f"--property={','.join(keys)}", *(names or unit_names())]
    code, output = run_it(asked)
    found = {}
    for block in output.split("\n\n") if code == 0 else ():
        table = dict(line.split("=", 1) for line in block.splitlines() if "=" in line)
        if table.get("LoadState") in ("loaded", "masked"):
            unit = _unit(table)
            found[unit.name] = unit
    return found


def _unit(table: dict[str, str]) -> Unit:
    count = table.get("NRestarts", "")
    return Unit(
        table.get("Id", ""),
        table.get("ActiveState", ""),
        table.get("SubState", ""),
        table.get("Result", "success"),
        int(count) if count.isdigit() else 0,
        table.get("UnitFileState", ""),
    )
