"""`hypermask voice`: how well speech becomes a mouth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors
from hypermask.errors import UsageError

app = typer.Typer(help="Measure the voice model.", no_args_is_help=True)


@app.command("eval")
@reports_errors
def evaluate(
    table: Annotated[
        Path, typer.Argument(metavar="CSV", help="Recordings with vowel, start_ms and end_ms.")
    ],
    model: Annotated[str, typer.Option(help="default or paper")] = "default",
    as_json: JsonOption = False,
) -> None:
    """Frame accuracy on recorded vowels; paths in the CSV are relative to it."""
    from hypermask.voice.evaluate import evaluate as run

    if model not in ("default", "paper"):
        raise UsageError("VOICE-MODEL", f"there is no model '{model}'", "Use default or paper.")
    result = run(table, model)
    if as_json:
        print_json(result)
        return
    console.print(f"frame accuracy  {result['frame_accuracy']:.1%}")
    for group, accuracy in result["groups"].items():
        console.print(f"  {group:13} {accuracy:.1%}")
