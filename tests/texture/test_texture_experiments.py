"""The paper's experiments: honest folds, the right error, every row of the tables."""

import numpy as np
import pytest

from hypermask.bench import texture as bench
from hypermask.errors import UsageError
from hypermask.texture import experiments
from hypermask.texture.estimate import PAPER_BASES
from hypermask.texture.experiments import (
    BOTH,
    COUNTS,
    METHODS,
    SPACINGS,
    Faces,
    Fill,
    Trial,
    error,
    fills,
    fold_models,
    hidden_parts,
    trials,
)
from hypermask.texture.morphable import SIDE, load_model


@pytest.fixture(scope="module")
def faces() -> Faces:
    """Twelve faces that the shipped model can make, wholly believed."""
    model, rng = load_model(), np.random.default_rng(4)
    wanted = rng.normal(size=(12, 10)) * np.sqrt(model.variances[:10]) * 0.7
    textures = np.array([model.texture(coefficients) for coefficients in wanted])
    return Faces(textures, textures, np.ones((12, SIDE, SIDE), np.float32))


def test_the_error_is_the_papers() -> None:
    target = np.zeros((2, 2, 3), np.float32)
    estimated = np.array([[[3, 0, 0], [0, 6, 3]], [[99, 99, 99], [0, 0, 0]]], np.float32)
    where = np.array([[True, True], [False, False]])
    assert error(target, estimated, where) == pytest.approx((3 + 6 + 3) / (3 * 2))


def test_no_model_has_seen_the_faces_it_is_measured_on(faces: Faces, monkeypatch) -> None:
    seen = []
    make = experiments.make_model

    def watched(completed: np.ndarray, count: int):
        seen.append(completed)
        return make(completed, count)

    monkeypatch.setattr(experiments, "make_model", watched)
    left_out = []
    for _, unknown in fold_models(faces):
        left_out += unknown.tolist()
        for face in unknown:
            for known in seen:
                assert np.abs(known - faces.textures[face]).mean(axis=(1, 2, 3)).min() > 0.5
        seen.clear()
    assert sorted(left_out) == list(range(12))


def test_every_setting_is_tried_and_more_bases_tell_more(faces: Faces, monkeypatch) -> None:
    monkeypatch.setattr(experiments, "SPACINGS", (8, 16))
    monkeypatch.setattr(experiments, "COUNTS", (1, 5, 20))
    model, unknown = next(fold_models(faces))
    done = []
    rows = trials(model, faces, unknown.tolist(), lambda: done.append(1))
    assert len(rows) == len(done) == 2 * 4 * len(unknown)
    assert {(r.solver, r.spacing, r.count) for r in rows} == {
        (solver, *setting) for solver in BOTH for setting in ((8, 20), (16, 20), (8, 1), (8, 5))
    }
    few, many = (np.mean([r.error for r in rows if r.count == n]) for n in (1, 20))
    assert many < 0.5 * few
    assert all(r.seconds > 0 for r in rows)


def test_each_part_is_filled_by_each_method(faces: Faces) -> None:
    model = load_model()
    rows = fills(model, faces, [0, 1, 2])
    assert {(r.part, r.method) for r in rows} == {(p, m) for p in hidden_parts() for m in METHODS}
    by = {m: np.mean([r.error for r in rows if r.method == m]) for m in METHODS}
    assert by["PCA"] < by["mean"] and by["PCA + residual"] < by["mean + residual"]


def test_the_number_of_faces_can_be_chosen(monkeypatch) -> None:
    monkeypatch.delenv("HYPERMASK_BENCH_FACES", raising=False)
    assert bench._wanted(130) == 30
    monkeypatch.setenv("HYPERMASK_BENCH_FACES", "all")
    assert bench._wanted(130) == 130
    for wrong in ("few", "3", "-7", ""):
        monkeypatch.setenv("HYPERMASK_BENCH_FACES", wrong)
        with pytest.raises(UsageError) as caught:
            bench._wanted(130)
        assert caught.value.code == "BENCH-FACES"


def test_the_tables_show_the_median_time_and_the_mean_error() -> None:
    tried = [
        Trial(solver, k, n, seconds * (100 if solver == BOTH[0] else 1) / k, 4.0, 8.0)
        for solver in BOTH
        for k, n in [(k, PAPER_BASES) for k in SPACINGS] + [(8, n) for n in COUNTS if n != 20]
        for seconds in (0.001, 0.002, 0.9)
    ]
    filled = [Fill(part, method, 5.0) for part in hidden_parts() for method in METHODS]
    rows = bench._by_spacing(tried) + bench._by_count(tried) + bench._by_part(filled)
    assert rows[0][:6] == ("20 bases", "k = 1", "Levenberg-Marquardt", 200.0, 4.0, 8.0)
    assert len(rows) == 2 * len(SPACINGS) + 2 * len(COUNTS) + 25
    assert bench._ratios(tried)["paper_k1_over_paper_k8"] == pytest.approx(8)
    assert bench._ratios(tried)["paper_k1_over_ridge_k8"] == pytest.approx(800)
    assert bench._plot(tried, filled).startswith(b"\x89PNG")
