"""How well the motion of a head is foreseen: cross-validated error on the mask, in millimetres.

The figure is the rms over time of the displacement, across the line of sight, of points spread over
the mask between where they were predicted and where they are when the light arrives. The models are
fitted on the other clips (`folds` groups are left out in turn).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hypermask.geometry import Array
from hypermask.tracking.motion import MODES, MotionFilter, predict
from hypermask.tracking.motion_clips import Clip, Measured, frame_times, measure, read_clips
from hypermask.tracking.motion_model import AXES, MotionParameters
from hypermask.tracking.motion_train import EFFORT, FITS, TASKS, fit_all, gather_all

SETTLING_S = 0.3  # of each clip, not counted
SEED = 100  # not the training's


@dataclass(frozen=True)
class Condition:
    """A cart: camera rate, and the leads from mid-exposure to light to judge, in seconds."""

    name: str
    rate_hz: float
    leads_s: tuple[float, ...]


CONDITIONS = (
    Condition("reference cart", 120, (0.010, 0.020, 0.030, 0.038, 0.0425, 0.047, 0.060, 0.080)),
    Condition("fast cart", 240, (0.010, 0.019, 0.0215, 0.024, 0.040)),
)
TYPICAL_LEADS_S = {"reference cart": 0.0425, "fast cart": 0.0215}


@dataclass(frozen=True)
class Score:
    """rms_mm over the mask; normalised (6,): rms of the errors over their predicted deviations."""

    rms_mm: float
    normalised: Array


def mask_points() -> Array:
    """(9, 3) points over the mask, metres, mask frame."""
    x, y = np.meshgrid([-0.07, 0.0, 0.07], [-0.095, 0.0, 0.095])
    return np.stack([x.ravel(), y.ravel(), np.zeros(9)], axis=1)


def displacements_mm(
    rotations: Array, translations: Array, true_rotations: Array, true_translations: Array
) -> Array:
    """(k,) rms over the mask's points of their displacement across the line of sight."""
    points = mask_points()
    moved = points @ (rotations - true_rotations).transpose(0, 2, 1)
    moved += (translations - true_translations)[:, None, :]
    sight = true_translations / np.linalg.norm(true_translations, axis=1, keepdims=True)
    moved -= (moved @ sight[:, :, None]) * sight[:, None, :]
    return np.asarray(1e3 * np.sqrt(np.mean(np.sum(moved**2, axis=2), axis=1)), float)


def score_clip(
    clip: Clip,
    measured: Measured,
    leads_s: Sequence[float],
    models: MotionParameters | None = None,
    modes: Sequence[str] = MODES,
    every: int = 1,
) -> dict[tuple[str, float], Score]:
    """Run the filter over a clip and judge each mode and lead, at every `every`-th frame."""
    motion = MotionFilter(models=models)
    rows: dict[tuple[str, float], list[tuple[float, Array, Array, Array]]] = {
        (mode, lead): [] for mode in modes for lead in leads_s
    }
    for index, time_s in enumerate(measured.times):
        motion.update(time_s, measured.pose(index), measured.covariances[index])
        if time_s < SETTLING_S or index % every:
            continue
        record = motion.record()
        for (mode, lead), collected in rows.items():
            if time_s + lead < clip.duration_s:
                p = predict(record, time_s + lead, mode, models)
                collected.append((time_s + lead, p.pose.rotation, p.pose.translation, p.covariance))
    return {key: _score(clip, collected) for key, collected in rows.items()}


