"""`hypermask status`: what the running show does at this moment, on one screen."""

from __future__ import annotations

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors


@reports_errors
def status(as_json: JsonOption = False) -> None:
    """Every worker, device and measure of the running show, on one screen.

    Exit code 1 when a worker or a device is not as it should be or the mask is not seen.
    """
    from hypermask.technician.screen import survey
    from hypermask.workers.running import running_board

    found = survey(running_board())
    if as_json:
        print_json(found.as_data())
    else:
        for row in found.rows():
            console.print(row, markup=False, style="red" if row.startswith("!") else None)
    if not found.fine:
        raise typer.Exit(1)
