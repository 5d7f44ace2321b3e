"""`hypermask calibrate`: make, list and bring back calibrations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors

SETTLED_S = 0.25
"""In this time a key has done its work."""

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
    """Calibrate a simulated cart or Mask-bot with a simulated operator, and store the result."""
    from hypermask import paths
    from hypermask.calibration import storage
    from hypermask.errors import UsageError
    from hypermask.rehearsal.calibrate import method_of, rehearsed_calibration
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
    outcome, presses = rehearsed_calibration(world, method)
    stored = storage.save(outcome, method)
    if as_json:
        print_json(
            {"file": str(stored), "expected_mm": outcome.expected_mm, "key_presses": presses}
        )
        return
    for line in outcome.lines():
        console.print(line)
    console.print(f"{presses} key presses; stored as {stored}")


@app.command("start")
@reports_errors
def start(
    method: Annotated[
        str | None,
        typer.Option(metavar="click|affine|projective|fixed", help="Default: the machine's own."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate the running machine: the face goes dark, the keypad moves the light."""
    from hypermask.calibration.outcome import METHODS
    from hypermask.errors import UsageError

    if method is not None and method not in METHODS:
        raise UsageError(
            "CAL-METHOD", f"there is no method '{method}'", f"Known: {', '.join(METHODS)}."
        )
    name = "calibrate" if method is None else f"calibrate-{method}"
    _mode({"action": "begin", "name": name}, as_json)


@app.command("key")
@reports_errors
def key(
    key: Annotated[str, typer.Argument(help="As on the keypad: 8, 2, 4, 6, 5, enter, ...")],
    as_json: JsonOption = False,
) -> None:
    """Press a key of the calibration that is on."""
    _mode({"action": "press", "key": key}, as_json)


@app.command("cancel")
@reports_errors
def cancel(as_json: JsonOption = False) -> None:
    """Leave the calibration; the last good one stays in use. What was done is kept for later."""
    _mode({"action": "cancel"}, as_json)


@app.command("status")
@reports_errors
def calibration_status(as_json: JsonOption = False) -> None:
    """What the calibration that is on asks for, and which one is in use."""
    from hypermask.calibration import storage
    from hypermask.errors import DataError, HypermaskError
    from hypermask.workers.control import ask

    try:
        found = ask({"do": "status"})
    except HypermaskError as error:
        if error.code != "CTL-NONE":
            raise
        found = {}
    try:
        used, warning = storage.load_current()
    except DataError as error:
        used, warning = None, str(error)
    told = {
        "mode": found.get("mode", ""),
        "words": found.get("words", ""),
        "in_use": None if used is None else used.name,
        "expected_mm": None if used is None else used.expected_mm,
        "warning": warning,
    }
    if as_json:
        print_json(told)
        return
    for line in str(told["words"]).splitlines() or ["No calibration is on."]:
        console.print(line, markup=False)
    if used is not None:
        text = f"In use: {used.name}, {used.expected_mm:.2f} mm expected"
        console.print(text, markup=False)
    if warning is not None:
        console.print(warning, markup=False)


def _mode(request: dict[str, str], as_json: bool) -> None:
    """Ask the show's mode, and print what it tells the operator then."""
    import time

    from hypermask.workers.control import ask

    answer = ask({"do": "mode", **request})
    if request["action"] != "cancel":
        time.sleep(SETTLED_S)
        answer = ask({"do": "status"})
        answer = {name: answer.get(name, "") for name in ("mode", "words")}
    if as_json:
        print_json({name: value for name, value in answer.items() if name != "ok"})
    else:
        console.print(answer.get("words") or answer.get("text", ""), markup=False)


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
