"""Whether a face can become a character: upright, to the front, in the picture, lit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.geometry import Array
from hypermask.texture.pose import MOST_DEG, head_pose

Image = NDArray[np.uint8]

# Wrong by less than this, the landmark model has no doubt (faces upright: 1e-9 and below).
_SURE = 1e-8
# An upright face is right by decades more than the same upside down (1e-9 against 1e-3).
_CLEARER = 1e-3
_MOST_OUTSIDE = 0.15
_DARKEST = 20.0  # median grey level of a face that can still be brightened
_NEEDED = (33, 133, 362, 263, 61, 291, 0, 17, 1)  # corners of eyes and mouth, lips, nose


def check_upright(image: Image, score: float, best_score: Callable[[Image], float]) -> None:
    """Raises `DataError` FACE-TURNED where the photograph shows a face better upside down.

    best_score: of the faces in a picture, 0 without any.
    """
    if 1 - score <= _SURE:
        return
    turned = np.ascontiguousarray(image[::-1, ::-1])
    if 1 - best_score(turned) < _CLEARER * (1 - score):
        raise DataError(
            "FACE-TURNED", "the photograph is upside down", "Turn it and save it again."
        )


def check_front(points: Array) -> None:
    """points: (468, 3). Raises `DataError` FACE-TURNED where half of the face is not seen."""
    pose = head_pose(points)
    turns = {"sideways": pose.yaw_deg, "up": pose.pitch_deg, "down": -pose.pitch_deg}
    turns["sideways"] = abs(turns["sideways"])
    where, angle = max(turns.items(), key=lambda turn: turn[1])
    if angle > MOST_DEG:
        raise DataError(
            "FACE-TURNED",
            f"the head is turned {where} by {angle:.0f} degrees",
            "Use a photograph in which the person looks into the camera, within 30 degrees.",
        )


def check_whole(points: Array, size: tuple[int, int]) -> None:
    """points: (468, 2 or more) px; size: (width, height). Raises `DataError` FACE-CUT."""
    xy = points[:, :2]
    beyond: NDArray[np.bool_] = (xy < 0) | (xy > np.array(size) - 1)
    outside: NDArray[np.bool_] = np.asarray(beyond.any(axis=1))
    if outside[list(_NEEDED)].any() or outside.mean() > _MOST_OUTSIDE:
        raise DataError(
            "FACE-CUT",
            "the face is cut by the photograph's edge",
            "Use a photograph that shows the whole face.",
        )


def check_lit(image: Image, points: Array) -> None:
    """Raises `DataError` FACE-DARK where hardly any light is on the face (h, w, 3 BGR)."""
    grey: Any = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    height, width = grey.shape
    x = np.clip(points[:, 0].astype(int), 0, width - 1)
    y = np.clip(points[:, 1].astype(int), 0, height - 1)
    if float(np.median(grey[y, x])) < _DARKEST:
        raise DataError(
            "FACE-DARK", "the face is too dark", "Use a photograph in brighter, even light."
        )
