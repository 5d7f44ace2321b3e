"""The texture morphable model: what it holds, that it is whole, and what it estimates."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.face.mesh import LANDMARKS, load_mesh
from hypermask.texture.build import mean_texture
from hypermask.texture.estimate import (
    blend,
    carried,
    estimate,
    levenberg_marquardt,
    on_grid,
    ridge,
    small,
)
from hypermask.texture.morphable import (
    FOLDER,
    SIDE,
    MorphableModel,
    load_model,
    principal_components,
    save_model,
)
from hypermask.texture.morphable_train import folds


@pytest.fixture(scope="module")
def model() -> MorphableModel:
    return load_model()


@pytest.fixture(scope="module")
def someone(model: MorphableModel) -> tuple[np.ndarray, np.ndarray]:
    """(coefficients, texture) of a face that the model can make."""
    wanted = np.random.default_rng(5).normal(size=20) * np.sqrt(model.variances[:20]) * 0.6
    return wanted, model.texture(wanted)


def test_the_shipped_model_is_small_and_belongs_to_the_mesh(model: MorphableModel) -> None:
    size = sum(file.stat().st_size for file in FOLDER.glob("morphable.*"))
    assert size <= 2_000_000
    assert 20 <= model.count <= 40
    assert model.mean.shape == (SIDE, SIDE, 3) and model.spread.min() > 1
    rest = load_mesh().rest[:LANDMARKS] * 1000
    assert np.abs(model.landmarks - rest).max() < 1.0, "the mesh moved: train the model again"


def test_the_bases_are_orthonormal_and_in_order(model: MorphableModel) -> None:
    flat = model.bases.reshape(model.count, -1)
    np.testing.assert_allclose(flat @ flat.T, np.eye(model.count), atol=0.03)
    assert (np.diff(model.variances) < 0).all()


def test_no_texture_of_the_model_leaves_the_symmetry_of_the_mesh(model: MorphableModel) -> None:
    """Every face was also used mirrored: the mean is symmetric."""
    assert np.abs(model.mean - model.mean[:, ::-1]).mean() < 1.0


def test_what_is_saved_is_what_is_loaded(tmp_path: Path) -> None:
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    bases = np.array([np.cos(x * 3), np.sin(y * 5 + x)])[..., None].repeat(3, axis=3)
    bases /= np.linalg.norm(bases.reshape(2, -1), axis=1)[:, None, None, None]
    shape = (SIDE, SIDE, 3)
    made = MorphableModel(
        np.full(shape, 120, np.float32),
        bases.astype(np.float32),
        np.array([900.0, 100.0]),
        np.full((SIDE, SIDE), 8, np.float32),
        30.0,
        np.zeros((468, 2)),
    )
    save_model(made, tmp_path)
    read = load_model(tmp_path)
    np.testing.assert_allclose(read.mean, made.mean, atol=1.5)
    np.testing.assert_allclose(read.bases, made.bases, atol=0.03 * np.abs(made.bases).max())
    np.testing.assert_allclose(read.spread, made.spread, atol=0.3)
    assert read.noise == made.noise and list(read.variances) == [900.0, 100.0]


@pytest.mark.parametrize("harm", ["absent", "damaged", "version", "json"])
def test_an_unusable_model_says_so(tmp_path: Path, harm: str) -> None:
    for file in FOLDER.glob("morphable.*"):
        shutil.copy(file, tmp_path)
    picture, fields = tmp_path / "morphable.webp", tmp_path / "morphable.json"
    if harm == "absent":
        picture.unlink()
    if harm == "damaged":
        picture.write_bytes(picture.read_bytes()[:-1] + b"!")
    if harm == "version":
        fields.write_text(json.dumps({**json.loads(fields.read_text()), "version": 99}))
    if harm == "json":
        fields.write_text("{")
    with pytest.raises(DataError) as caught:
        load_model(tmp_path)
    assert caught.value.code == "TEXTURE-MODEL"


def test_principal_components_are_those_of_the_covariance() -> None:
    rng = np.random.default_rng(2)
    data = rng.normal(size=(30, 2, 2, 3)).astype(np.float32) * np.arange(1, 13).reshape(2, 2, 3)
    mean, bases, variances = principal_components(data, 4)
    values, vectors = np.linalg.eigh(np.cov(data.reshape(30, 12).T))
    np.testing.assert_allclose(variances, values[::-1][:4], rtol=1e-3)
    agreement = np.abs((bases.reshape(4, 12) * vectors[:, ::-1].T[:4]).sum(axis=1))
    np.testing.assert_allclose(agreement, 1, atol=1e-3)
    np.testing.assert_allclose(mean, data.mean(axis=0))


@pytest.mark.parametrize("spacing", [1, 4, 8])
def test_both_solvers_find_the_face_they_are_shown(model, someone, spacing: int) -> None:
    wanted, texture = someone
    weight = np.ones((SIDE, SIDE), np.float32)
    paper = levenberg_marquardt(model, texture, weight, spacing, 20)
    np.testing.assert_allclose(paper, wanted, rtol=0.02, atol=2.0)
    ours = ridge(replace(model, noise=1e-3), texture, weight, spacing, 20)
    np.testing.assert_allclose(ours, wanted, rtol=0.02, atol=2.0)


def test_levenberg_marquardt_is_the_direct_least_squares_solution(model, someone) -> None:
    """PAPERS B5 with weights between 0 and 1, against a solve of the same linear system."""
    rng = np.random.default_rng(1)
    texture = someone[1] + rng.normal(0, 10, someone[1].shape).astype(np.float32)
    weight = rng.random((SIDE, SIDE)).astype(np.float32)
    rows = np.repeat(on_grid(weight, 8).ravel(), 3)[:, None]
    bases = np.array([on_grid(basis, 8).ravel() for basis in model.bases[:20]]).T
    residual = on_grid(texture - model.mean, 8).reshape(-1, 1)
    direct = np.linalg.lstsq(rows * bases, rows * residual, rcond=None)[0][:, 0]
    found = levenberg_marquardt(model, texture, weight, 8, 20)
    np.testing.assert_allclose(found, direct, rtol=1e-3, atol=1e-2)


def test_ridge_is_the_most_likely_face(model, someone) -> None:
    """No step away from it lowers the misfit and the prior together."""
    texture, weight = someone[1] + 9, np.ones((SIDE, SIDE), np.float32)
    found = ridge(model, texture, weight, 8, 10)

    def cost(place: np.ndarray) -> float:
        left = texture - model.mean - np.tensordot(place, model.bases[:10], 1)
        left = np.mean([left[y::8, x::8] for y in (2, 5) for x in (2, 5)], axis=0)
        noise = model.noise * 800 / 64
        return float(np.square(left).sum() / noise + (place**2 / model.variances[:10]).sum())

    least = cost(found)
    for axis in range(10):
        for sign in (-1, 1):
            step = np.zeros(10)
            step[axis] = sign * 0.05 * np.sqrt(model.variances[axis])
            assert cost(found + step) > least


def test_with_nothing_seen_the_mean_face_is_the_estimate(model) -> None:
    nothing = np.zeros((SIDE, SIDE), np.float32)
    found = estimate(model, np.full((SIDE, SIDE, 3), 255, np.float32), nothing)
    np.testing.assert_allclose(found.coefficients, 0, atol=1e-9)
    np.testing.assert_allclose(found.modelled, model.mean, atol=1e-3)


def test_a_hidden_half_comes_back_and_nearer_than_the_mean(model, someone) -> None:
    texture = someone[1]
    weight = np.ones((SIDE, SIDE), np.float32)
    weight[:, SIDE // 2 :] = 0
    shown = np.where(weight[..., None] > 0, texture, 255).astype(np.float32)
    found = estimate(model, shown, weight)
    hidden = weight == 0
    error = np.abs(found.whole - texture)[hidden].mean()
    assert error < 0.35 * np.abs(model.mean - texture)[hidden].mean()


def test_a_thing_before_the_face_is_not_taken_for_the_face(model, someone) -> None:
    """A green bar over cheek and nose, wholly believed: seen as strange, and not smeared about."""
    texture = someone[1].copy()
    texture[120:150, 60:150] = (30, 220, 40)
    weight = np.ones((SIDE, SIDE), np.float32)
    found = estimate(model, texture, weight)
    assert found.weight[125:145, 65:145].max() < 0.1
    assert found.weight[190:220, 100:160].min() > 0.9
    whole = blend(texture.clip(0, 255).astype(np.uint8), found.weight, found.whole).astype(float)
    assert np.abs(whole - someone[1]).mean() < 3
    assert np.abs(whole - someone[1])[120:150, 60:150].mean() < 15


def test_the_persons_own_shade_is_carried_into_the_hidden_part() -> None:
    weight = np.ones((SIDE, SIDE), np.float32)
    weight[:60] = 0
    residual = np.full((SIDE, SIDE, 3), 12.0, np.float32) * weight[..., None]
    np.testing.assert_allclose(carried(residual, weight)[:60], 12, atol=0.5)


def test_the_blend_follows_the_weight() -> None:
    dark, light = np.zeros((2, 2, 3), np.float32), np.full((2, 2, 3), 100, np.uint8)
    weight = np.array([[0, 0.25], [0.5, 1]], np.float32)
    np.testing.assert_allclose(blend(light, weight, dark)[..., 0], weight * 100)


def test_folds_leave_every_face_out_once() -> None:
    parts = folds(23)
    left_out = np.concatenate([unknown for _, unknown in parts])
    assert sorted(left_out) == list(range(23))
    assert all(not set(known) & set(unknown) for known, unknown in parts)


def test_the_mean_character_is_near_the_models_mean(model) -> None:
    inside = np.s_[64:192, 80:176]
    assert np.abs(small(mean_texture()) - model.mean)[inside].mean() < 25
