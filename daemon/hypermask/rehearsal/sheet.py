"""The contact sheet of a rehearsal: its report's key figures over its moments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hypermask_sim.sheet import KeyFigure, Moment, contact_sheet

_MARKED = ("CUE", "MASK-LOST", "MASK-FOUND")


def write_sheet(path: Path, report: dict[str, Any], moments: Sequence[Moment]) -> None:
    """Raises `HypermaskError` SHEET-WRITE."""
    series = report["series"]
    errors = [
        (time_s, float("nan") if rms is None else rms)
        for time_s, rms in zip(series["light_s"], series["rms_mm"], strict=True)
    ]
    events = [
        (event["time_s"], event["text"].split(": ")[-1])
        for event in report["events"]
        if event["code"] in _MARKED or event["code"].endswith(("-LOST", "-BACK"))
    ]
    contact_sheet(
        f"HYPERMASK  {report['scenario']}",
        f"{report['frames']} frames in {report['duration_s']:.1f} s, {report['mode']}, "
        f"mapping {report['mapping']}, prediction {report['prediction']}",
        _figures(report),
        moments,
        errors,
        events,
        path,
    )


def _figures(report: dict[str, Any]) -> list[KeyFigure]:
    registration, tracking, lead = (report[k] for k in ("registration_mm", "tracking", "lead_ms"))
    visible, wrong = tracking["visible_fraction"], tracking["wrong_labels"]
    return [
        KeyFigure("registration, rms", _unit(registration["rms"], "mm"), "face to mask"),
        KeyFigure("95 % within", _unit(registration["p95"], "mm"), "of dots on the mask"),
        *(
            _of_head(report["head"])
            if report["mapping"] == "fixed"
            else [
                KeyFigure("lead", _unit(lead["p50"], "ms"), "exposure to light"),
                KeyFigure(
                    "tracked",
                    "-" if visible is None else f"{visible:.1%}",
                    "of frames",
                    None if visible is None else visible > 0.99,
                ),
                KeyFigure("wrong labels", str(wrong), "", wrong == 0),
            ]
        ),
        KeyFigure("missed flips", str(report["missed_flips"]), "", report["missed_flips"] == 0),
    ]


def _of_head(head: dict[str, Any] | None) -> list[KeyFigure]:
    if head is None:
        return []
    late_ms = head["behind_ms"]
    side = "behind" if late_ms >= 0 else "ahead of"
    gestures = [order for order in head["orders"] if order["gesture"] != "look"]
    return [
        KeyFigure("head", f"{abs(late_ms):.0f} ms", f"{side} its orders"),
        KeyFigure("head, worst", _unit(head["behind_deg"]["max"], "deg"), "beside its way"),
        KeyFigure("gestures", str(len(gestures)), f"of {len(head['orders'])} orders"),
    ]


def _unit(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value:.2f} {unit}"