def _score(clip: Clip, collected: list[tuple[float, Array, Array, Array]]) -> Score:
    times, rotations, translations, covariances = (
        np.array(c) for c in zip(*collected, strict=True)
    )
    true_rotations, true_translations = clip.poses(times)
    distances = displacements_mm(rotations, translations, true_rotations, true_translations)
    turned = true_rotations @ rotations.transpose(0, 2, 1)
    small = 0.5 * np.stack(
        [turned[:, i, j] - turned[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1
    )
    errors = np.column_stack([small, true_translations - translations])
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    normalised = np.sqrt(np.mean(errors**2 / variances, axis=0))
    return Score(float(np.sqrt(np.mean(distances**2))), normalised)


def run(
    folder: Path,
    conditions: Sequence[Condition] = CONDITIONS,
    folds: int = 5,
    every: int = 2,
    progress: Callable[[float], None] = lambda fraction: None,
    effort: int = EFFORT,
) -> dict[str, Any]:
    """Cross-validated figures of all clips of `folder`. Raises `DataError` MOTION-CLIP.

    Returns ``{"clips": names, "folds": n, "conditions": [{"name", "rate_hz", "leads": [{"lead_ms",
    "modes": {mode: {"rms_mm": per clip, "median_mm", "ratio", "normalised": per axis}}}]}]}``;
    `ratio` is median_mm over that of "off". `progress` is told the fraction done.
    """
    clips = read_clips(folder)
    folds = min(folds, len(clips))
    meter = _Meter(len(clips) * (len(TASKS) + len(conditions)) + folds * FITS, progress)
    gathered = gather_all(clips, meter.tick)
    scores: list[list[dict[tuple[str, float], Score]]] = [[{} for _ in clips] for _ in conditions]
    for fold in range(folds):
        held_out = range(fold, len(clips), folds)
        chosen = [i for i in range(len(clips)) if i not in held_out] or list(held_out)
        models = fit_all(gathered, chosen, meter.tick, effort)
        for per_clip, condition in zip(scores, conditions, strict=True):
            for i in held_out:
                rng = np.random.default_rng([SEED, i])
                measured = measure(clips[i], frame_times(clips[i], condition.rate_hz), rng)
                per_clip[i] = score_clip(clips[i], measured, condition.leads_s, models, every=every)
                meter.tick()
    return {
        "clips": [clip.name for clip in clips],
        "folds": folds,
        "conditions": [
            summary(condition, per_clip)
            for condition, per_clip in zip(conditions, scores, strict=True)
        ],
    }


class _Meter:
    def __init__(self, total: int, progress: Callable[[float], None]) -> None:
        self._total, self._progress, self._done = total, progress, 0

    def tick(self) -> None:
        self._done += 1
        self._progress(self._done / self._total)


def summary(
    condition: Condition, per_clip: Sequence[dict[tuple[str, float], Score]]
) -> dict[str, Any]:
    """One condition's part of `run`'s result."""
    leads = []
    for lead in condition.leads_s:
        held = float(np.median([scores["off", lead].rms_mm for scores in per_clip]))
        modes = {}
        for mode in MODES:
            each = [scores[mode, lead] for scores in per_clip]
            median = float(np.median([s.rms_mm for s in each]))
            normalised = np.median([s.normalised for s in each], axis=0)
            modes[mode] = {
                "rms_mm": [round(s.rms_mm, 3) for s in each],
                "median_mm": round(median, 3),
                "ratio": round(median / held, 4),
                "normalised": dict(zip(AXES, np.round(normalised, 2).tolist(), strict=True)),
            }
        leads.append({"lead_ms": round(1e3 * lead, 2), "modes": modes})
    return {"name": condition.name, "rate_hz": condition.rate_hz, "leads": leads}


def table(result: dict[str, Any]) -> str:
    """The result as text: medians per lead, then the clips at each cart's typical lead."""
    lines = [f"{'cart':15s} {'lead ms':>7s}" + "".join(f" {m:>8s}" for m in MODES) + "   ratio"]
    for condition in result["conditions"]:
        for lead in condition["leads"]:
            medians = "".join(f" {lead['modes'][m]['median_mm']:8.2f}" for m in MODES)
            ratio = lead["modes"]["default"]["ratio"]
            lines.append(f"{condition['name']:15s} {lead['lead_ms']:7.1f}{medians} {ratio:7.3f}")
    for condition in result["conditions"]:
        lead = typical(condition)
        lines += ["", f"{condition['name']}, {lead['lead_ms']} ms, rms in mm per clip"]
        for i, clip in enumerate(result["clips"]):
            values = "".join(f" {lead['modes'][m]['rms_mm'][i]:8.2f}" for m in MODES)
            lines.append(f"{clip:15s} {'':7s}{values}")
    return "\n".join(lines)


def typical(condition: dict[str, Any]) -> dict[str, Any]:
    """The lead of a condition's result that is nearest to the cart's own."""
    wanted = 1e3 * TYPICAL_LEADS_S.get(condition["name"], 0.0425)
    leads: list[dict[str, Any]] = condition["leads"]
    return min(leads, key=lambda lead: abs(lead["lead_ms"] - wanted))


def plot(result: dict[str, Any], path: Path) -> None:
    """Write a PNG: median error over lead, and each clip at the cart's lead. Needs matplotlib."""
    from matplotlib.figure import Figure

    conditions = result["conditions"]
    figure = Figure(figsize=(11, 3.6 * len(conditions)), layout="constrained")
    axes = figure.subplots(len(conditions), 2, squeeze=False)
    for (over_lead, per_clip), condition in zip(axes, conditions, strict=True):
        _plot_leads(over_lead, condition)
        _plot_clips(per_clip, condition, result["clips"])
    figure.savefig(path, dpi=110)


_COLOURS = {"default": "tab:green", "kalman": "tab:orange", "off": "tab:gray"}
_LABELS = {"default": "fitted model", "kalman": "constant velocity", "off": "no prediction"}


def _plot_leads(axes: Any, condition: dict[str, Any]) -> None:
    for mode in reversed(MODES):
        leads = [lead["lead_ms"] for lead in condition["leads"]]
        medians = [lead["modes"][mode]["median_mm"] for lead in condition["leads"]]
        axes.plot(leads, medians, "o-", color=_COLOURS[mode], label=_LABELS[mode])
    axes.axhline(2, color="black", linestyle=":", linewidth=1)
    axes.text(leads[0], 2, "what an eye notices", va="bottom", fontsize=8)
    axes.set(
        title=f"{condition['name']}: camera {condition['rate_hz']:g} frames/s",
        xlabel="lead from mid-exposure to light, ms",
        ylabel="median over clips of the rms, mm",
        yscale="log",
    )
    axes.grid(alpha=0.3, which="both")
    axes.legend()


def _plot_clips(axes: Any, condition: dict[str, Any], clips: list[str]) -> None:
    lead = typical(condition)
    for offset, mode in zip((0.27, 0, -0.27), MODES, strict=True):
        heights = lead["modes"][mode]["rms_mm"]
        axes.bar(np.arange(len(clips)) - offset, heights, 0.27, color=_COLOURS[mode])
    axes.set_xticks(range(len(clips)), clips, rotation=60)
    axes.set(title=f"each clip at {lead['lead_ms']:g} ms", ylabel="rms on the mask, mm")
    axes.grid(alpha=0.3, axis="y")
