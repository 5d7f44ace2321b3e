"""`hypermask rehearse`: a whole show on the simulated cart."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors


@reports_errors
def rehearse(
    scenario: Annotated[
        Path | None,
        typer.Argument(help="A scenario file (default: configs/scenarios/reference-cart.toml)."),
    ] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override a scenario key; repeatable."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Where to write.")] = Path("build/rehearsal"),
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Run against the real clock, a process a worker.")
    ] = False,
    pictures: Annotated[
        bool, typer.Option(help="Make show.mp4 and contact-sheet.png (slower).")
    ] = True,
    as_json: JsonOption = False,
) -> None:
    """Play a show on simulated hardware; writes report.json, contact-sheet.png and show.mp4.

    In lock-step (the default) the clock is virtual and the same scenario gives the same report to
    the last digit. With --realtime every worker is a process and flips must be met.
    """
    from hypermask.rehearsal.run import rehearse as run

    report = run(scenario, assignments or [], out, realtime, pictures, quiet=as_json)
    if as_json:
        print_json(report)
    else:
        _print_summary(report, out)
    lost = [event["text"] for event in report["events"] if event["code"] == "WRK-LOST"]
    for text in lost:
        print(text, file=sys.stderr)
    if lost:
        raise typer.Exit(1)


def _print_summary(report: dict[str, Any], out: Path) -> None:
    registration, tracking, lead = (report[k] for k in ("registration_mm", "tracking", "lead_ms"))
    rms, p95, most = (_number(registration[key], "mm") for key in ("rms", "p95", "max"))
    visible, wrong = _percent(tracking["visible_fraction"]), tracking["wrong_labels"]
    judged = registration["measured_frames"]
    console.print(f"{report['frames']} frames, {judged} judged")
    console.print(f"registration rms {rms}, p95 {p95}, max {most}")
    if report["mapping"] != "fixed":
        console.print(f"tracked {visible}   wrong labels {wrong}")
    if report.get("head") is not None:
        _print_head(report["head"])
    lead_text = "" if lead["p50"] is None else f"lead {_number(lead['p50'], 'ms')}   "
    console.print(f"{lead_text}missed flips {report['missed_flips']}")
    console.print(f"Report and pictures: {out}")


def _print_head(head: dict[str, Any]) -> None:
    orders = head["orders"]
    gestures = [order["gesture"] for order in orders if order["gesture"] != "look"]
    console.print(
        f"head {len(orders)} orders, {len(gestures)} gestures ({', '.join(gestures) or 'none'}); "
        f"{abs(head['behind_ms']):.0f} ms {'behind' if head['behind_ms'] >= 0 else 'ahead of'} "
        f"them, {_number(head['behind_deg']['max'], 'deg')} off at the worst"
    )


def _percent(value: float | None) -> str:
    return "none" if value is None else f"{value:.2%}"


def _number(value: float | None, unit: str) -> str:
    return "none" if value is None else f"{value:.2f} {unit}"
