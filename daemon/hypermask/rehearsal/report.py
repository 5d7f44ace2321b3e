"""The report of a rehearsal: what a judge saw from outside, and what the workers took."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hypermask.loudspeaker.offset import LipSync
from hypermask.storage import write_atomically
from hypermask.voice.follower import MouthFrame
from hypermask_sim.faults import FaultSettings
from hypermask_sim.judge import FrameMeasurement, Judge
from hypermask_sim.scenario import Scenario

VERSION = 1
_BLINDING = ("camera_lost", "leds_hidden")
_BRIGHT_AGAIN = 0.9


def shifted(frames: Sequence[FrameMeasurement], origin_s: float) -> list[FrameMeasurement]:
    """Measurements whose times count from the scenario's 0 instead of the clock's."""
    return [replace(frame, time_s=frame.time_s - origin_s) for frame in frames]


def registration(frames: Sequence[FrameMeasurement]) -> dict[str, Any]:
    """`registration_mm`: over all dots of all frames, in millimetres on the mask's surface."""
    summary = Judge.summary(frames)
    return {
        "median": _number(summary.median),
        "rms": _number(summary.rms),
        "p95": _number(summary.p95),
        "max": _number(summary.max),
        "measured_frames": summary.measured_frames,
        "black_frames": summary.black_frames,
    }


def lip_sync(scenario: Scenario, mouth_lags_s: Sequence[float]) -> dict[str, Any] | None:
    """How far the mouth's light and the loudspeaker's sound lie apart, by the median."""
    if not mouth_lags_s:
        return None
    delay_s = scenario.loudspeaker.delay_ms * 1e-3
    found = LipSync(float(np.median(mouth_lags_s)), delay_s)
    return {
        "offset_ms": round(found.offset_s * 1e3, 3),
        "loudspeaker_delay_ms": scenario.loudspeaker.delay_ms,
        "verdict": found.verdict,
    }


def series(frames: Sequence[FrameMeasurement]) -> dict[str, list[float | None]]:
    """Per flip: time of the light, rms in mm (None without a dot), brightness 0 to 1."""
    return {
        "light_s": [round(frame.time_s, 6) for frame in frames],
        "rms_mm": [_number(frame.rms_mm) for frame in frames],
        "brightness": [round(frame.brightness, 4) for frame in frames],
    }


def outages(scenario: Scenario, frames: Sequence[FrameMeasurement]) -> list[dict[str, Any]]:
    """For each time the camera could not see the mask: how soon black, how soon right again."""
    blind = [fault for fault in scenario.faults if _blinds(fault)]
    return [_outage(fault, frames) for fault in blind]


def _blinds(fault: FaultSettings) -> bool:
    all_hidden = fault.kind == "leds_hidden" and len(fault.leds) == 5
    return fault.kind == "camera_lost" or all_hidden


def _outage(fault: FaultSettings, frames: Sequence[FrameMeasurement]) -> dict[str, Any]:
    full = max((frame.brightness for frame in frames), default=0.0)
    errors = [f.rms_mm for f in frames if f.errors and f.time_s < fault.from_s]
    right_mm = 2 * float(np.median(errors)) + 2 if errors else 0.0
    back = next(
        (
            f.time_s
            for f in frames
            if f.time_s > fault.to_s
            and f.errors
            and f.rms_mm <= right_mm
            and f.brightness >= _BRIGHT_AGAIN * full
        ),
        None,
    )
    until = float("inf") if back is None else back
    black = next((f.time_s for f in frames if fault.from_s < f.time_s < until and not f.lit), None)
    return {
        "kind": fault.kind,
        "from_s": fault.from_s,
        "to_s": fault.to_s,
        "black_after_ms": None if black is None else _number((black - fault.from_s) * 1e3),
        "right_again_ms": None if back is None else _number((back - fault.to_s) * 1e3),
    }


def spread(values: Sequence[float], scale: float = 1.0) -> dict[str, float | None]:
    """p50, p99 and extremes of a sequence, each times `scale`; None for an empty one."""
    if not len(values):
        return dict.fromkeys(("mean", "p50", "p99", "min", "max"))
    data = np.asarray(values, float) * scale
    p50, p99 = np.percentile(data, [50, 99])
    figures = {"mean": data.mean(), "p50": p50, "p99": p99, "min": data.min(), "max": data.max()}
    return {name: _number(float(value)) for name, value in figures.items()}


def mouth(frames: Sequence[MouthFrame], origin_s: float) -> dict[str, Any]:
    """Times (since `origin_s`) and the 13 parameters of every analysed frame."""
    return {
        "times_s": [round(float(frame.time_s) - origin_s, 5) for frame in frames],
        "parameters": [[round(float(p), 4) for p in frame.parameters] for frame in frames],
        "level_db": [round(float(frame.level_db), 2) for frame in frames],
    }


def write_json(path: Path, data: dict[str, Any]) -> None:
    write_atomically(path, (json.dumps(data, indent=1, ensure_ascii=False) + "\n").encode())


def _number(value: float) -> float | None:
    return round(value, 5) if np.isfinite(value) else None
