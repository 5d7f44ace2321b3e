"""One photograph becomes a character; a bad one gives a clear code."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask import paths
from hypermask.errors import DataError, HypermaskError, UsageError
from hypermask.face import points
from hypermask.face.character import load_character
from hypermask.face.mesh import load_mesh
from hypermask.texture import regions
from hypermask.texture.build import build_character, make_texture, mean_texture
from hypermask.texture.fill import belief, diffuse, skin_colour
from hypermask.texture.landmarks import FaceFinder
from hypermask.texture.models import MODELS
from hypermask.texture.normalise import FINE_SIZE, SIZE, normalise
from hypermask.texture.photo import load_photo

FACES = Path(__file__).parents[2].parent / "shared" / "data" / "faces"
NAMES = (
    "canada_003f",
    "canada_054f",
    "london_005_03",
    "london_001_03",
    "london_090_03",
    "london_140_03",
)
PHOTOS = [FACES / f"{name}.jpg" for name in NAMES if (FACES / f"{name}.jpg").is_file()]

needs_models = pytest.mark.skipif(
    not all((paths.models() / model.file).is_file() for model in MODELS),
    reason="the face models are absent: run 'make models'",
)
needs_photos = pytest.mark.skipif(len(PHOTOS) < 2, reason="../shared/data/faces is absent")


@pytest.fixture(scope="module")
def finder() -> FaceFinder:
    return FaceFinder()


def _template(photo: Path) -> np.ndarray:
    return np.loadtxt(photo.with_suffix(".pts.csv"), delimiter=",", skiprows=1)


def _code(call, *arguments) -> str:
    with pytest.raises(HypermaskError) as caught:
        call(*arguments)
    return caught.value.code


@needs_models
@needs_photos
@pytest.mark.parametrize("photo", PHOTOS, ids=lambda path: path.stem)
def test_pupils_are_where_a_person_placed_them(finder: FaceFinder, photo: Path) -> None:
    face = finder.find(load_photo(photo))
    wanted = _template(photo)[:2]
    error = np.linalg.norm(face.pupils - wanted, axis=1) / np.linalg.norm(wanted[1] - wanted[0])
    assert face.score > 0.9
    assert error.max() < 0.025


@needs_models
@needs_photos
def test_a_tilted_small_and_a_close_face_are_found_alike(finder: FaceFinder) -> None:
    image = load_photo(PHOTOS[0])
    reference = finder.find(image)
    height, width = image.shape[:2]
    for angle, scale in ((25, 0.6), (-40, 1.0), (0, 0.25)):
        turn = cv2.getRotationMatrix2D((width / 2, height / 2), angle, scale)
        moved = finder.find(cv2.warpAffine(image, turn, (width, height)))
        expected = reference.points[:, :2] @ turn[:, :2].T + turn[:, 2]
        error = np.linalg.norm(moved.points[:, :2] - expected, axis=1)
        assert np.median(error) < 0.04 * moved.eye_distance
    x, y = reference.points[:, :2].mean(axis=0).astype(int)
    reach = int(1.3 * reference.eye_distance)
    assert finder.find(image[y - reach : y + reach, x - reach : x + reach]).score > 0.9


@needs_models
@needs_photos
@pytest.mark.parametrize("photo", PHOTOS, ids=lambda path: path.stem)
def test_a_photograph_becomes_a_character(photo: Path, tmp_path: Path) -> None:
    made = build_character(photo, "someone", tmp_path)
    read = load_character(tmp_path / "someone")
    assert read.name == "someone" and read.source == photo.name
    assert read.texture.shape == (SIZE, SIZE, 3)
    np.testing.assert_array_equal(read.texture, made.texture)
    assert read.landmarks is not None and read.landmarks.shape == (468, 3)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["someone"]


@needs_models
@needs_photos
@pytest.mark.parametrize("photo", PHOTOS, ids=lambda path: path.stem)
def test_no_background_and_no_hair_reach_the_rim(photo: Path, tmp_path: Path) -> None:
    """Towards the rim the texture is a shade of the person's own cheeks."""
    texture = np.ascontiguousarray(build_character(photo, "x", tmp_path).texture[..., ::-1])
    lab = cv2.cvtColor(texture, cv2.COLOR_BGR2LAB).astype(float)
    outside = lab[regions.depth_mm() < -4]
    skin = skin_colour(texture)
    assert np.abs(np.median(outside[:, 1:], axis=0) - skin[1:]).max() < 14
    assert np.percentile(np.abs(outside[:, 1:] - skin[1:]), 99) < 22
    assert outside[:, 0].max() < skin[0] + 30


