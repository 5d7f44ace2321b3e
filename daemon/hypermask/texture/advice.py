"""What a better photograph would have, in words. The limits lie outside 130 studio photographs."""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.texture import regions
from hypermask.texture.fill import skin_colour
from hypermask.texture.landmarks import Landmarks
from hypermask.texture.normalise import normalise
from hypermask.texture.pose import head_pose

Image = NDArray[np.uint8]

_SMALL_PX = 100.0
_SHARP = 0.32
_TURNED_DEG = 15.0
_OPEN = 0.20
_DARK = 60.0
_WHITE, _BURNT = 254, 0.25
_FACE_MM = 12.0
_HIDDEN = 0.17
_LIPS = (13, 14)
_MOUTH_CORNERS = (61, 291)


def advice(
    image: Image, face: Landmarks, hidden: float = 0.0, flat: Image | None = None
) -> tuple[str, ...]:
    """One sentence for each thing that keeps the photograph (h, w, 3) BGR from being a good one.

    hidden: share of the face before which something else is seen; flat: the photograph in the
    texture's layout, where it is at hand.
    """
    texture = normalise(image, face.points[:, :2], face.eye_distance) if flat is None else flat
    found = (
        (
            face.eye_distance < _SMALL_PX,
            f"The face is small: {face.eye_distance:.0f} pixels between the pupils; "
            f"{_SMALL_PX:.0f} or more show the skin better.",
        ),
        (sharpness(texture) < _SHARP, "The photograph is blurred: hold the camera still, focus."),
        (
            abs(yaw_deg(face)) > _TURNED_DEG,
            f"The head is turned by {abs(yaw_deg(face)):.0f} degrees: look into the camera.",
        ),
        (mouth_opening(face) > _OPEN, "The mouth is open: close it, teeth are not wanted."),
        (float(skin_colour(texture)[0]) < _DARK, "The face is dark: add light from the front."),
        (
            burnt(texture) > _BURNT,
            "The face is too bright: its lightest parts are plain white; use less light.",
        ),
        (
            hidden > _HIDDEN,
            f"Part of the face is hidden ({hidden:.0%}): take off glasses, move hair and hands "
            "aside; what is not seen is estimated.",
        ),
    )
    return tuple(sentence for applies, sentence in found if applies)


def yaw_deg(face: Landmarks) -> float:
    """Degrees that the head is turned, above 0 to the picture's right."""
    return head_pose(face.points).yaw_deg


def mouth_opening(face: Landmarks) -> float:
    """Gap between the lips in widths of the mouth."""
    upper, lower = face.points[list(_LIPS), :2]
    left, right = face.points[list(_MOUTH_CORNERS), :2]
    return float(np.hypot(*(lower - upper)) / np.hypot(*(right - left)))


def burnt(texture: Image) -> float:
    """Share of the face in which a colour has reached the top of its scale."""
    blue, green, red = cv2.split(texture[::2, ::2])
    brightest = np.maximum(np.maximum(blue, green), red)[_face()[::2, ::2]]
    return float((brightest >= _WHITE).mean())


@functools.cache
def _face() -> NDArray[np.bool_]:
    return regions.depth_mm() > _FACE_MM


def sharpness(texture: Image) -> float:
    """Contrast of fine detail over that of coarser, at eyes, brows, nose and lips."""
    grey = cv2.cvtColor(texture, cv2.COLOR_BGR2GRAY).astype(np.float32)
    fine = cv2.GaussianBlur(grey, (0, 0), 2)
    size = (grey.shape[1], grey.shape[0])
    less = cv2.resize(fine, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    coarse = cv2.resize(cv2.GaussianBlur(less, (0, 0), 1.9), size, interpolation=cv2.INTER_LINEAR)
    where = _features()
    return float((grey - fine)[where].std() / max(float((fine - coarse)[where].std()), 1e-3))


@functools.cache
def _features() -> NDArray[np.bool_]:
    whole = (regions.features() > 0.5).astype(np.uint8)
    return np.asarray(cv2.erode(whole, np.ones((5, 5), np.uint8)) > 0)
