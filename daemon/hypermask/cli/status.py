"""`hypermask status`: what the running show does at this moment, on one screen."""

from __future__ import annotations

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors


@reports_errors
def status(as_json: JsonOption = False) -> None:
    """What the running show does: mask, voice, picture, characters, sound and mouth.

    Exit code 1 when a worker has stopped working or the mask is not seen.
    """
    from hypermask.workers.running import running_board
    from hypermask.workers.status import look

    found = look(running_board())
    if as_json:
        print_json(
            {"fine": found.fine, "lines": {line.name: line.as_data() for line in found.lines}}
        )
    else:
        for line in found.lines:
            mark = "[green]ok[/green]" if line.fine else "[red]!![/red]"
            console.print(f"{mark}  {line.name:10} {line.text}")
    if not found.fine:
        raise typer.Exit(1)
