"""`hypermask doctor`: what is wrong with this machine, and what to do about it."""

from __future__ import annotations

import textwrap
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from hypermask.cli.output import JsonOption, console, print_json, reports_errors

if TYPE_CHECKING:
    from hypermask.technician.doctor import Finding

_WIDTH = 80


@reports_errors
def doctor(
    fix: Annotated[
        bool, typer.Option("--fix", help="Mend what can safely be mended, and say so.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Check this machine; exit code 1 when something is wrong.

    --fix makes folders, removes a blackboard that nobody uses, starts failed services again and
    lets the show start with the machine; nothing else.
    """
    from hypermask.technician.doctor import examine

    findings = examine(fix)
    if as_json:
        print_json([asdict(finding) for finding in findings])
    else:
        for finding in findings:
            for row in _rows(finding):
                console.print(row, markup=False)
        if not fix and any(finding.fixable and not finding.fine for finding in findings):
            console.print("hypermask doctor --fix may mend some of it.")
    if not all(finding.fine for finding in findings):
        raise typer.Exit(1)


def _rows(finding: Finding) -> list[str]:
    word = "fixed" if finding.fixed and finding.fine else "ok" if finding.fine else "FAULT"
    done = f"[{finding.fixed}] " if finding.fixed else ""
    text = f"{word:5} {finding.check}: {done}{' '.join(finding.message.split())}"
    return textwrap.wrap(text, _WIDTH, subsequent_indent=" " * 6)
