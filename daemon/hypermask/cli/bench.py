"""`hypermask bench`: measure the program, alone or beside its peers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors


@reports_errors
def bench(
    name: Annotated[
        str, typer.Argument(help="Which measurement; 'list' names them, 'all' runs all.")
    ],
    write: Annotated[
        Path | None, typer.Option(help="Write the tables as Markdown, plots beside it.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure one thing (or all) and print a table."""
    from hypermask.bench.collection import BENCHES, find, write_page

    if name == "list":
        rows = {key: bench.about for key, bench in BENCHES.items()}
        if as_json:
            print_json(rows)
        else:
            for key, about in rows.items():
                console.print(f"{key:14} {about}")
        return
    data: dict[str, Any] = {}
    for item in find(name):
        table = item.run(not as_json)
        data[table.name] = table.as_data()
        # At once, so that an hour of measuring is not lost to the last of them.
        if write is not None:
            write_page([table], write)
        if not as_json:
            console.print(table.markdown())
    if as_json:
        print_json(data.get(name, data))
