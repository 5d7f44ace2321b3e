"""What is seen when LEDs are hidden and when other lights appear."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from hypermask.bench.runs import Calibration, calibration, clips, played, scenario, tracked
from hypermask.bench.table import Table
from hypermask.errors import DataError
from hypermask.rehearsal.report import outages
from hypermask.rehearsal.run import Rehearsal
from hypermask_drivers.mask import LED_NAMES
from hypermask_sim.faults import FaultSettings
from hypermask_sim.judge import FrameMeasurement
from hypermask_sim.scenario import Scenario

FROM_S, TO_S, END_S = 2.0, 2.5, 3.2
ALL_TO_S, ALL_END_S = 3.0, 4.0
AFTER_S = 0.15


def hidden(progress: bool) -> Table:
    """Every pair of LEDs hidden for 0.5 s in motion, all hidden for 1 s, ten moving blobs."""
    clip = _clip()
    cart = scenario("reference-cart", f"performer.motion={clip}", f"duration_s={END_S}")
    made = calibration(cart)
    clean = played(cart, made)
    rows: list[tuple[str | float | None, ...]] = []
    pairs = list(itertools.combinations(LED_NAMES, 2))
    for pair in tracked(pairs, "two LEDs hidden", progress):
        fault = FaultSettings(kind="leds_hidden", from_s=FROM_S, to_s=TO_S, leds=pair)
        rehearsal = played(cart.model_copy(update={"faults": (fault,)}), made)
        rows.append(_pair_row(" + ".join(pair), clean, rehearsal))
    rows.append(_all_row(cart, made))
    rows.append(_blob_row(cart, made))
    return Table(
        "hidden",
        "Hidden LEDs and other lights, in motion",
        ("fault", "rms mm", "rms without mm", "ratio", "jump at return mm", "remarks"),
        rows,
        (
            f"Clip {Path(clip).stem}; rms over the {TO_S - FROM_S:.1f} s of the fault; the jump is "
            f"the largest step of the mean displacement from one frame to the next in the "
            f"{AFTER_S * 1e3:.0f} ms after the return, beyond that of the same frames without the "
            "fault.",
            "Target: ratio <= 2, jump <= 5 mm; black <= 400 ms after the LEDs went (150 ms to be "
            "sure, 250 ms to fade), right again <= 100 ms after their return; wrong locks 0.",
        ),
    )


def _clip() -> str:
    try:
        return str(next(clip for clip in clips() if clip.stem == "005_09"))
    except (DataError, StopIteration):
        return "dance"


def _window(rehearsal: Rehearsal, from_s: float, to_s: float) -> list[FrameMeasurement]:
    return [frame for frame in rehearsal.measured if from_s <= frame.time_s < to_s]


def _rms(frames: list[FrameMeasurement]) -> float:
    errors = np.array([error for frame in frames for _, error in frame.errors])
    return float(np.sqrt(np.mean(errors**2))) if errors.size else float("nan")


def _steps(frames: list[FrameMeasurement]) -> np.ndarray:
    means = np.array([frame.displacements_mm.mean(axis=0) for frame in frames if frame.errors])
    return np.diff(means, axis=0)


def _pair_row(name: str, clean: Rehearsal, with_fault: Rehearsal) -> tuple[str | float | None, ...]:
    during = [_rms(_window(r, FROM_S, TO_S)) for r in (with_fault, clean)]
    after = [_steps(_window(r, TO_S, TO_S + AFTER_S)) for r in (with_fault, clean)]
    jump = None
    if after[0].shape == after[1].shape and len(after[0]):
        jump = float(np.linalg.norm(after[0] - after[1], axis=1).max())
    return name, during[0], during[1], during[0] / during[1], jump, ""


def _all_row(cart: Scenario, made: Calibration) -> tuple[str | float | None, ...]:
    fault = FaultSettings(kind="leds_hidden", from_s=FROM_S, to_s=ALL_TO_S)
    changed = cart.model_copy(update={"faults": (fault,), "duration_s": ALL_END_S})
    rehearsal = played(changed, made)
    outage = outages(changed, rehearsal.measured)[0]
    remark = (
        f"black after {outage['black_after_ms']:.0f} ms, "
        f"right again after {outage['right_again_ms']:.0f} ms"
    )
    return "all five, 1 s", None, None, None, None, remark


def _blob_row(cart: Scenario, made: Calibration) -> tuple[str | float | None, ...]:
    faults = (
        FaultSettings(kind="extra_blobs", count=10),
        # a loss in the middle, so that the mask must be found again among the lights
        FaultSettings(kind="leds_hidden", from_s=1.0, to_s=1.5),
    )
    rehearsal = played(cart.model_copy(update={"faults": faults}), made)
    summary = rehearsal.lockstep.observer.summary()
    remark = (
        f"wrong locks {summary['wrong_locks']}, wrong labels {summary['wrong_labels']}, "
        f"tracked {summary['visible_fraction']:.1%}"
    )
    rms = _rms(_window(rehearsal, FROM_S, END_S))
    return "ten moving blobs", rms, None, None, None, remark
