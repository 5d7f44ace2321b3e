"""Calibrations on disk: every one is kept, one is current, a damaged one is never silent.

Folder `paths.home()/calibration`: `0007-click.json` (number and method), `current` with the name
of the one in use, `progress.json` of an interrupted session. Numbers, not dates, give the order:
a board without a battery clock may boot in 1970. Every file carries a format version and the
SHA-256 of its content.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hypermask import paths
from hypermask.calibration import records
from hypermask.calibration.fixed import Fixed
from hypermask.calibration.outcome import Outcome
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.placements import Placement
from hypermask.calibration.planar import Planar
from hypermask.errors import DataError
from hypermask.storage import write_atomically

VERSION = 1
CURRENT = "current"
PROGRESS = "progress.json"


@dataclass(frozen=True)
class Stored:
    """One calibration of the history; method: click, affine, projective or fixed; made: UTC."""

    name: str
    method: str
    made: datetime
    expected_mm: float
    lines: tuple[str, ...]
    calibration: ProCam | Planar | Fixed
    placements: tuple[Placement, ...]


@dataclass(frozen=True)
class Entry:
    """One line of the history: `stored`, or `problem` where its file cannot be used."""

    name: str
    current: bool
    stored: Stored | None
    problem: str | None


def folder() -> Path:
    return paths.home() / "calibration"


def save(outcome: Outcome, method: str, made: datetime | None = None) -> Path:
    """Store a calibration and make it the current one.

    Raises `HypermaskError` DISK-WRITE; the current one is then unchanged.
    """
    number = max((_number(path) for path in _files()), default=0) + 1
    path = folder() / f"{number:04d}-{method}.json"
    made = made or datetime.now(UTC)
    content = {"method": method, "made": made.isoformat(timespec="seconds"), **_content(outcome)}
    write_atomically(path, _sealed(content))
    use(path.name)
    return path


def _content(outcome: Outcome) -> records.Table:
    return {
        "expected_mm": outcome.expected_mm,
        "lines": outcome.lines(),
        "quality": asdict(outcome.quality) if outcome.quality is not None else None,
        "calibration": records.calibration_table(outcome.calibration),
        "placements": [records.placement_table(p) for p in outcome.placements],
    }


def use(name: str) -> Stored:
    """Make a stored calibration the current one. Raises `DataError` CAL-READ, CAL-NAME."""
    path = folder() / name
    if path not in _files():
        raise DataError(
            "CAL-NAME", f"there is no calibration '{name}'", f"Known: {_names() or 'none'}."
        )
    stored = read(path)
    write_atomically(folder() / CURRENT, f"{name}\n".encode())
    return stored


def read(path: Path) -> Stored:
    """Raises `DataError` CAL-READ: unreadable, truncated, altered, or of a newer version."""
    content = _opened(path)
    try:
        method = content["method"]
        return Stored(
            path.name,
            method,
            datetime.fromisoformat(content["made"]),
            float(content["expected_mm"]),
            tuple(content["lines"]),
            records.calibration_from(method, content["calibration"]),
            tuple(records.placement_from(table) for table in content["placements"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise _unreadable(path, f"a value is wrong ({error})") from error


def load_current() -> tuple[Stored, str | None]:
    """The calibration to use, and a warning where it is not the one that should be.

    Where the current file is damaged the newest good one is used, and the warning says so.
    Raises `DataError` CAL-NONE (never calibrated) or CAL-READ (no file can be used).
    """
    wanted = _pointed()
    problem: DataError | None = None
    files = sorted(_files(), key=_number, reverse=True)
    if not files:
        raise DataError(
            "CAL-NONE", "the cart is not calibrated", "Calibrate it (hypermask calibrate)."
        )
    if wanted is not None and wanted not in files:
        problem = _unreadable(wanted, "the file is gone")
    if wanted in files:
        files.remove(wanted)
        files.insert(0, wanted)
    for path in files:
        try:
            stored = read(path)
        except DataError as error:
            problem = problem or error
            continue
        if problem is None:
            return stored, None
        return stored, (
            f"{problem.code}: {problem.what}. "
            f"The last good one, {stored.name} of {stored.made:%Y-%m-%d %H:%M}, is used."
        )
    assert problem is not None
    raise problem


def history() -> list[Entry]:
    """All calibrations, newest first, damaged ones included."""
    in_use = _in_use()
    entries = []
    for path in sorted(_files(), key=_number, reverse=True):
        try:
            entries.append(Entry(path.name, path.name == in_use, read(path), None))
        except DataError as error:
            entries.append(Entry(path.name, False, None, error.what))
    return entries


def rollback() -> Stored:
    """Make the good calibration before the current one the current one.

    Raises `DataError` CAL-ROLLBACK where there is none.
    """
    good = [entry for entry in history() if entry.stored is not None]
    names = [entry.name for entry in good]
    here = next((i for i, entry in enumerate(good) if entry.current), -1)
    if here + 1 >= len(good):
        raise DataError(
            "CAL-ROLLBACK", "there is no earlier calibration to go back to", "Calibrate anew."
        )
    return use(names[here + 1])


def save_progress(snapshot: dict[str, Any]) -> None:
    """Keep an unfinished session. Raises `HypermaskError` DISK-WRITE."""
    write_atomically(folder() / PROGRESS, _sealed(snapshot))


def load_progress() -> dict[str, Any] | None:
    """The interrupted session's snapshot, or None. Raises `DataError` CAL-READ where damaged."""
    path = folder() / PROGRESS
    return _opened(path) if path.exists() else None


def clear_progress() -> None:
    """The session is finished or given up."""
    (folder() / PROGRESS).unlink(missing_ok=True)


def _sealed(content: dict[str, Any]) -> bytes:
    body = {"format": "hypermask-calibration", "version": VERSION, "content": content}
    body["sha256"] = _digest(content)
    return (json.dumps(body, indent=1, allow_nan=False) + "\n").encode()


def _digest(content: Any) -> str:
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()


def _opened(path: Path) -> dict[str, Any]:
    try:
        body = json.loads(path.read_bytes())
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from error
    except ValueError as error:
        raise _unreadable(path, "it is cut short or not JSON") from error
    if not isinstance(body, dict) or body.get("format") != "hypermask-calibration":
        raise _unreadable(path, "it is not a calibration")
    if body.get("version") != VERSION:
        raise _unreadable(path, f"its version is {body.get('version')}, known is {VERSION}")
    content = body.get("content")
    if not isinstance(content, dict) or body.get("sha256") != _digest(content):
        raise _unreadable(path, "its checksum is wrong")
    return content


def _unreadable(path: Path, why: str) -> DataError:
    return DataError(
        "CAL-READ",
        f"the calibration {path} cannot be used: {why}",
        "Go back to an earlier one (hypermask calibrate rollback) or calibrate anew.",
    )


def _files() -> list[Path]:
    return [path for path in folder().glob("*-*.json") if _number(path) > 0]


def _number(path: Path) -> int:
    head = path.name.partition("-")[0]
    return int(head) if head.isascii() and head.isdigit() else 0


def _names() -> str:
    return ", ".join(sorted(path.name for path in _files()))


def _pointed() -> Path | None:
    """What the pointer names; None where there is no pointer or it makes no sense."""
    try:
        name = (folder() / CURRENT).read_text("utf-8").strip()
    except (OSError, UnicodeDecodeError):
        return None
    return folder() / name if name and "/" not in name else None


def _in_use() -> str | None:
    try:
        return load_current()[0].name
    except DataError:
        return None
