"""How each worker and its device is, from the health records and the process table."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from hypermask.blackboard import Record

OWNS = {
    "stage": "projector",
    "tracker": "camera",
    "voice": "sound",
    "pantilt": "pantilt",
    "show": "keypad",
    "dresser": None,
}
"""Every worker, and the device that it holds."""
SILENT_S = 3.0
"""A worker writes its health twice a second."""
WORKS_WITHOUT = ("show", "dresser")
"""Workers that have work to do also while their device is away."""


@dataclass(frozen=True)
class Member:
    """state: working, waits (for its device), no device (in this machine), starting, stopped,
    hung, dead, absent (never started). rate_hz: pieces of work a second, None where unknown."""

    name: str
    state: str
    rate_hz: float | None
    p50_ms: float
    p99_ms: float
    max_ms: float
    missed: int
    losses: int
    restarts: int
    granted: str
    fault: str
    device: str
    """ready, away, none, or empty for a worker without a device."""

    @property
    def fine(self) -> bool:
        return self.state in ("working", "no device") and self.device != "away"


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def crew(
    healths: Mapping[str, Record],
    now_s: float,
    kinds: tuple[str, ...] | None = None,
    before: Mapping[str, Record] | None = None,
    is_alive: Callable[[int], bool] = alive,
) -> list[Member]:
    """kinds: of device that this machine has (None: all); before: an earlier look, for rates."""
    others = [name for name in healths if name not in OWNS]
    return [
        _member(name, healths.get(name), now_s, kinds, (before or {}).get(name), is_alive)
        for name in (*OWNS, *others)
    ]


def _member(
    name: str,
    record: Record | None,
    now_s: float,
    kinds: tuple[str, ...] | None,
    before: Record | None,
    is_alive: Callable[[int], bool],
) -> Member:
    if record is None:
        return Member(name, "absent", None, 0, 0, 0, 0, 0, 0, "", "", "")
    device = _device(name, record, kinds)
    state = _state(name, record, now_s, device, is_alive)
    return Member(
        name=name,
        state=state,
        rate_hz=_rate(record, before),
        p50_ms=float(record["p50_ms"]),
        p99_ms=float(record["p99_ms"]),
        max_ms=float(record["max_ms"]),
        missed=int(record["missed"]),
        losses=int(record["losses"]),
        restarts=int(record["restarts"]),
        granted=text(record["granted"]),
        fault=text(record["fault"]),
        device=device if state not in ("dead", "hung", "stopped") else "",
    )


def _device(name: str, record: Record, kinds: tuple[str, ...] | None) -> str:
    kind = OWNS.get(name)
    if kind is None:
        return ""
    if kinds is not None and kind not in kinds:
        return "none"
    return "ready" if record["ready"] else "away"


def _state(
    name: str, record: Record, now_s: float, device: str, is_alive: Callable[[int], bool]
) -> str:
    said = text(record["state"])
    if said == "stopped":
        return "stopped"
    if not is_alive(int(record["pid"])):
        return "dead"
    if now_s - float(record["time_s"]) > SILENT_S:
        return "starting" if said == "starting" else "hung"
    if said == "starting" or name in WORKS_WITHOUT:
        return said
    return {"none": "no device", "away": "waits"}.get(device, said)


def _rate(record: Record, before: Record | None) -> float | None:
    if before is None or int(before["pid"]) != int(record["pid"]):
        return None
    span_s = float(record["time_s"]) - float(before["time_s"])
    return (int(record["steps"]) - int(before["steps"])) / span_s if span_s > 0.2 else None


def text(field: Any) -> str:
    """A text field of a record."""
    return bytes(field.item()).decode(errors="replace")


def short(granted: str) -> str:
    """What the operating system allowed, for a narrow column: `rt40 locked cpu3`."""
    for long, brief in (("SCHED_FIFO ", "rt"), ("memory locked", "locked"), ("CPU ", "cpu")):
        granted = granted.replace(long, brief)
    return granted.replace(", ", " ")
