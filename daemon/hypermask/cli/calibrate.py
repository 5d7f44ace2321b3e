"""`hypermask calibrate`: make, list and bring back calibrations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors

app = typer.Typer(help="Make, list and bring back calibrations.", no_args_is_help=True)


@app.command("rehearse")
@reports_errors
def rehearse(
    scenario: Annotated[Path | None, typer.Argument(help="A scenario file.")] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override a scenario key; repeatable."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate a simulated cart with a simulated operator, and store the result."""
    from hypermask import paths
    from hypermask.calibration import storage
    from hypermask.errors import UsageError
    from hypermask.rehearsal.calibrate import calibrate_by_clicks, method_of
    from hypermask.rehearsal.run import REFERENCE
    from hypermask_sim.scenario import load_scenario
    from hypermask_sim.world import World

    path = scenario or paths.configs() / "scenarios" / REFERENCE
    world = World(load_scenario(path, assignments or []))
    method = method_of(world.scenario)
    if method is None:
        raise UsageError(
            "CAL-EXACT", "calibration.method 'exact' makes no calibration", "Use click."
        )
    outcome, presses = calibrate_by_clicks(world, method)
    stored = storage.save(outcome, method)
    if as_json:
        print_json(
            {"file": str(stored), "expected_mm": outcome.expected_mm, "key_presses": presses}
        )
        return
    for line in outcome.lines():
        console.print(line)
    console.print(f"{presses} key presses; stored as {stored}")


@app.command("history")
@reports_errors
def history(as_json: JsonOption = False) -> None:
    """All stored calibrations, newest first."""
    from hypermask.calibration import storage

    entries = storage.history()
    if as_json:
        print_json(
            [
                {
                    "name": entry.name,
                    "current": entry.current,
                    "method": entry.stored.method if entry.stored else None,
                    "made": entry.stored.made.isoformat() if entry.stored else None,
                    "expected_mm": entry.stored.expected_mm if entry.stored else None,
                    "problem": entry.problem,
                }
                for entry in entries
            ]
        )
        return
    for entry in entries:
        text = entry.problem or (
            f"{entry.stored.made:%Y-%m-%d %H:%M}  {entry.stored.method}  "
            f"{entry.stored.expected_mm:.2f} mm expected"
            if entry.stored
            else ""
        )
        console.print(f"{'*' if entry.current else ' '} {entry.name}  {text}")


@app.command("rollback")
@reports_errors
def rollback(as_json: JsonOption = False) -> None:
    """Use the good calibration before the current one."""
    from hypermask.calibration import storage

    stored = storage.rollback()
    if as_json:
        print_json({"name": stored.name, "expected_mm": stored.expected_mm})
    else:
        console.print(f"In use: {stored.name}, {stored.expected_mm:.2f} mm expected")
