"""A measured table, as Markdown and as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Table:
    """title; columns; rows of strings or numbers; notes below it; command that makes it again.

    plot: PNG bytes, or None.
    """

    name: str
    title: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[str | float | int | None]]
    notes: tuple[str, ...] = ()
    plot: bytes | None = None
    data: dict[str, Any] = field(default_factory=dict)

    def markdown(self) -> str:
        lines = [f"## {self.title}", "", f"`hypermask bench {self.name}`", ""]
        lines += [_row(self.columns), _row(["---"] * len(self.columns))]
        lines += [_row([_cell(value) for value in row]) for row in self.rows]
        lines += ["", *self.notes]
        if self.plot is not None:
            lines += ["", f"![{self.title}](pictures/bench-{self.name}.png)"]
        return "\n".join(lines).rstrip() + "\n"

    def as_data(self) -> dict[str, Any]:
        rows = [dict(zip(self.columns, row, strict=True)) for row in self.rows]
        return {"title": self.title, "rows": rows, "notes": list(self.notes), **self.data}


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _cell(value: str | float | int | None) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
