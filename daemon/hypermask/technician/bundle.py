"""The archive for support: what helps to find a fault, and nothing about people.

In it are only texts that are written here, each through `redact`: no photograph, no recording and
no file of the user's is copied.
"""

from __future__ import annotations

import io
import platform
import sys
import tarfile
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

from hypermask import paths
from hypermask.errors import HypermaskError
from hypermask.storage import write_atomically
from hypermask.technician.journal import Said, from_files, from_journal
from hypermask.technician.redact import OURS, Redactor, own_words
from hypermask.technician.units import Run, run

MODULES = (
    "hypermask", "numpy", "opencv-contrib-python-headless", "moderngl", "glcontext", "pydantic",
    "typer", "pyserial", "smbus2", "hidapi", "pyusb", "pyalsaaudio",
)  # fmt: skip
PACKAGES = ("hypermask", "hypermask-sim", "linux-image-*", "libgl1-mesa-dri", "systemd")
_LINES, _KERNEL_LINES = 4000, 600
_README = """HYPERMASK support bundle
Taken out: photographs, recordings, passwords, networks, addresses, host and user names,
serial numbers, names of people's characters and voices. Look through it before you send it.
"""


def make(out: Path, run_it: Run = run) -> list[str]:
    """Write the archive; returns the names of what is in it.

    Raises `HypermaskError` DISK-WRITE.
    """
    clean = Redactor(_guests() | _others() | own_words(home=paths.home()))
    parts: dict[str, Callable[[], str]] = {
        "README.txt": lambda: _README,
        "versions.txt": lambda: _versions(run_it),
        "status.json": lambda: clean.json(_status()),
        "doctor.json": lambda: clean.json(_doctor()),
        "config.toml": lambda: _configuration(clean),
        "calibrations.json": lambda: clean.json(_calibrations()),
        "characters.json": lambda: clean.json(_characters()),
        "faults.json": lambda: clean.json(_faults()),
        "events.txt": lambda: _rows(from_files()),
        "journal.txt": lambda: _rows(from_journal(_LINES, None, run_it)),
        "units.txt": lambda: _output(
            run_it, "systemctl", "status", "--no-pager", "--lines=0", "--full", "hypermask*"
        ),
        "kernel.txt": lambda: _last(_output(run_it, "dmesg"), _KERNEL_LINES),
        "usb.txt": lambda: _output(run_it, "lsusb"),
        "disk.txt": lambda: _output(run_it, "df", "-h", str(paths.home()), str(paths.run())),
    }
    written = {
        name: clean(_safely(part), versions=name == "versions.txt") for name, part in parts.items()
    }
    write_atomically(out, _packed(written))
    out.chmod(0o600)
    return list(written)


def _others() -> dict[str, str]:
    """Machines with which this one talks: their names have no form by which they could be known."""
    from hypermask.machine.files import load

    try:
        stream = load().machine.stream
    except HypermaskError:
        return {}
    return dict.fromkeys((stream.send.host, stream.receive.host, *stream.receive.senders), "[host]")


def _guests() -> dict[str, str]:
    """Characters on the blackboard that did not come with the program."""
    from hypermask.workers.board import Board
    from hypermask.workers.running import running_board

    try:
        board = Board.reading(running_board())
    except HypermaskError:
        return {}
    wardrobe, scene = board.wardrobe.latest(), board.scene.latest()
    names = [] if wardrobe is None else [entry["name"].decode() for entry in wardrobe["costumes"]]
    names += [] if scene is None else [name.decode() for name in scene["characters"]]
    return dict.fromkeys((name for name in names if name and name not in OURS), "[character]")


def _packed(parts: dict[str, str]) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as archive:
        for name, text in parts.items():
            data = text.encode()
            entry = tarfile.TarInfo(f"hypermask-bundle/{name}")
            entry.size, entry.mode, entry.mtime = len(data), 0o644, int(time.time())
            archive.addfile(entry, io.BytesIO(data))
    return buffer.getvalue()


def _safely(part: Callable[[], str]) -> str:
    """What cannot be found out says why: the rest of the bundle is worth having."""
    try:
        return part()
    except HypermaskError as error:
        return str(error)
    except Exception as error:
        return f"could not be found out: {type(error).__name__}: {error}"


def _output(run_it: Run, *command: str) -> str:
    code, output = run_it(command)
    return output if code == 0 or output else f"{command[0]} ended with code {code}"


def _last(text: str, count: int) -> str:
    return "\n".join(text.splitlines()[-count:])


def _rows(messages: list[Said]) -> str:
    return "\n".join(one.row() for one in messages[-_LINES:]) or "none"


def _versions(run_it: Run) -> str:
    rows = [
        f"Python {sys.version.split()[0]}",
        f"kernel {platform.release()} {platform.machine()}",
        f"system {_system()}",
        f"up {time.monotonic() / 3600:.2f} h",
        f"clock says {time.strftime('%Y-%m-%d', time.gmtime())}",
    ]
    for name in MODULES:
        try:
            rows.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            continue
    form = "--showformat=${Package} ${Version} ${db:Status-Status}\n"
    return "\n".join(rows) + "\n" + run_it(["dpkg-query", "-W", form, *PACKAGES])[1]


def _system() -> str:
    try:
        return platform.freedesktop_os_release().get("PRETTY_NAME", "unknown")
    except OSError:
        return "unknown"


def _status() -> Any:
    from hypermask.technician.screen import survey
    from hypermask.workers.running import running_board

    return survey(running_board()).as_data()


def _doctor() -> Any:
    from dataclasses import asdict

    from hypermask.technician.doctor import examine

    return [asdict(finding) for finding in examine()]


def _configuration(clean: Redactor) -> str:
    """All layers in one, without comments, or why there is none."""
    from hypermask.machine.files import complaint, layer_paths, load
    from hypermask.machine.toml import dumps

    loaded = load()
    head = [f"# {path.name}" for path in layer_paths()]
    head += [f"# {complaint(loaded)}"] if loaded.problem is not None else []
    data = clean.data(loaded.machine.model_dump(mode="json", exclude_unset=True))
    return "\n".join([*head, dumps(data)])


def _calibrations() -> Any:
    from hypermask.calibration import storage

    return [
        {
            "name": entry.name,
            "current": entry.current,
            "expected_mm": None if entry.stored is None else entry.stored.expected_mm,
            "problem": entry.problem,
        }
        for entry in storage.history()
    ]


def _characters() -> Any:
    """How many, not who."""
    from hypermask.face.character import known_characters

    made = [path for path in (paths.home() / "characters").glob("*") if path.is_dir()]
    return {"known": len(known_characters()), "made_here": len(made)}


def _faults() -> Any:
    """What services died of (`hypermask.faults`)."""
    import json

    found = []
    for path in sorted((paths.home() / "faults").glob("*.json"))[-50:]:
        try:
            found.append(json.loads(path.read_text("utf-8")))
        except (OSError, ValueError):
            found.append({"file": path.name, "problem": "cannot be read"})
    return found