@needs_models
@needs_photos
def test_features_land_on_their_places_on_the_mask(finder: FaceFinder) -> None:
    """The darkest part of each eye lies at the mask's eye holes, for every face."""
    x, y = regions.grid_mm()
    for photo in PHOTOS:
        image = load_photo(photo)
        face = finder.find(image)
        grey = cv2.cvtColor(
            normalise(image, face.points[:, :2], face.eye_distance), cv2.COLOR_BGR2GRAY
        ).astype(float)
        for side in (-31, 31):
            near = np.hypot(x - side, y - 25) < 4
            beside = (np.abs(y - 25) < 2.5) & (np.abs(np.abs(x - side) - 9) < 1.5)
            assert grey[near].mean() < grey[beside].mean()


@needs_models
def test_bad_photographs_each_have_their_code(tmp_path: Path) -> None:
    empty = tmp_path / "empty.png"
    noise = np.random.default_rng(2).integers(0, 255, (400, 400, 3), np.uint8)
    cv2.imwrite(str(empty), noise)
    assert _code(build_character, empty, "a", tmp_path) == "FACE-NONE"
    assert _code(build_character, tmp_path / "no.jpg", "a", tmp_path) == "PHOTO-ABSENT"
    assert _code(build_character, empty, "../a", tmp_path) == "CHAR-NAME"
    assert [path.name for path in tmp_path.iterdir()] == ["empty.png"]


@needs_models
@needs_photos
def test_two_faces_and_a_tiny_face_are_refused(finder: FaceFinder) -> None:
    first, second = (cv2.resize(load_photo(photo), (500, 600)) for photo in PHOTOS[:2])
    assert _code(finder.find, np.hstack([first, second])) == "FACE-MANY"
    smaller = np.full_like(second, 200)
    smaller[100:400, 100:350] = cv2.resize(second, (250, 300))
    assert _code(finder.find, np.hstack([first, smaller])) == "FACE-MANY"
    tiny = np.full((400, 400, 3), 200, np.uint8)
    tiny[150:250, 160:240] = cv2.resize(first, (80, 100))
    assert _code(finder.find, tiny) == "FACE-SMALL"


@needs_models
@needs_photos
def test_hair_over_the_forehead_is_not_believed(finder: FaceFinder) -> None:
    image = load_photo(PHOTOS[-1])
    face = finder.find(image)
    texture = normalise(image, face.points[:, :2], face.eye_distance)
    covered = texture.copy()
    x, y = regions.grid_mm()
    fringe = (y > 64) & (np.abs(x) < 40)
    covered[fringe] = (20, 200, 60)
    assert belief(covered)[fringe & (regions.depth_mm() > 8)].max() < 0.2
    assert belief(covered)[(np.abs(x) < 20) & (np.abs(y) < 20)].min() > 0.9


def _glasses(image: np.ndarray, eyes: np.ndarray, filled: bool) -> np.ndarray:
    worn, unit = image.copy(), float(np.hypot(*(eyes[1] - eyes[0])))
    for eye in eyes:
        place = (round(eye[0]), round(eye[1] + 0.06 * unit))
        size = (round(0.38 * unit), round(0.28 * unit))
        cv2.ellipse(worn, place, size, 0, 0, 360, (22, 20, 20), -1 if filled else round(unit / 20))
    return worn


@needs_models
@needs_photos
@pytest.mark.parametrize("filled", [False, True], ids=["glasses", "sunglasses"])
def test_glasses_do_not_reach_the_texture(finder: FaceFinder, filled: bool) -> None:
    """Below the eyes, where the rims are, the skin stays near what it is without glasses."""
    for photo in PHOTOS[:3]:
        image = load_photo(photo)
        bare, _ = make_texture(image, finder.find(image))
        face = finder.find(image)
        worn, _ = make_texture(_glasses(image, face.pupils, filled), face)
        x, y = regions.grid_mm()
        rim = regions.depth_mm() < -5
        rims = (np.abs(np.abs(x) - 31) < 8) & (y > 2) & (y < 14)
        assert np.abs(worn[rims].astype(int) - bare[rims]).mean() < 20
        assert np.abs(worn[rim].astype(int) - bare[rim]).mean() < 8


