"""The live texture of a session: what was dragged is what changes, and the face can be tried."""

from __future__ import annotations

import numpy as np
import pytest
from fitting_faces import fitting, landmarks, photo

from hypermask import paths
from hypermask.face.mesh import load_mesh
from hypermask.mask import load_mask
from hypermask.texture.build import make_texture
from hypermask.texture.landmarks import Landmarks
from hypermask.texture.normalise import FINE_SIZE, SIZE
from hypermask.texture.pupils import find_pupils


def _near(handle_rest_mm: np.ndarray, millimetres: float) -> np.ndarray:
    """(SIZE, SIZE) texels within a distance of a place on the mask."""
    line = (np.arange(SIZE) + 0.5) / SIZE
    x, y = np.meshgrid((2 * line - 1) * 102, (1 - 2 * line) * 140)
    return np.hypot(x - handle_rest_mm[0], y - handle_rest_mm[1]) < millimetres


def test_untouched_it_is_the_texture_that_the_photograph_gives() -> None:
    points = landmarks()
    face = Landmarks(points, 1.0, find_pupils(photo(), points[:, :2]))
    for made, expected in zip(fitting().texture(), make_texture(photo(), face), strict=True):
        np.testing.assert_array_equal(made, expected)


@pytest.mark.parametrize(
    ("handle", "step"),
    [
        ("features/lip_corner_left", (8, 4)),
        ("features/brow_middle_right", (0, -12)),
        ("parts/nose", (8, 0)),
    ],
)
def test_pixels_change_where_the_mesh_was_dragged(handle: str, step: tuple[float, float]) -> None:
    session = fitting()
    before, first = session.texture()[0].astype(float), session.vertices()
    x, y = session.handles(handle.split("/")[0])[handle]
    session.drag(handle, x + step[0], y + step[1])
    change = np.abs(session.texture()[0].astype(float) - before).mean(axis=2)
    moved = np.linalg.norm(session.vertices() - first, axis=1)
    at = load_mesh().rest[moved.argmax()] * 1000
    near, far = _near(at, 15), ~_near(at, 75)
    assert change[near].mean() > 1.5 and np.percentile(change[near], 90) > 3
    assert change[near].mean() > 8 * change[far].mean()
    session.undo()
    np.testing.assert_array_equal(session.texture()[0].astype(float), before)


def test_dragging_a_lip_on_to_skin_takes_its_red_away() -> None:
    """The texel of the lip shows what lies in the photograph where the lip was dragged to."""
    session = fitting()
    lip = _near(load_mesh().rest[session_vertex("lower_lip_bottom")] * 1000 + (0, 4), 3)

    def redness() -> float:
        red, green, blue = session.texture()[0][lip].astype(float).mean(axis=0)
        return red - (green + blue) / 2

    before = redness()
    for name, (x, y) in session.handles("face").items():
        if name == "face/mouth":
            down = np.array([-np.sin(np.radians(12)), np.cos(np.radians(12))])
            session.drag(name, *(np.array([x, y]) + 70 * down))
    assert redness() < before - 5


def session_vertex(name: str) -> int:
    from hypermask.face.features import FEATURE_POINTS

    return FEATURE_POINTS[name]


def test_eyes_follow_as_well() -> None:
    session = fitting()
    before = session.texture()[1].astype(float)
    x, y = session.handles("parts")["parts/eye_left"]
    session.drag("parts/eye_left", x + 10, y)
    after = session.texture()[1].astype(float)
    half = before.shape[1] // 2
    left, right = np.abs(after - before)[:, :half].mean(), np.abs(after - before)[:, half:].mean()
    assert left > 2 and left > 4 * right


def test_the_fine_texture_shows_the_same_face() -> None:
    session = fitting()
    fine, usual = session.texture(FINE_SIZE)[0], session.texture()[0]
    assert fine.shape == (FINE_SIZE, FINE_SIZE, 3)
    halved = fine.reshape(SIZE, 2, SIZE, 2, 3).mean(axis=(1, 3))
    assert np.abs(halved - usual).mean() < 3


def test_any_expression_can_be_tried_with_the_fitted_face() -> None:
    session = fitting()
    x, y = session.handles("parts")["parts/nose"]
    session.drag("parts/nose", x + 10, y)
    face = session.face(load_mask(paths.configs() / "masks" / "reference"))
    skin = next(layer for layer in face.actor.layers if layer.name == "skin")
    np.testing.assert_array_equal(skin.texture[..., :3], session.texture()[0])
    rest, happy = face.positions(), face.positions({"happiness": 1.0})
    assert max(np.abs(a - b).max() for a, b in zip(rest, happy, strict=True)) > 0.003
