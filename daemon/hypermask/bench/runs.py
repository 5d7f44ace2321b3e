"""Rehearsals as a measurement runs them: no pictures, one calibration for all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import Progress, track

from hypermask import paths
from hypermask.calibration.fixed import Fixed
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.planar import Planar
from hypermask.errors import DataError
from hypermask.rehearsal.calibrate import calibrate
from hypermask.rehearsal.journal import Journal
from hypermask.rehearsal.run import Rehearsal
from hypermask.tracking.motion_model import MotionParameters
from hypermask_sim.scenario import Scenario, load_scenario
from hypermask_sim.world import World

T = TypeVar("T")
Calibration = ProCam | Planar | Fixed


def scenario(name: str, *assignments: str) -> Scenario:
    """A shipped scenario with `--set` assignments."""
    return load_scenario(paths.configs() / "scenarios" / f"{name}.toml", list(assignments))


def calibration(of: Scenario) -> Calibration:
    """The program's own click calibration for a scenario, by its simulated operator."""
    return calibrate(World(of), Journal())


def played(
    of: Scenario,
    with_calibration: Calibration | None = None,
    models: MotionParameters | None = None,
) -> Rehearsal:
    """Play a scenario in lock-step; `measured` and `leads_s` hold what was judged."""
    rehearsal = Rehearsal(of, with_calibration, models=models)
    try:
        rehearsal.run(None, False, Progress(disable=True))
    finally:
        rehearsal.close()
    return rehearsal


def tracked(items: Iterable[T], what: str, progress: bool) -> Iterator[T]:
    """Iterate with a progress bar on the error stream."""
    return iter(
        track(list(items), description=what, console=Console(stderr=True), disable=not progress)
    )


def clips() -> list[Path]:
    """The performer's clips. Raises `DataError` BENCH-DATA where they are absent."""
    found = sorted((paths.share().parent / "shared" / "data" / "motion").glob("*.csv"))
    if not found:
        raise DataError(
            "BENCH-DATA",
            "there are no motion clips in ../shared/data/motion",
            "Put them there, or choose another measurement.",
        )
    return found
