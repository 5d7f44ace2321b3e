"""Advice in words for photographs that work but could be better."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask import paths
from hypermask.texture.advice import advice, yaw_deg
from hypermask.texture.build import build_character
from hypermask.texture.landmarks import FaceFinder, Landmarks
from hypermask.texture.models import MODELS
from hypermask.texture.photo import load_photo

FACES = Path(__file__).parents[2].parent / "shared" / "data" / "faces"
PHOTOS = sorted(FACES.glob("*.jpg"))[::26]

pytestmark = [
    pytest.mark.skipif(not PHOTOS, reason="../shared/data/faces is absent"),
    pytest.mark.skipif(
        not all((paths.models() / model.file).is_file() for model in MODELS),
        reason="the face models are absent: run 'make models'",
    ),
]


@pytest.fixture(scope="module")
def seen() -> list[tuple[np.ndarray, Landmarks]]:
    finder = FaceFinder()
    images = [load_photo(photo) for photo in PHOTOS]
    return [(image, finder.find(image)) for image in images]


def _turned(face: Landmarks, yaw: float) -> Landmarks:
    cosine, sine = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    turn = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
    middle = face.points.mean(axis=0)
    return replace(face, points=(face.points - middle) @ turn.T + middle)


def test_a_studio_photograph_needs_no_advice(seen) -> None:
    for image, face in seen:
        assert advice(image, face) == ()


def test_blur_is_seen(seen) -> None:
    for image, face in seen:
        blurred = cv2.GaussianBlur(image, (0, 0), face.eye_distance / 40)
        (sentence,) = advice(blurred, face)
        assert "blurred" in sentence


def test_too_little_light_is_seen(seen) -> None:
    for image, face in seen:
        assert any("dark" in sentence for sentence in advice((image * 0.2).astype(np.uint8), face))


def test_a_turned_head_is_seen(seen) -> None:
    for image, face in seen:
        for yaw in (-28, 28):
            turned = _turned(face, yaw)
            assert abs(abs(yaw_deg(turned)) - 28) < 9
            assert any("turned" in sentence for sentence in advice(image, turned))


def test_an_open_mouth_is_seen(seen) -> None:
    for image, face in seen:
        points = face.points.copy()
        points[14, 1] += 0.3 * face.eye_distance
        sentences = advice(image, replace(face, points=points))
        assert any("mouth" in sentence for sentence in sentences)


def test_a_small_face_is_said_to_be_small(seen) -> None:
    image, face = seen[0]
    small = cv2.resize(image, None, fx=0.3, fy=0.3, interpolation=cv2.INTER_AREA)
    found = replace(face, points=face.points * 0.3, pupils=face.pupils * 0.3)
    assert any("small" in sentence for sentence in advice(small, found))


def test_building_tells_the_advice(tmp_path: Path) -> None:
    image = cv2.GaussianBlur(load_photo(PHOTOS[0]), (0, 0), 6)
    cv2.imwrite(str(tmp_path / "blurred.png"), image)
    told: list[str] = []
    build_character(tmp_path / "blurred.png", "someone", tmp_path / "out", tell=told.append)
    assert any("blurred" in sentence for sentence in told)
