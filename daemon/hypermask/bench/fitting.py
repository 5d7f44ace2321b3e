"""The fitting tool: what a drag costs, and the texture after it, on photographs of people."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import TypeVar

import numpy as np
from rich.console import Console
from rich.progress import Progress

from hypermask import paths
from hypermask.bench.table import Table
from hypermask.errors import DataError
from hypermask.fitting.handles import LEVELS, load_levels
from hypermask.fitting.session import Fitting
from hypermask.mask import load_mask
from hypermask.texture.landmarks import FaceFinder
from hypermask.texture.normalise import FINE_SIZE, SIZE
from hypermask.texture.photo import load_photo

R = TypeVar("R")

_FACES = 8
_DRAGS = 40
_STEP_PX = 3.0
_TARGETS = {f"texture {SIZE}": 50}


def fitting(progress: bool) -> Table:
    """Raises `DataError` BENCH-DATA without photographs."""
    folder = paths.share().parent / "shared" / "data" / "faces"
    photos = sorted(folder.glob("*.jpg"))
    if not photos:
        raise DataError(
            "BENCH-DATA",
            "there are no photographs in ../shared/data/faces",
            "Put them there, or choose another measurement.",
        )
    finder, watch = FaceFinder(), _Watch()
    mask = load_mask(paths.configs() / "masks" / "reference")
    held = 0
    with Progress(console=Console(stderr=True), disable=not progress) as bar:
        chosen = photos[:: max(1, len(photos) // _FACES)][:_FACES]
        for number, photo in enumerate(bar.track(chosen, description="fitting")):
            image = load_photo(photo)
            session = Fitting(image, finder.find(image).points)
            session.texture()
            session.texture(FINE_SIZE)
            held += _dragged(session, watch, np.random.default_rng(number))
            watch.measure(f"texture {FINE_SIZE}", partial(session.texture, FINE_SIZE))
            watch.measure("face to try expressions with", partial(session.face, mask))
    return Table(
        "fitting",
        "The fitting tool: a drag and the texture after it",
        ("what", "clock p50 ms", "clock p95 ms", "processor p50 ms", "allowed ms"),
        watch.rows(),
        (
            f"{len(chosen)} photographs, {_DRAGS} random drags of {_STEP_PX:g} px on each, in all "
            f"four levels; {held} of them were held before a fold. The texture is the whole one, "
            "with estimation, blend, white balance and both eyes.",
        ),
    )


def _dragged(session: Fitting, watch: _Watch, rng: np.random.Generator) -> int:
    """How many of the drags were held."""
    held = 0
    for number in range(_DRAGS):
        level = LEVELS[number % len(LEVELS)]
        names = load_levels()[level].handles
        name = names[rng.integers(len(names))]
        x, y = np.array(session.handles(level)[name]) + rng.normal(0, _STEP_PX, 2)
        done = watch.measure(f"drag, {level}", partial(session.drag, name, x, y))
        held += bool(done.held)
        watch.measure(f"texture {SIZE}", session.texture)
    return held


class _Watch:
    """Clock and processor times by name."""

    def __init__(self) -> None:
        self._times: dict[str, list[tuple[float, float]]] = {}

    def measure(self, name: str, call: Callable[[], R]) -> R:
        start, used = time.perf_counter(), time.process_time()
        result = call()
        taken = time.perf_counter() - start, time.process_time() - used
        self._times.setdefault(name, []).append(taken)
        return result

    def rows(self) -> list[tuple[str | float | int | None, ...]]:
        rows: list[tuple[str | float | int | None, ...]] = []
        for name, times in sorted(self._times.items()):
            clock, processor = np.array(times).T * 1000
            p50, p95 = (float(np.percentile(clock, q)) for q in (50, 95))
            rows.append((name, p50, p95, float(np.median(processor)), _TARGETS.get(name)))
        return rows
