"""`hypermask log`: what the workers said."""

from __future__ import annotations

from typing import Annotated

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors


@reports_errors
def log(
    count: Annotated[int, typer.Option("-n", "--lines", help="So many, the newest last.")] = 30,
    worker: Annotated[
        str | None,
        typer.Option(help="stage, tracker, voice, pantilt, show, dresser or safe."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """The last messages of the show, from the journal or the workers' own files."""
    from hypermask.technician.journal import said

    found = said(count, worker)
    if as_json:
        print_json([one.as_data() for one in found])
        return
    for one in found:
        console.print(one.row(), markup=False)