@needs_models
@needs_photos
def test_a_microphone_before_the_mouth_is_not_smeared_to_the_rim(finder: FaceFinder) -> None:
    image = load_photo(PHOTOS[0])
    face = finder.find(image)
    bare, _ = make_texture(image, face)
    unit = face.eye_distance
    mouth = face.points[17, :2] + (0.2 * unit, 0.1 * unit)
    held = image.copy()
    end = mouth + unit * np.array([0.8, 1.2])
    places = [tuple(int(v) for v in place) for place in (mouth, end)]
    cv2.circle(held, places[0], round(0.3 * unit), (40, 40, 40), -1)
    cv2.line(held, *places, (30, 30, 30), round(0.2 * unit))
    texture, _ = make_texture(held, face)
    x, y = regions.grid_mm()
    chin = (y < -62) & (y > -125) & (np.abs(x) < 60)
    assert np.abs(texture[chin].astype(int) - bare[chin]).mean() < 10
    assert texture[chin].max(axis=1).min() > 60


@needs_models
@needs_photos
def test_the_fine_texture_is_the_same_face_with_more_detail(finder: FaceFinder) -> None:
    image = load_photo(PHOTOS[0])
    face = finder.find(image)
    usual, eyes = make_texture(image, face)
    fine, fine_eyes = make_texture(image, face, FINE_SIZE)
    assert fine.shape == (FINE_SIZE, FINE_SIZE, 3)
    reduced = cv2.resize(fine, (SIZE, SIZE), interpolation=cv2.INTER_AREA).astype(int)
    assert np.abs(reduced - usual).mean() < 1.5
    assert np.abs(fine_eyes.astype(int) - eyes).mean() < 3
    inside = cv2.resize(regions.depth_mm(), (FINE_SIZE, FINE_SIZE)) > 15
    again = cv2.resize(usual, (FINE_SIZE, FINE_SIZE))
    details = [cv2.Laplacian(t, cv2.CV_32F)[inside].std() for t in (fine, again)]
    assert details[0] > 1.1 * details[1]


@needs_models
@needs_photos
def test_the_papers_fit_gives_nearly_the_same_texture(finder: FaceFinder) -> None:
    image = load_photo(PHOTOS[0])
    face = finder.find(image)
    usual = normalise(image, face.points[:, :2], face.eye_distance).astype(int)
    paper = normalise(image, face.points[:, :2], face.eye_distance, fit="hardy")
    assert 0 < np.abs(paper - usual)[regions.depth_mm() > 10].mean() < 6


@needs_models
@needs_photos
def test_an_open_mouth_leaves_no_teeth_on_the_lips(finder: FaceFinder) -> None:
    image = load_photo(PHOTOS[0])
    face = finder.find(image)
    inner = face.points[list(points.LIPS_INNER), :2]
    painted = image.copy()
    cv2.polylines(painted, [np.round(inner).astype(np.int32)], True, (255, 255, 255), 5)
    texture, _ = make_texture(painted, face)
    line = regions.grow(regions.polygon(points.LIPS_INNER), 0.3) > 0
    assert texture[line].max() < 190


def test_a_smooth_field_is_carried_outwards() -> None:
    weight = np.zeros((64, 64), np.float32)
    weight[20:44, 20:44] = 1
    values = np.full((64, 64, 3), 7.0, np.float32) * weight[..., None]
    np.testing.assert_allclose(diffuse(values, weight), 7.0, atol=0.05)


def test_the_layout_keeps_what_is_already_in_it() -> None:
    """The mesh's own rest places as landmarks: the texture comes back unchanged."""
    mean = mean_texture()
    places = load_mesh().uv[:468].astype(float) * SIZE - 0.5
    again = normalise(mean, places, 100.0)
    inside = regions.depth_mm() > 2
    assert np.abs(again.astype(int) - mean)[inside].mean() < 1.0


def test_a_character_needs_a_proper_name() -> None:
    with pytest.raises(UsageError):
        build_character(Path("x.jpg"), "a/b")
    with pytest.raises(DataError):
        build_character(Path("x.jpg"), "a")


@needs_models
def test_the_astronaut_becomes_a_character(tmp_path: Path) -> None:
    """A smiling person before a busy background: no studio photograph."""
    pictures = pytest.importorskip("skimage.data")
    photo = tmp_path / "astronaut.png"
    cv2.imwrite(str(photo), np.ascontiguousarray(pictures.astronaut()[..., ::-1]))
    told: list[str] = []
    made = build_character(photo, "astronaut", tmp_path / "out", tell=told.append)
    assert made.texture.shape == (SIZE, SIZE, 3)
    assert any("small" in sentence for sentence in told)
