"""The figures the product is proud of, on recorded heads that the fitted models have not seen."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from hypermask.tracking.motion_bench import (
    Condition,
    displacements_mm,
    plot,
    run,
    score_clip,
    table,
)
from hypermask.tracking.motion_clips import frame_times, measure, read_clip, read_clips
from hypermask.tracking.motion_model import axis_matrices, parameters, read_parameters
from hypermask.tracking.motion_train import (
    TASKS,
    fit_all,
    gather_all,
    parameters_text,
    unrolled_weights,
)

MOTION = Path(__file__).parents[2].parent / "shared" / "data" / "motion"
needs_motion = pytest.mark.skipif(not MOTION.is_dir(), reason="../shared/data/motion is absent")


def some_clips(folder: Path, names: tuple[str, ...]) -> Path:
    for name in names:
        shutil.copy(MOTION / f"{name}.csv", folder)
    return folder


def test_displacement_counts_across_the_line_of_sight_only() -> None:
    rotation, sight = np.eye(3)[None], np.array([[0.0, 0.0, 2.0]])
    along, across = np.array([[0.0, 0.0, 0.01]]), np.array([[0.003, 0.004, 0.0]])
    assert displacements_mm(rotation, sight + along, rotation, sight)[0] == pytest.approx(0)
    assert displacements_mm(rotation, sight + across, rotation, sight)[0] == pytest.approx(5)


@needs_motion
@pytest.mark.parametrize(
    ("rate_hz", "lead_s", "limit_mm", "ratio"), [(120, 0.0425, 3.2, 0.22), (240, 0.0215, 1.0, 0.14)]
)
def test_heads_are_foreseen(rate_hz: float, lead_s: float, limit_mm: float, ratio: float) -> None:
    names = ("002_05", "005_01", "005_09", "005_14", "006_07")
    clips = [read_clip(MOTION / f"{name}.csv") for name in names]
    scores = []
    for clip in clips:
        measured = measure(
            clip, frame_times(clip, rate_hz)[: int(5 * rate_hz)], np.random.default_rng(7)
        )
        scores.append(score_clip(clip, measured, [lead_s], every=4))
    medians = {
        mode: np.median([s[mode, lead_s].rms_mm for s in scores])
        for mode in ("default", "kalman", "off")
    }
    assert medians["default"] <= limit_mm
    assert medians["default"] <= ratio * medians["off"]
    assert medians["default"] < 0.9 * medians["kalman"] < medians["off"]
    honest = np.median([s["default", lead_s].normalised for s in scores], axis=0)
    assert (honest > 0.5).all() and (honest < 2).all()


def test_unrolled_weights_go_on_along_a_straight_line() -> None:
    components = parameters().default.axes[3]
    for task in TASKS:
        weights = unrolled_weights(axis_matrices(components), task, (0.04e-3) ** 2, 1.0)
        back = -0.2 * np.arange(1, task.frames + 1) / task.rate_hz
        assert weights @ back == pytest.approx(0.2 * task.lead_s, rel=0.25)


@needs_motion
def test_cross_validation_reports_every_clip_and_beats_both_references(tmp_path: Path) -> None:
    folder = some_clips(tmp_path, ("005_01", "005_14", "006_07"))
    told: list[float] = []
    carts = (
        Condition("reference cart", 120, (0.02, 0.0425)),
        Condition("fast cart", 240, (0.0215,)),
    )
    result = run(folder, carts, folds=2, every=6, progress=told.append, effort=4)
    assert result["clips"] == ["005_01", "005_14", "006_07"]
    assert told == sorted(told) and told[-1] == 1.0
    for condition in result["conditions"]:
        for lead in condition["leads"]:
            modes = lead["modes"]
            assert all(len(mode["rms_mm"]) == 3 for mode in modes.values())
            assert modes["default"]["median_mm"] < modes["kalman"]["median_mm"]
            assert modes["default"]["ratio"] < 0.25
            assert modes["off"]["ratio"] == 1
    assert json.loads(json.dumps(result)) == result
    assert "005_14" in table(result)
    pytest.importorskip("matplotlib")
    plot(result, tmp_path / "bench.png")
    assert (tmp_path / "bench.png").read_bytes().startswith(b"\x89PNG")


@needs_motion
def test_training_is_reproducible_and_its_file_is_read_back(tmp_path: Path) -> None:
    clips = read_clips(some_clips(tmp_path, ("005_01",)))
    texts = [
        parameters_text(fit_all(gather_all(clips), range(1), effort=1), clips) for _ in range(2)
    ]
    assert texts[0] == texts[1]
    file = tmp_path / "parameters.json"
    file.write_text(texts[0])
    read = read_parameters(file)
    assert parameters_text(read, clips) == texts[0]
