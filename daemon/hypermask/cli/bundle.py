"""`hypermask bundle`: an archive for support, without anything about people."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors


@reports_errors
def bundle(
    out: Annotated[Path, typer.Option(help="Where to write it.")] = Path("hypermask-bundle.tar.gz"),
    as_json: JsonOption = False,
) -> None:
    """Write what helps support to find a fault: no photographs, recordings, names or secrets."""
    from hypermask.technician.bundle import make

    parts = make(out)
    if as_json:
        print_json({"file": str(out), "parts": parts})
        return
    console.print(f"Written to {out}: {', '.join(parts)}.", markup=False)
    console.print("Look through it before you send it.")
