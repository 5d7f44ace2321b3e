"""All measurements by their names, and the page they make."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from hypermask.bench.table import Table
from hypermask.errors import UsageError
from hypermask.storage import write_atomically


@dataclass(frozen=True)
class Bench:
    """A measurement: what it is about, and `module:function` that takes `progress` (bool)."""

    about: str
    target: str

    def run(self, progress: bool) -> Table:
        module, function = self.target.split(":")
        run: Callable[[bool], Table] = getattr(import_module(module), function)
        return run(progress)


BENCHES: dict[str, Bench] = {
    "still": Bench(
        "registration on a still mask over the whole working range, after click calibration",
        "hypermask.bench.registration:still",
    ),
    "motion": Bench(
        "registration on every clip of ../shared/data/motion, reference cart",
        "hypermask.bench.registration:motion",
    ),
    "motion-fast": Bench(
        "registration on every clip of ../shared/data/motion, fast cart",
        "hypermask.bench.registration:motion_fast",
    ),
    "hidden": Bench("two LEDs hidden, all hidden, extra lights", "hypermask.bench.faults:hidden"),
    "paper": Bench("the paper's planar maps and their depth band", "hypermask.bench.paper:bands"),
    "prediction": Bench("the motion predictors alone", "hypermask.bench.parts:prediction"),
    "tracking": Bench("tracking beside OpenCV's blob detector", "hypermask.bench.parts:tracking"),
    "stage": Bench("drawing and reading back", "hypermask.bench.parts:stage"),
    "texture": Bench(
        "photo to character and the paper's experiments on it", "hypermask.bench.texture:texture"
    ),
    "fitting": Bench(
        "a drag of the fitting tool until the new texture is there",
        "hypermask.bench.fitting:fitting",
    ),
    "voice": Bench(
        "speech to mouth beside the paper, MFCC templates and flapping, with noise",
        "hypermask.bench.voice:voice",
    ),
    "voice-latency": Bench(
        "from a sound to the mouth on the blackboard, and whether that creeps in an hour",
        "hypermask.bench.voice_latency:voice_latency",
    ),
    "start": Bench("the stage's start to its first face", "hypermask.bench.start:start"),
    "realtime": Bench("flips on time against the real clock", "hypermask.bench.parts:realtime"),
}


def find(name: str) -> list[Bench]:
    """Raises `UsageError` BENCH-NAME."""
    if name == "all":
        return list(BENCHES.values())
    if name not in BENCHES:
        raise UsageError(
            "BENCH-NAME", f"there is no measurement '{name}'", f"Known: {', '.join(BENCHES)}, all."
        )
    return [BENCHES[name]]


def write_page(tables: Sequence[Table], path: Path) -> None:
    """docs/benchmarks.md and the plots beside it; sections of other measurements stay.

    Raises `HypermaskError` DISK-WRITE.
    """
    head = [
        "# Benchmarks",
        "",
        "Written by `make bench`. Measured on: " + machine() + ".",
        "Times depend on the machine and its load; ratios within one table were measured in one "
        "run.",
        "",
    ]
    sections = _sections(path) | {table.name: table.markdown() for table in tables}
    body = "\n".join(sections[name] for name in BENCHES if name in sections)
    for table in tables:
        if table.plot is not None:
            write_atomically(path.parent / "pictures" / f"bench-{table.name}.png", table.plot)
    write_atomically(path, ("\n".join(head) + "\n" + body).encode())


def _sections(path: Path) -> dict[str, str]:
    """The page's present sections by the name of their measurement."""
    if not path.is_file():
        return {}
    parts = path.read_text("utf-8").split("\n## ")[1:]
    named = {re.search(r"`hypermask bench ([\w-]+)`", part): part for part in parts}
    return {found.group(1): f"## {part.rstrip()}\n" for found, part in named.items() if found}


def machine() -> str:
    """The processor, its cores and the Python that measured."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        names = [
            line.split(":", 1)[1].strip()
            for line in info.read_text().splitlines()
            if line.startswith("model name")
        ]
        model = names[0] if names else model
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}"
