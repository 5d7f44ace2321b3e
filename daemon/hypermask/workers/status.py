"""The state of a running show, read from its blackboard by somebody who is not part of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypermask.blackboard import Record
from hypermask.loudspeaker.offset import LipSync
from hypermask.show.scene import brightness_at, characters_at, describe
from hypermask.workers.board import Board
from hypermask.workers.thermal import HOT_C, NOW, words_of

STALE_S = 0.5
"""A worker that has written nothing for so long does not work."""
OLD_S = 10.0
"""Of the slow devices."""


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
    board, now_s = Board.reading(folder), time.monotonic() if now_s is None else now_s
    lines = (
        _line("tracker", board.track.latest(), lambda record: _tracker(record, now_s)),
        _line("voice", board.mouth.latest(), lambda record: _voice(record, now_s)),
        _line("stage", board.pace.latest(), lambda record: _stage(record, now_s)),
        _line("show", board.scene.latest(), lambda record: _show(record, now_s)),
        _lip_sync(board.lip_sync.latest()),
        _words(board.words.latest()),
        _head(board.head.latest(), now_s),
        *_machine(board.machine.latest(), now_s),
    )
    return Status(tuple(line for line in lines if line is not None))


def _line(name: str, record: Record | None, describe_it: Callable[[Record], Line]) -> Line:
    if record is None:
        return Line(name, False, "has not written anything yet", {})
    return describe_it(record)


def _tracker(record: Record, now_s: float) -> Line:
    age_s, locked = now_s - float(record["time_s"]), bool(record["locked"])
    unseen_s = _or_none(now_s - float(record["seen_s"]))
    figures = {
        "age_s": round(age_s, 3),
        "mask_seen": locked,
        "unseen_s": unseen_s,
        "frames": int(record["frames"]),
        "dropped": int(record["dropped"]),
    }
    counted = f"{figures['frames']} frames, {figures['dropped']} dropped"
    if not record["camera_ready"] or age_s > STALE_S:
        return Line("tracker", False, f"no camera picture for {age_s:.1f} s; {counted}", figures)
    unseen = "has not been seen yet" if unseen_s is None else f"is not seen for {unseen_s:.1f} s"
    seen = "the mask is seen" if locked else f"the mask {unseen}"
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


def _words(record: Record | None) -> Line | None:
    """The mode that has the keypad, while there is one."""
    mode = "" if record is None else _text(record["mode"])
    if record is None or not mode:
        return None
    words = _text(record["words"])
    return Line("mode", True, f"{mode}: {words}", {"mode": mode, "words": words})


def _head(record: Record | None, now_s: float) -> Line | None:
    """Where the mask sits on a pan-tilt unit."""
    if record is None:
        return None
    age_s, state = now_s - float(record["time_s"]), _text(record["state"])
    pan, tilt = (math.degrees(float(record[key])) for key in ("pan_rad", "tilt_rad"))
    figures = {
        "age_s": round(age_s, 3),
        "state": state,
        "pan_deg": round(pan, 2),
        "tilt_deg": round(tilt, 2),
        "homed": bool(record["homed"]),
        "limit_hits": int(record["limit_hits"]),
        "losses": int(record["losses"]),
        "halts": int(record["halts"]),
        "lag_deg": round(math.degrees(float(record["lag_rad"])), 2),
    }
    if age_s > STALE_S:
        return Line("head", False, f"its worker is silent for {age_s:.1f} s", figures)
    fine = bool(record["ready"]) and not record["master_silent"]
    text = f"{state}, pan {pan:.0f}, tilt {tilt:.0f} degrees" if record["ready"] else state
    return Line("head", fine, text, figures)


def _machine(record: Record | None, now_s: float) -> list[Line]:
    """The slow devices of the show worker: battery, lamp, heat, keypad."""
    if record is None:
        return []
    age_s = now_s - float(record["time_s"])
    if age_s > OLD_S:
        text = f"battery, lamp and heat were last read {age_s:.0f} s ago"
        return [Line("slow", False, text, {"age_s": round(age_s, 3)})]
    lines = [_heat(record), _battery(record), _lamp(record)]
    return [line for line in lines if line is not None]


def _heat(record: Record) -> Line:
    celsius, flags = float(record["temperature_c"]), int(record["throttled"])
    known = bool(record["throttling_known"])
    degrees = "temperature unknown" if math.isnan(celsius) else f"{celsius:.0f} degrees C"
    words = words_of(flags) if known else "throttling unknown"
    figures = {"temperature_c": _or_none(celsius), "throttled": flags if known else None}
    fine = not flags & NOW and not celsius >= HOT_C
    return Line("processor", fine, f"{degrees}, {words}", figures)


def _battery(record: Record) -> Line | None:
    state = _text(record["power"])
    if state == "none":
        return None
    if state != "ready":
        return Line("battery", False, "its monitor does not answer", {"state": state})
    volts, amps, charge = (float(record[key]) for key in ("volts", "amps", "charge"))
    level = _text(record["level"])
    left = "" if math.isnan(charge) else f", {charge:.0%} left"
    figures = {
        "state": state, "volts": round(volts, 3), "amps": round(amps, 3),
        "charge": _or_none(charge), "level": level,
    }  # fmt: skip
    text = f"{volts:.1f} V, {amps:.1f} A{left}: {level}"
    return Line("battery", level not in ("low", "critical"), text, figures)


def _lamp(record: Record) -> Line | None:
    state = _text(record["lamp"])
    if state == "none":
        return None
    celsius, faults = float(record["lamp_c"]), _text(record["lamp_faults"])
    figures = {
        "state": state, "on": bool(record["lamp_on"]), "temperature_c": _or_none(celsius),
        "faults": faults,
    }  # fmt: skip
    if state != "ready":
        return Line("lamp", False, "the projector's light controller does not answer", figures)
    heat = "" if math.isnan(celsius) else f", {celsius:.0f} degrees C"
    wrong = f"; {faults}" if faults else ""
    return Line("lamp", not faults, f"{'on' if record['lamp_on'] else 'off'}{heat}{wrong}", figures)


def _text(field: Any) -> str:
    return bytes(field.item()).decode(errors="replace")


def _or_none(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
