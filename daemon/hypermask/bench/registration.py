"""Registration: how far from its place the light lands on the mask, judged from pixels."""

from __future__ import annotations

import itertools
from functools import lru_cache
from pathlib import Path

import numpy as np

from hypermask.bench.runs import calibration, clips, played, scenario, tracked
from hypermask.bench.table import Table
from hypermask.tracking.motion_clips import read_clips
from hypermask.tracking.motion_model import MotionParameters
from hypermask.tracking.motion_train import fit_all, gather_all
from hypermask_sim.judge import Judge
from hypermask_sim.scenario import Attitude

DISTANCES_M = (1.2, 1.5, 1.8, 2.1, 2.4)
STILL_S = 0.4
FOLDS = 5
MODES = ("default", "kalman", "off")


def attitudes(first_roll: float) -> list[Attitude]:
    """The working range: rolls all round, the corners and middles of pitch +-20 and yaw +-30."""
    turns = itertools.product((-20.0, 0.0, 20.0), (-30.0, 0.0, 30.0))
    return [
        Attitude(roll=(first_roll + 45.0 * i) % 360, pitch=pitch, yaw=yaw)
        for i, (pitch, yaw) in enumerate(turns)
    ]


def still(progress: bool) -> Table:
    """Still mask, click calibration (3 distances x 2 poses, 1 px), whole working range."""
    cart = scenario("reference-cart", f"duration_s={STILL_S}")
    made = calibration(cart)
    rows, frames, untracked, wrong = [], [], 0, 0
    poses = [
        (distance, attitude)
        for turn, distance in enumerate(DISTANCES_M)
        for attitude in attitudes(72.0 * turn)
    ]
    by_distance: dict[float, list[float]] = {distance: [] for distance in DISTANCES_M}
    for distance, attitude in tracked(poses, "still", progress):
        rehearsal = played(cart.still(distance, attitude), made)
        summary = rehearsal.lockstep.observer.summary()
        untracked += rehearsal.lockstep.observer.trackable - rehearsal.lockstep.observer.tracked
        wrong += summary["wrong_labels"]
        frames += rehearsal.measured
        by_distance[distance] += [e for f in rehearsal.measured for _, e in f.errors]
    for distance, errors in by_distance.items():
        rows.append(_row(f"{distance:.1f} m", errors))
    total = Judge.summary(frames)
    rows.append(_row("all", [e for errors in by_distance.values() for e in errors]))
    return Table(
        "still",
        "Still mask: registration over the working range",
        ("distance", "rms mm", "p95 mm", "max mm"),
        rows,
        (
            f"{len(poses)} poses (roll 0 to 360, pitch +-20, yaw +-30 deg), {total.dots} dots; "
            f"frames not tracked after the first lock: {untracked}; wrong labels: {wrong}.",
            "Target: rms <= 1.0 mm, tracked 100 %, wrong labels 0.",
        ),
        data={"rms_mm": total.rms, "untracked": untracked, "wrong_labels": wrong},
    )


def _row(name: str, errors: list[float]) -> tuple[str, float, float, float]:
    data = np.array(errors)
    rms = float(np.sqrt(np.mean(data**2)))
    return name, rms, float(np.percentile(data, 95)), float(data.max())


@lru_cache(maxsize=1)
def held_out_models() -> dict[str, MotionParameters]:
    """For each clip by name, motion models fitted on clips of other folds."""
    read = read_clips(clips()[0].parent)
    gathered = gather_all(read, lambda: None)
    models: dict[str, MotionParameters] = {}
    for fold in range(FOLDS):
        held_out = set(range(fold, len(read), FOLDS))
        fitted = fit_all(gathered, [i for i in range(len(read)) if i not in held_out])
        models |= {Path(read[i].name).stem: fitted for i in held_out}
    return models


def motion(progress: bool) -> Table:
    return _motion("motion", "reference-cart", 5.0, progress)


def motion_fast(progress: bool) -> Table:
    return _motion("motion-fast", "fast-cart", 2.5, progress)


def _motion(name: str, cart: str, limit_mm: float, progress: bool) -> Table:
    """Every clip at 1.8 m, with each way of predicting, by models fitted on other clips."""
    models = held_out_models()
    made = calibration(scenario(cart))
    rows: list[tuple[str | float, ...]] = []
    leads: list[float] = []
    for clip in tracked(clips(), cart, progress):
        row: list[str | float] = [clip.stem]
        for mode in MODES:
            of = scenario(cart, f"performer.motion={clip}", f"tracking.prediction={mode}")
            rehearsal = played(of, made, models[clip.stem])
            row.append(Judge.summary(rehearsal.measured).rms)
            leads += rehearsal.leads_s
        rows.append((*row, float(row[1]) / float(row[-1])))
    medians = np.median(np.array([row[1:] for row in rows], float), axis=0)
    ratio = medians[0] / medians[2]
    rows.append(("median", *(float(value) for value in medians[:3]), float(ratio)))
    return Table(
        name,
        f"Real motion at 1.8 m, {cart}: registration rms, mm",
        ("clip", *MODES, "default / off"),
        rows,
        (
            f"Lead from mid-exposure to light: median {np.median(leads) * 1e3:.1f} ms.",
            f"Each clip is predicted by models fitted on other clips ({FOLDS} folds).",
            f"Target: median of default <= {limit_mm} mm and <= 0.38 of off.",
        ),
        data={"median_mm": float(medians[0]), "ratio": float(ratio)},
    )
