"""The state of a running show, read from its blackboard by somebody who is not part of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypermask.blackboard import Record
from hypermask.loudspeaker.offset import LipSync
from hypermask.show.scene import brightness_at, characters_at, describe
from hypermask.workers.board import Board

STALE_S = 0.5
"""A worker that has written nothing for so long does not work."""


@dataclass(frozen=True)
class Line:
    """One worker or measure: whether it is as it should be, in words, and in figures."""

    name: str
    fine: bool
    text: str
    figures: dict[str, Any]

    def as_data(self) -> dict[str, Any]:
        return {"fine": self.fine, "text": self.text, **self.figures}


@dataclass(frozen=True)
class Status:
    lines: tuple[Line, ...]

    @property
    def fine(self) -> bool:
        return all(line.fine for line in self.lines)


def look(folder: Path, now_s: float | None = None) -> Status:
    """The state of the show whose blackboard is in `folder`; now_s: CLOCK_MONOTONIC.

    Raises `HypermaskError` BOARD-LAYOUT.
    """
    board, now_s = Board.shared(folder), time.monotonic() if now_s is None else now_s
    lines = (
        _line("tracker", board.track.latest(), lambda record: _tracker(record, now_s)),
        _line("voice", board.mouth.latest(), lambda record: _voice(record, now_s)),
        _line("stage", board.pace.latest(), lambda record: _stage(record, now_s)),
        _line("show", board.scene.latest(), lambda record: _show(record, now_s)),
        _lip_sync(board.lip_sync.latest()),
    )
    return Status(tuple(line for line in lines if line is not None))


def _line(name: str, record: Record | None, describe_it: Callable[[Record], Line]) -> Line:
    if record is None:
        return Line(name, False, "has not written anything yet", {})
    return describe_it(record)


def _tracker(record: Record, now_s: float) -> Line:
    age_s, locked = now_s - float(record["time_s"]), bool(record["locked"])
    unseen_s = now_s - float(record["seen_s"])
    figures = {
        "age_s": round(age_s, 3),
        "mask_seen": locked,
        "unseen_s": round(unseen_s, 3),
        "frames": int(record["frames"]),
        "dropped": int(record["dropped"]),
    }
    counted = f"{figures['frames']} frames, {figures['dropped']} dropped"
    if not record["camera_ready"] or age_s > STALE_S:
        return Line("tracker", False, f"no camera picture for {age_s:.1f} s; {counted}", figures)
    seen = "the mask is seen" if locked else f"the mask is not seen for {unseen_s:.1f} s"
    return Line("tracker", locked, f"{seen}; {counted}", figures)


def _voice(record: Record, now_s: float) -> Line:
    age_s, level_db = now_s - float(record["time_s"]), float(record["level_db"])
    figures = {"age_s": round(age_s, 3), "level_db": round(level_db, 1)}
    if age_s > STALE_S:
        return Line("voice", False, f"no sound for {age_s:.1f} s", figures)
    return Line("voice", True, f"level {level_db:.0f} dB", figures)


def _stage(record: Record, now_s: float) -> Line:
    age_s, period_s = now_s - float(record["flip_s"]), float(record["period_s"])
    lead_ms = float(record["latch_lead_s"]) * 1e3
    figures = {"age_s": round(age_s, 3), "rate_hz": round(1 / period_s, 2), "latch_ms": lead_ms}
    if age_s > STALE_S:
        return Line("stage", False, f"no picture for {age_s:.1f} s", figures)
    text = f"{1 / period_s:.0f} pictures a second, begun {lead_ms:.1f} ms before the flip"
    return Line("stage", True, text, figures)


def _show(record: Record, now_s: float) -> Line:
    light = brightness_at(record, now_s)
    names = [name for name, _ in characters_at(record, now_s)]
    figures = {"characters": names, "brightness": round(light, 3)}
    return Line("show", True, f"{describe(record, now_s)}, light {light:.0%}", figures)


def _lip_sync(record: Record | None) -> Line | None:
    if record is None:
        return None
    found = LipSync(float(record["mouth_lag_s"]), float(record["loudspeaker_delay_s"]))
    figures = {
        "offset_ms": round(found.offset_s * 1e3, 1),
        "loudspeaker_delay_ms": round(found.loudspeaker_delay_s * 1e3, 1),
        "wanted_delay_ms": round(found.mouth_lag_s * 1e3, 1),
        "verdict": found.verdict,
    }
    return Line("lip sync", found.verdict != "apart", found.sentence(), figures)
