"""Eyes that look around, breath, blinks and a tongue: pure functions of time, each switchable."""

import numpy as np
import pytest

from hypermask import paths
from hypermask.errors import UsageError
from hypermask.face.character import find_character, load_character
from hypermask.face.face import Face, deform, load_rig
from hypermask.face.features import FEATURE_POINTS
from hypermask.face.life import LIFE, STILL, Life, breath, gaze
from hypermask.face.mesh import signed_areas
from hypermask.face.sheet import front_view
from hypermask.mask import load_mask
from hypermask.texture.eyes import CENTRES_MM

RIG = load_rig()
TIMES = np.arange(0, 60, 0.01)


@pytest.fixture(scope="module")
def face() -> Face:
    mask = load_mask(paths.configs() / "masks" / "reference")
    return Face(load_character(find_character("mean")), mask)


def _layer(face: Face, positions, name: str) -> np.ndarray:
    names = [layer.name for layer in face.actor.layers]
    return np.asarray(positions[names.index(name)], float)


def _iris(face: Face, look) -> np.ndarray:
    """(2,) mm: the centre of what is dark in the eye on the audience's right, wide open."""
    positions = face.positions(units={"5": 1.0}, gaze=look)
    picture = front_view(face, positions, 4.0, eye_holes=False).mean(axis=2)
    middle = np.array(picture.shape[::-1]) / 2
    x, y = np.meshgrid(*(np.arange(n) for n in picture.shape[::-1]))
    at = np.stack([(x - middle[0]) / 4, (middle[1] - y) / 4], -1) - CENTRES_MM[1]
    near = (np.abs(at[..., 0]) < 10) & (np.abs(at[..., 1]) < 5)
    dark = np.clip(90 - picture, 0, None) * near
    return np.asarray((at * dark[..., None]).sum(axis=(0, 1)) / dark.sum())


def test_the_irises_go_where_the_eyes_look(face: Face) -> None:
    """Seen from outside: what is dark moves with the gaze, by a few millimetres."""
    straight = _iris(face, (0.0, 0.0))
    assert 2 < _iris(face, (0.35, 0.0))[0] - straight[0] < 7
    assert -7 < _iris(face, (-0.35, 0.0))[0] - straight[0] < -2
    assert _iris(face, (0.0, 0.25))[1] > straight[1] + 0.8
    assert _iris(face, (0.0, -0.25))[1] < straight[1] - 0.8


def test_straight_ahead_is_the_eyes_rest(face: Face) -> None:
    for plain, straight in zip(face.positions(), face.positions(gaze=(0, 0)), strict=True):
        np.testing.assert_allclose(plain, straight, atol=1e-7)


def test_eyeballs_stay_whole_and_cover_the_opening(face: Face) -> None:
    eyes = face.actor.layers[0]
    random = np.random.default_rng(2)
    for look in (*random.uniform(-0.6, 0.6, (50, 2)), (0.6, 0.6), (-0.6, -0.6)):
        places = _layer(face, face.positions(gaze=look), "eyes")
        assert (signed_areas(places, eyes.triangles) > 0).all()
        np.testing.assert_allclose(
            places.min(axis=0)[:2], _layer(face, face.positions(), "eyes").min(axis=0)[:2]
        )


def test_upper_lids_follow_the_eyes() -> None:
    lid = FEATURE_POINTS["lid_upper_left"]
    heights = [deform(RIG, gaze=(0, up))[0][lid, 1] for up in (-0.4, -0.2, 0.0, 0.2, 0.4)]
    assert (np.diff(heights) > 0.0003).all()


def test_the_gaze_rests_and_shifts_quickly() -> None:
    path = np.array([gaze(t) for t in TIMES])
    still = (np.abs(np.diff(path, axis=0)).max(axis=1) == 0).mean()
    assert 0.93 < still < 1
    assert np.abs(path).max(axis=0)[0] < 0.17 and np.abs(path).max(axis=0)[1] < 0.07
    assert np.ptp(path[:, 0]) > 0.1
    assert np.abs(np.diff(path, axis=0)).max() < 0.1
    assert (path == 0).all(axis=1).mean() > 0.2


def test_breath_is_slow_and_steady() -> None:
    levels = np.array([breath(t) for t in TIMES])
    assert levels.min() >= 0 and levels.max() <= 1 and np.abs(np.diff(levels)).max() < 0.01
    rises = ((levels[1:] > 0.5) & (levels[:-1] <= 0.5)).sum()
    assert 12 <= rises <= 16


def test_life_is_the_same_at_the_same_time_and_can_be_switched_off(face: Face) -> None:
    for time_s in (0.0, 12.34, 1e5, -3.0):
        for once, again in zip(face.alive(time_s), face.alive(time_s), strict=True):
            np.testing.assert_array_equal(once, again)
    for time_s in TIMES[::371]:
        for dead, plain in zip(face.alive(time_s, life=STILL), face.positions(), strict=True):
            np.testing.assert_array_equal(dead, plain)
    moved = [face.alive(t)[0] for t in TIMES[::100]]
    assert np.ptp(np.array(moved), axis=0).max() > 0.0005
    only = Life(blinks=True, gaze=False, breath=False)
    assert max(only.lids(t) for t in TIMES) > 0.99 and not only.gaze_at(3.3).any()
    assert not only.units(2.0).any() and LIFE.units(1.6).any()


def test_the_tongue_shows_between_parted_lips_only(face: Face) -> None:
    def area(units) -> float:
        places = _layer(face, face.positions(units=units), "tongue")
        tongue = face.actor.layers[-1]
        return float(np.abs(signed_areas(places, tongue.triangles)).sum() * 1e6)

    assert area({}) < 1e-3 and area({"27": 1.0}) < 1e-3
    assert area({"19": 1.0}) > 150 > area({"19": 0.3}) > 1
    left = _layer(face, face.positions(units={"37L": 1.0}), "tongue")[:, 0].mean()
    right = _layer(face, face.positions(units={"37R": 1.0}), "tongue")[:, 0].mean()
    assert left > 0.001 and right < -0.001  # the face's left is on the audience's right


@pytest.mark.parametrize("look", [(0.1,), (0.1, np.nan), (1, 2, 3)])
def test_a_wrong_gaze_is_refused(face: Face, look) -> None:
    with pytest.raises(UsageError, match="FACE-GAZE"):
        face.positions(gaze=look)
