"""The sheet of a character as projected on to the mask moves and turns as its poses say."""

from __future__ import annotations

import numpy as np

from hypermask import paths
from hypermask.face.character import find_character, load_character
from hypermask.face.sheet import Pose
from hypermask.mask import load_mask
from hypermask.rehearsal.face_sheet import projected_sheet

MASK = load_mask(paths.configs() / "masks" / "reference")


def page(*poses: Pose) -> np.ndarray:
    character = load_character(find_character("mean"))
    return projected_sheet(character, MASK, columns=len(poses), poses=poses).astype(int)


def test_the_projected_face_moves_as_the_pose_says() -> None:
    picture = page(Pose("neutral"), Pose("/a/", mouth="a"), Pose("neutral"))
    first, second, third = np.split(picture[:320], 3, axis=1)
    np.testing.assert_array_equal(first, third)
    changed = np.abs(first - second).max(axis=2) > 40
    rows = np.flatnonzero(changed.any(axis=1))
    assert changed.sum() > 200, "an open mouth"
    assert rows.min() > 320 * 0.5, "in the lower half of the face"


def test_a_turned_mask_shows_a_turned_face() -> None:
    picture = page(Pose("ahead"), Pose("left", turn=(-30.0, 0.0)), Pose("right", turn=(30.0, 0.0)))
    ahead, left, right = np.split(picture[:320], 3, axis=1)

    def width(view: np.ndarray) -> int:
        lit = np.flatnonzero((view[..., 1] > 60).any(axis=0))
        return int(np.ptp(lit))

    assert width(left) < 0.9 * width(ahead)
    assert width(right) < width(ahead) + 5
