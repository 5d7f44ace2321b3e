"""Everything about a running show on one screen of 80 columns."""

from __future__ import annotations

import math
import textwrap
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hypermask.blackboard import Record
from hypermask.errors import HypermaskError
from hypermask.technician.crew import OWNS, Member, crew, short
from hypermask.workers.health import Healths
from hypermask.workers.status import Line, Status, look

WIDTH = 80
WINDOW_S = 1.1
"""Two looks so far apart make the rates; health is written twice a second."""
_NAMED = 9


@dataclass(frozen=True)
class Screen:
    """configuration: one line about the machine's files; crew: empty in a rehearsal."""

    status: Status
    crew: tuple[Member, ...] = ()
    extra: tuple[Line, ...] = field(default=())

    @property
    def lines(self) -> tuple[Line, ...]:
        return (*self.status.lines, *self.extra)

    @property
    def fine(self) -> bool:
        return all(line.fine for line in self.lines) and all(one.fine for one in self.crew)

    @property
    def headline(self) -> str:
        """How it is, in a few words."""
        bad = [one.name for one in self.crew if not one.fine]
        bad += [line.name for line in self.lines if not line.fine and line.name not in bad]
        if self.crew and all(one.state == "stopped" for one in self.crew):
            return "The show is stopped."
        if not bad:
            return "All is well."
        return f"Not well: {', '.join(bad)}."[:WIDTH]

    def as_data(self) -> dict[str, Any]:
        return {
            "fine": self.fine,
            "headline": self.headline,
            "workers": {one.name: _member_data(one) for one in self.crew},
            "lines": {line.name: line.as_data() for line in self.lines},
        }

    def rows(self) -> list[str]:
        """Plain text, no row wider than `WIDTH`."""
        rows = [self.headline, "", *_table(self.crew), ""] if self.crew else []
        for line in self.lines:
            rows += _wrapped("ok" if line.fine else "!!", line.name, line.text)
        return rows


def survey(folder: Path, window_s: float | None = None) -> Screen:
    """Look at the show whose blackboard is in `folder`; window_s: between the two looks.

    Raises `HypermaskError` BOARD-*.
    """
    healths = Healths(folder)
    before = healths.all()
    if before:
        time.sleep(WINDOW_S if window_s is None else window_s)
    settings, configuration = _configuration()
    after, now_s = healths.all(), time.monotonic()
    return Screen(
        look(folder, now_s),
        tuple(one for one in crew(after, now_s, settings, before) if one.name != "safe")
        if after
        else (),
        (*(_safe(after, now_s)), *((configuration,) if after else ()), _disk()),
    )


def _configuration() -> tuple[tuple[str, ...] | None, Line]:
    """The kinds of device of this machine, and whether its files are good."""
    from hypermask.machine.files import complaint, layer_paths, load
    from hypermask.machine.settings import DEVICES

    try:
        loaded = load()
    except HypermaskError as error:
        return None, Line("config", False, str(error), {"origin": "none"})
    kinds = tuple(kind for kind in DEVICES if loaded.machine.device(kind) is not None)
    files = ", ".join(path.name for path in layer_paths()) or "packaged"
    figures = {"machine": loaded.machine.name, "origin": loaded.origin}
    if loaded.problem is None:
        text = f"machine '{loaded.machine.name}' ({files})"
        return kinds, Line("config", True, text, figures)
    return kinds, Line("config", False, f"CFG-LASTGOOD: {complaint(loaded)}", figures)


def _safe(healths: dict[str, Record], now_s: float) -> list[Line]:
    """The safe state, while it lasts."""
    record = healths.get("safe")
    if record is None:
        return []
    members = [one for one in crew({"safe": record}, now_s, None) if one.name == "safe"]
    if not members or members[0].state != "working":
        return []
    return [
        Line("safe", False, "SAFE: a worker failed for good; dark and parked. See the log.", {})
    ]


def _disk() -> Line:
    import shutil

    from hypermask import paths

    folder = paths.home()
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    usage = shutil.disk_usage(folder)
    free, share = usage.free / 1e9, usage.free / max(usage.total, 1)
    fine = usage.free > 200e6
    text = f"{free:.1f} GB free for characters and calibrations ({share:.0%})"
    return Line("disk", fine, text, {"free_bytes": usage.free, "total_bytes": usage.total})


# --- rows ----------------------------------------------------------------------------------------

_HEAD = ("worker", "state", "rate/s", "p50", "p99", "max ms", "missed", "lost", "again", "granted")
_WIDTHS = (8, 9, 6, 5, 5, 6, 6, 4, 5, 17)


def _table(members: Sequence[Member]) -> list[str]:
    rows = [_row(_HEAD)]
    for one in members:
        cells = (
            f"{'' if one.fine else '!'}{one.name}",
            one.state,
            "-" if one.rate_hz is None else _number(one.rate_hz),
            *(_number(value) for value in (one.p50_ms, one.p99_ms, one.max_ms)),
            *(_count(value) for value in (one.missed, one.losses, one.restarts)),
            short(one.granted) or "-",
        )
        rows.append(_row(cells))
        if one.device == "away":
            what = f"the {OWNS.get(one.name) or 'device'} is away"
            rows.append(f"!        {what}; last fault: {one.fault or 'none'}"[:WIDTH])
        elif not one.fine and one.fault:
            rows.append(f"!        last fault: {one.fault}"[:WIDTH])
    return rows


def _row(cells: Sequence[str]) -> str:
    aligned = [
        f"{cell[:width]:<{width}}" if index in (0, 1, 9) else f"{cell[:width]:>{width}}"
        for index, (cell, width) in enumerate(zip(cells, _WIDTHS, strict=True))
    ]
    return " ".join(aligned).rstrip()


def _number(value: float) -> str:
    """At most five characters."""
    if not math.isfinite(value):
        return "-"
    if abs(value) < 999.95:
        return f"{value:.1f}"
    return f"{value / 1000:.0f}k" if abs(value) < 99500 else ">99k"


def _count(value: int) -> str:
    for limit, unit in ((10**9, "G"), (10**6, "M"), (10**4, "k")):
        if value >= limit:
            return f"{value // (limit if unit != 'k' else 1000)}{unit}"
    return str(value)


def _wrapped(mark: str, name: str, text: str) -> list[str]:
    indent = " " * (len(mark) + _NAMED + 3)
    return textwrap.wrap(
        f"{mark}  {name:{_NAMED}} {' '.join(text.split())}",
        WIDTH,
        subsequent_indent=indent,
        break_long_words=True,
    )


def _member_data(one: Member) -> dict[str, Any]:
    figures = {
        key: None if value is None else round(value, 3)
        for key, value in (
            ("rate_hz", one.rate_hz), ("p50_ms", one.p50_ms),
            ("p99_ms", one.p99_ms), ("max_ms", one.max_ms),
        )
    }  # fmt: skip
    return {
        "fine": one.fine,
        "state": one.state,
        **figures,
        "missed": one.missed,
        "losses": one.losses,
        "restarts": one.restarts,
        "granted": one.granted,
        "device": one.device,
        "fault": one.fault,
    }
