"""`hypermask device`: the machine's devices, one by one."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors

app = typer.Typer(no_args_is_help=True, help="List, look at and test the machine's devices.")
Kind = Annotated[
    str,
    typer.Argument(help="camera, projector, keypad, sound, pantilt, lamp or power."),
]


@app.command("list")
@reports_errors
def listed(as_json: JsonOption = False) -> None:
    """Every device of this machine. Exit code 1 when one is away."""
    from dataclasses import asdict

    from hypermask.technician.devices import entries

    found = entries()
    if as_json:
        print_json([asdict(entry) for entry in found])
    else:
        console.print(f"{'device':10} {'driver':9} {'state':6} {'held by':8} place")
        for entry in found:
            missing = " (not there)" if entry.present is False else ""
            row = (
                f"{entry.kind:10} {entry.driver:9} {entry.state:6} {entry.holder:8} "
                f"{entry.place}{missing}"
            )
            console.print(row.rstrip(), markup=False)
    if any(entry.state == "away" or entry.present is False for entry in found):
        raise typer.Exit(1)


@app.command("probe")
@reports_errors
def probe(kind: Kind, as_json: JsonOption = False) -> None:
    """Open a device, or ask the show that holds it, and say what it is."""
    from hypermask.technician.devices import asks_the_show, check_kind, opened
    from hypermask.technician.trials import facts

    check_kind(kind)
    if asks_the_show(kind):
        _ask_the_show("probe", kind, as_json)
        return
    with opened(kind) as device:
        rows = facts(device)
    _tell(kind, rows, as_json)


@app.command("test")
@reports_errors
def test(
    kind: Kind,
    yes: Annotated[bool, typer.Option("--yes", help="The head may move.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Let a device do what it is for. Exit code 1 when it does not."""
    from hypermask.errors import UsageError
    from hypermask.technician.devices import asks_the_show, check_kind, opened
    from hypermask.technician.trials import facts, trial
    from hypermask_drivers.clock import RealClock

    if check_kind(kind) == "pantilt" and not yes:
        raise UsageError(
            "DEV-MOVES", "this test moves the head", "Keep hands away, and say so with --yes."
        )
    if asks_the_show(kind):
        _ask_the_show("test", kind, as_json)
        return
    rows: list[str] = []

    def say(row: str) -> None:
        rows.append(row)
        if not as_json:
            console.print(row, markup=False)

    with opened(kind) as device:
        for row in facts(device):
            say(row)
        trial(device, RealClock(), say)
    if as_json:
        print_json({"kind": kind, "fine": True, "told": rows})
    else:
        console.print(f"The {kind} works.")


def _ask_the_show(action: str, kind: str, as_json: bool) -> None:
    from hypermask.workers.control import ask

    answer = ask({"do": "devices", "action": action, "kind": kind})
    ready = answer["device"]["state"] == "ready"
    if as_json:
        print_json({"kind": kind, "fine": ready, "told": [answer["text"]]})
    else:
        console.print(answer["text"], markup=False)
    if not ready:
        raise typer.Exit(1)


def _tell(kind: str, rows: list[str], as_json: bool) -> None:
    if as_json:
        data: dict[str, Any] = {"kind": kind, "fine": True, "told": rows}
        print_json(data)
        return
    for row in rows:
        console.print(row, markup=False)
