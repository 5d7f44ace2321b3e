"""`hypermask rehearse`: from a scenario file to a report, a film and a contact sheet."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from hypermask import paths
from hypermask.calibration.fixed import Fixed
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.planar import Planar
from hypermask.errors import HypermaskError
from hypermask.rehearsal import report as figures
from hypermask.rehearsal.calibrate import calibrate
from hypermask.rehearsal.cart import SimulatedCart
from hypermask.rehearsal.journal import Journal
from hypermask.rehearsal.lockstep import LockStep
from hypermask.rehearsal.show_parts import casting_of
from hypermask.rehearsal.visitors import Arrivals, check_photos, keep_characters
from hypermask.tracking.motion_model import MotionParameters
from hypermask.voice.follower import MouthFrame
from hypermask.workers.board import Board
from hypermask.workers.cast import DOTS
from hypermask_drivers.clock import Clock, VirtualClock
from hypermask_sim.dots import load_dots
from hypermask_sim.judge import FrameMeasurement, Judge
from hypermask_sim.scenario import Scenario, load_scenario
from hypermask_sim.world import World

REFERENCE = "reference-cart.toml"


def rehearse(
    scenario_path: Path | None,
    assignments: list[str],
    out: Path,
    realtime: bool = False,
    pictures: bool = True,
    quiet: bool = False,
) -> dict[str, Any]:
    """Play a scenario and write `out`/report.json (and the pictures); returns the report.

    Raises `HypermaskError` for whatever is wrong with the scenario or its files, before anything
    is played or written.
    """
    path = scenario_path or paths.configs() / "scenarios" / REFERENCE
    scenario = load_scenario(path, assignments)
    if realtime:
        from hypermask.rehearsal.realtime import play_realtime

        return play_realtime(scenario, out, pictures, quiet)
    return play(scenario, out, pictures, quiet)


def play(
    scenario: Scenario,
    out: Path | None,
    pictures: bool = True,
    quiet: bool = False,
    calibration: ProCam | Planar | Fixed | None = None,
) -> dict[str, Any]:
    """Play in lock-step. With `out` None nothing is written. calibration: instead of making one."""
    rehearsal = Rehearsal(scenario, calibration)
    try:
        with progress_bar(quiet) as progress:
            return rehearsal.run(out, pictures, progress)
    finally:
        rehearsal.close()


class Rehearsal:
    """One lock-step rehearsal: the cart, the show on it, the judge and the pictures."""

    def __init__(
        self,
        scenario: Scenario,
        calibration: ProCam | Planar | Fixed | None = None,
        clock: Clock | None = None,
        board: Board | None = None,
        models: MotionParameters | None = None,
    ) -> None:
        self.casting = casting_of(scenario)
        check_photos(scenario, tuple(self.casting.sources) != (DOTS,))
        self.world = World(scenario)
        self.scenario = scenario
        self.journal = Journal()
        for note in self.world.notes:
            self.journal(0.0, "NOTE", note)
        self.calibration = calibration or calibrate(self.world, self.journal)
        cart = SimulatedCart(self.world, clock or VirtualClock(), self.journal)
        self.lockstep = LockStep(cart, self.calibration, self.casting, board, models)
        self.judge = Judge(self.world, load_dots(paths.configs() / "characters" / "dots"))
        self.measured: list[FrameMeasurement] = []
        self.arrivals = Arrivals(scenario)
        self.leads_s: list[float] = []
        self.mouth_lags_s: list[float] = []

    def close(self) -> None:
        """Free the graphics of the rehearsal."""
        self.lockstep.close()

    def run(self, out: Path | None, pictures: bool, progress: Progress) -> dict[str, Any]:
        """Play to the end, write the report (and pictures) into `out`, and return the report."""
        taker = self.pictures(out) if out is not None and pictures else None
        try:
            return self._run(out, taker, progress)
        except BaseException:
            if taker is not None:
                taker.abandon()
            raise

    def _run(self, out: Path | None, taker: Any, progress: Progress) -> dict[str, Any]:
        duration_s = self.world.duration_s
        task = progress.add_task(self.scenario.name, total=duration_s)
        for flip in self.lockstep.play(duration_s):
            progress.update(task, completed=self.lockstep.cart.clock.now())
            if flip is None:
                continue
            self.measured.append(self.judge.examine(flip.probe, flip.picture.light_s))
            if flip.picture.lead_s is not None and flip.picture.items:
                self.leads_s.append(flip.picture.lead_s)
            if flip.picture.mouth_lag_s is not None and flip.picture.items:
                self.mouth_lags_s.append(flip.picture.mouth_lag_s)
            self.arrivals.look(flip.picture.items, flip.picture.light_s)
            if taker is not None:
                taker.take(flip, self.lockstep.last_seen, self.lockstep.caption(flip.flip_s))
        report = self.report(self.lockstep.observer.summary(), self.lockstep.voice.history)
        if out is not None:
            figures.write_json(out / "report.json", report)
            figures.write_json(out / "timings.json", self._timings())
            keep_characters(self.lockstep.board.folder, out)
        if taker is not None and out is not None:
            self.finish(taker, out, report)
        return report

    def pictures(self, out: Path) -> Any:
        from hypermask.rehearsal.pictures import Pictures

        _make_folder(out)
        try:
            return Pictures(self.lockstep.cart, out / "show.mp4", self.world.duration_s)
        except HypermaskError as error:
            if error.code != "FILM-FFMPEG":
                raise
            # The figures do not need the film: say what is missing and go on.
            self.journal(0.0, error.code, str(error))
            print(error, file=sys.stderr)
            return None

    def finish(self, taker: Any, out: Path, report: dict[str, Any]) -> None:
        from hypermask.rehearsal.sheet import write_sheet

        taker.close()
        write_sheet(out / "contact-sheet.png", report, taker.moments)

    def report(self, tracking: dict[str, Any], mouth: Sequence[MouthFrame]) -> dict[str, Any]:
        """The report of a lock-step run; a real-time run replaces what differs."""
        scenario, lockstep = self.scenario, self.lockstep
        origin_s = self.world.origin_s
        measured = figures.shifted(self.measured, origin_s)
        latency = scenario.latency
        return {
            "version": figures.VERSION,
            "scenario": scenario.name,
            "mode": "lock-step",
            "mapping": scenario.mapping,
            "character": scenario.character,
            "prediction": scenario.tracking.prediction,
            "motion_models": "as shipped",
            "duration_s": round(self.world.duration_s, 6),
            "frames": len(self.measured),
            "registration_mm": figures.registration(measured),
            "tracking": tracking,
            "lead_ms": figures.spread(self.leads_s, 1e3),
            "mouth_lag_ms": figures.spread(self.mouth_lags_s, 1e3),
            "lip_sync": figures.lip_sync(scenario, self.mouth_lags_s),
            "compute_ms": {
                "clock": "virtual: what the scenario's [latency] charges; measured wall times of "
                "this run are in timings.json",
                "tracking": _charged(latency.tracking_ms),
                "stage": _charged(latency.latch_ms),
                "voice": _charged(latency.voice_ms),
            },
            "missed_flips": lockstep.missed_flips,
            "head": lockstep.head_log.report(origin_s),
            "arrivals": self.arrivals.report(origin_s),
            "calibration": self._calibration(),
            "outages": figures.outages(scenario, measured),
            "mouth": figures.mouth(mouth, origin_s),
            "events": self.journal.as_data(origin_s),
            "series": figures.series(measured),
        }

    def _calibration(self) -> dict[str, Any]:
        calibration = self.calibration
        if isinstance(calibration, Planar):
            return {
                "kind": calibration.kind,
                "distance_m": round(calibration.distance_m, 5),
                "band_m": [round(edge, 5) for edge in calibration.band_m],
                "expected_mm": round(
                    calibration.expected_error_m(float(self.world.rest[2])) * 1e3, 4
                ),
            }
        if isinstance(calibration, Fixed):
            return {"kind": "fixed", "expected_mm": round(calibration.expected_mm, 4)}
        return {"kind": "procam", "baseline_m": round(calibration.baseline_m, 5)}

    def _timings(self) -> dict[str, Any]:
        lockstep = self.lockstep
        tracker = lockstep.tracker
        return {
            "what": "wall-clock time of each step on this machine, in milliseconds",
            "compute_ms": {
                "tracking": figures.spread([] if tracker is None else tracker.compute_s, 1e3),
                "stage": figures.spread(lockstep.stage.compute_s, 1e3),
                "voice": figures.spread(lockstep.voice.compute_s, 1e3),
            },
        }


def _make_folder(folder: Path) -> None:
    """Raises `HypermaskError` DISK-WRITE."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HypermaskError(
            "DISK-WRITE",
            f"cannot make the folder {folder}: {error.strerror or error}",
            "Choose another --out.",
        ) from error


def _charged(value: float) -> dict[str, float]:
    return {"p50": value, "p99": value}


def progress_bar(quiet: bool) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f} of {task.total:.1f} s"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=quiet,
    )
