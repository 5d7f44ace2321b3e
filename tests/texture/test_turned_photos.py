"""A turned head is turned to the front: near what the frontal photograph gives."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask import paths
from hypermask.bench.turned import turned_errors
from hypermask.errors import DataError
from hypermask.face.mesh import LANDMARKS, load_mesh
from hypermask.texture import regions
from hypermask.texture.advice import advice
from hypermask.texture.landmarks import FaceFinder
from hypermask.texture.models import MODELS
from hypermask.texture.morphable import SIDE, load_model
from hypermask.texture.photo import load_photo
from hypermask.texture.pose import HeadPose, head_pose, mean_head
from hypermask.texture.register import moved, shift
from hypermask.texture.turned_head import Head, head
from hypermask.texture.viewing import behind

FACES = Path(__file__).parents[2].parent / "shared" / "data" / "faces"
PHOTOS = sorted(FACES.glob("*.jpg"))
needs_photos = pytest.mark.skipif(
    not PHOTOS or not all((paths.models() / model.file).is_file() for model in MODELS),
    reason="../shared/data/faces or the face models are absent",
)


@pytest.fixture(scope="module")
def finder() -> FaceFinder:
    return FaceFinder()


def _rotation(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """The line of sight of the nose by yaw and pitch, then about it; degrees, y down."""
    ys, xs, zs = (np.radians(angle) for angle in (-yaw, -pitch, roll))
    about_y = [[np.cos(ys), 0, np.sin(ys)], [0, 1, 0], [-np.sin(ys), 0, np.cos(ys)]]
    about_x = [[1, 0, 0], [0, np.cos(xs), -np.sin(xs)], [0, np.sin(xs), np.cos(xs)]]
    about_z = [[np.cos(zs), -np.sin(zs), 0], [np.sin(zs), np.cos(zs), 0], [0, 0, 1]]
    return np.array(about_y) @ np.array(about_x) @ np.array(about_z)


@pytest.mark.parametrize("angles", [(0, 0, 0), (25, 0, 0), (-38, 5, 0), (0, -20, 0), (0, 0, 30)])
def test_the_pose_of_a_rigid_head_is_exact(angles: tuple[float, float, float]) -> None:
    turned = 3.2 * mean_head() @ _rotation(*angles).T + (400, 500, 7)
    pose = head_pose(turned)
    measured = pose.yaw_deg, pose.pitch_deg, pose.roll_deg
    np.testing.assert_allclose(measured, angles, atol=0.8)
    np.testing.assert_allclose(pose.frontal(turned), mean_head(), atol=1e-6)
    assert pose.scale == pytest.approx(3.2)


def test_the_nose_hides_skin_beside_it_and_nothing_is_hidden_from_the_front() -> None:
    head_mm = mean_head()
    turned = head_mm @ _rotation(35, 0, 0).T
    hidden = behind(turned) > 0.02
    beside = (head_mm[:, 0] > 0) & (np.abs(head_mm[:, 1] - 35) < 25)
    assert hidden[beside].sum() >= 5
    assert not hidden[head_mm[:, 0] < -25].any()
    assert (behind(head_mm) > 0.02).sum() <= 3


def test_a_texture_that_slipped_is_put_back() -> None:
    model = load_model()
    wanted = model.texture(np.sqrt(model.variances[:6]))
    slip = np.zeros((SIDE, SIDE, 2), np.float32)
    slip[..., 0] = 4
    slipped = moved(wanted, slip)
    full = cv2.resize(np.clip(slipped, 0, 255), (512, 512)).astype(np.uint8)
    weight = np.ones((512, 512), np.float32)
    found = shift(model, full, weight, 30.0)
    assert found is not None and shift(model, full, weight, 5.0) is None
    inner = cv2.resize(regions.features(), (SIDE, SIDE)) > 0.9
    assert np.median(found[inner][:, 0]) == pytest.approx(-4, abs=1.2)
    before, after = np.abs(slipped - wanted)[inner], np.abs(moved(slipped, found) - wanted)[inner]
    assert after.mean() < 0.6 * before.mean()


def _head(photo: Path, finder: FaceFinder) -> Head:
    image = load_photo(photo)
    face = finder.find(image)
    return head(image, face.points, face.pupils)


@needs_photos
def test_turning_brings_the_texture_nearer_to_the_frontal_one(finder: FaceFinder) -> None:
    """Rendered at 20 and 30 degrees on a head the pipeline knows nothing of."""
    results = [turned_errors(photo, finder) for photo in PHOTOS[::22]]
    for turn, gain in (((20, 0), 0.99), ((30, 0), 0.93), ((-30, 0), 0.93)):
        errors = [result[turn] for result in results]
        ways = {way: np.mean([error[way] for error in errors]) for way in errors[0]}
        turned = ways["turned to the front"]
        assert turned < gain * ways["468 landmarks, not turned"]
        assert turned < 0.85 * ways["84 landmarks, Hardy, not turned"]
        assert turned < 8


@needs_photos
def test_the_pose_of_a_rendered_head_is_found(finder: FaceFinder) -> None:
    for photo in PHOTOS[::43]:
        solid = _head(photo, finder)
        front = head_pose(finder.find(solid.turned(0)).points)
        for yaw in (-30, 20):
            pose: HeadPose = head_pose(finder.find(solid.turned(yaw)).points)
            assert pose.yaw_deg - front.yaw_deg == pytest.approx(yaw, abs=7)


@needs_photos
def test_advice_at_thirty_degrees_and_a_refusal_in_profile(finder: FaceFinder) -> None:
    for photo in PHOTOS[::43]:
        solid = _head(photo, finder)
        seen = solid.turned(30)
        assert any("turned" in sentence for sentence in advice(seen, finder.find(seen)))
        with pytest.raises(DataError) as caught:
            finder.find(solid.turned(65))
        assert caught.value.code in ("FACE-TURNED", "FACE-NONE")


def test_the_mean_head_is_symmetric_and_of_human_size() -> None:
    points, mirror = mean_head(), load_mesh().mirror[:LANDMARKS]
    np.testing.assert_allclose(points[mirror] * (-1, 1, 1), points, atol=0.02)
    assert 120 < np.ptp(points[:, 0]) < 160
    assert points[4, 2] < points[[33, 263], 2].min() - 30
