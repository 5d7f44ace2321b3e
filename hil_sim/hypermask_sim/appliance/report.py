"""The trial's report: each step with its time, pictures and logs, as a page and as JSON.

Several processes may write parts of it into one folder; the page is made of all parts that are
there, in the order of their names.
"""

from __future__ import annotations

import html
import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

_STYLE = """
body { font: 15px/1.4 sans-serif; margin: 2em auto; max-width: 70em; padding: 0 1em }
table { border-collapse: collapse; width: 100% } td, th { text-align: left; padding: .2em .6em }
tr:nth-child(even) { background: #f4f4f4 } .passed { color: #060 } .failed { color: #b00 }
.skipped { color: #870 } pre { background: #f4f4f4; padding: .6em; overflow-x: auto }
figure { display: inline-block; margin: .4em } img { width: 26em; background: #000 }
figcaption { font-size: 85%; color: #555 }
"""
_LOG_LINES = 60


@dataclass
class Step:
    """outcome: passed, failed or skipped; notes: what was measured; pictures: file and caption."""

    name: str
    title: str
    outcome: str = "running"
    seconds: float = 0.0
    why: str = ""
    notes: list[str] = field(default_factory=list)
    pictures: list[tuple[str, str]] = field(default_factory=list)
    log: str = ""


class Part:
    """What one process reports; written anew after every step, so that a crash leaves the rest."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name
        self.steps: list[Step] = []
        (folder / "pictures").mkdir(parents=True, exist_ok=True)
        for old in folder.glob(f"pictures/{name}-*.png"):
            old.unlink()
        self.write()

    def begin(self, name: str, title: str) -> Step:
        self.steps.append(Step(name, title))
        return self.steps[-1]

    def picture(self, step: Step, picture: NDArray[np.uint8], caption: str) -> None:
        """picture: (height, width, 3) RGB."""
        name = f"{self._name}-{step.name}-{len(step.pictures)}.png"
        cv2.imwrite(str(self._folder / "pictures" / name), picture[..., ::-1])
        step.pictures.append((f"pictures/{name}", caption))

    def write(self) -> None:
        path = self._folder / f"part-{self._name}.json"
        _put(path, json.dumps([asdict(step) for step in self.steps], indent=1))
        gather(self._folder)


def gather(folder: Path) -> list[Step]:
    """Make `report.json` and `index.html` of all parts; returns all steps."""
    steps = [
        Step(**{**table, "pictures": [(file, caption) for file, caption in table["pictures"]]})
        for part in sorted(folder.glob("part-*.json"))
        for table in json.loads(part.read_text("utf-8"))
    ]
    summary = {
        "passed": sum(step.outcome == "passed" for step in steps),
        "failed": sum(step.outcome == "failed" for step in steps),
        "skipped": sum(step.outcome == "skipped" for step in steps),
        "seconds": round(sum(step.seconds for step in steps), 1),
        "steps": [asdict(step) for step in steps],
    }
    _put(folder / "report.json", json.dumps(summary, indent=1))
    _put(folder / "index.html", _page(steps))
    return steps


def _put(path: Path, text: str) -> None:
    """At once: other processes read it and write the same."""
    part = path.with_name(f".{path.name}.{os.getpid()}")
    part.write_text(text, "utf-8")
    part.replace(path)


def _page(steps: list[Step]) -> str:
    rows = "".join(
        f'<tr><td><a href="#{step.name}">{html.escape(step.title)}</a></td>'
        f'<td class="{step.outcome}">{step.outcome}</td><td>{step.seconds:.0f} s</td></tr>'
        for step in steps
    )
    return (
        f'<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>The virtual cart</title>'
        f"<style>{_STYLE}</style><h1>The virtual cart's trial</h1><table>{rows}</table>"
        f"{''.join(_section(step) for step in steps)}</html>\n"
    )


def _section(step: Step) -> str:
    why = f"<pre>{html.escape(step.why)}</pre>" if step.why else ""
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in step.notes)
    figures = "".join(
        f'<figure><img src="{file}" alt=""><figcaption>{html.escape(caption)}</figcaption></figure>'
        for file, caption in step.pictures
    )
    lines = "\n".join(step.log.strip().splitlines()[-_LOG_LINES:])
    log = f"<details><summary>Log</summary><pre>{html.escape(lines)}</pre></details>"
    return (
        f'<h2 id="{step.name}">{html.escape(step.title)}: '
        f'<span class="{step.outcome}">{step.outcome}</span>, {step.seconds:.0f} s</h2>'
        f"{why}<ul>{notes}</ul>{figures}{log if lines else ''}"
    )
