"""A photograph without a usable face is refused in words, not made into a broken character."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask import paths
from hypermask.errors import DataError
from hypermask.texture.landmarks import FaceFinder

FACES = sorted((Path(__file__).parents[2].parent / "shared" / "data" / "faces").glob("*.jpg"))
pytestmark = [
    pytest.mark.skipif(not FACES, reason="the photographs of ../shared are absent"),
    pytest.mark.skipif(not paths.models().is_dir(), reason="the face models are absent"),
]


@pytest.fixture(scope="module")
def finder() -> FaceFinder:
    return FaceFinder()


def refused(finder: FaceFinder, picture: np.ndarray) -> str:
    with pytest.raises(DataError) as caught:
        finder.find(np.ascontiguousarray(picture))
    return caught.value.code


@pytest.fixture(scope="module", params=FACES[::26], ids=lambda path: path.stem)
def photo(request: pytest.FixtureRequest) -> np.ndarray:
    return cv2.imread(str(request.param))


def test_a_good_photograph_is_taken(finder: FaceFinder, photo: np.ndarray) -> None:
    assert finder.find(photo).eye_distance > 100


def test_upside_down(finder: FaceFinder, photo: np.ndarray) -> None:
    assert refused(finder, photo[::-1, ::-1]) == "FACE-TURNED"


def test_on_its_side_is_still_taken(finder: FaceFinder, photo: np.ndarray) -> None:
    assert finder.find(np.ascontiguousarray(np.rot90(photo))).eye_distance > 100


def test_cut_at_the_eyes(finder: FaceFinder, photo: np.ndarray) -> None:
    eyes = int(finder.find(photo).pupils[:, 1].mean())
    assert refused(finder, photo[eyes + 15 :]) in ("FACE-CUT", "FACE-NONE")


def test_dark(finder: FaceFinder, photo: np.ndarray) -> None:
    assert refused(finder, (photo * 0.05).astype(np.uint8)) in ("FACE-DARK", "FACE-NONE")
