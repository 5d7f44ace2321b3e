"""Where a character comes from, kept in its folder: enough to build it again from there alone.

source.json   size; advice; eyes' centres, score, pose of the head; the 84 control points of Hardy's
              fit and where they lie in photo.jpg; the program and the models, by SHA-256
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.errors import DataError
from hypermask.face.character import Character
from hypermask.texture.fit import PAPER_LANDMARKS
from hypermask.texture.landmarks import Landmarks
from hypermask.texture.models import LANDMARKS
from hypermask.texture.morphable import FOLDER
from hypermask.texture.pose import head_pose

Image = NDArray[np.uint8]

MOST_BYTES = 3_000_000
MOST_SIDE = 2048
_QUALITY = 95
_DIGITS = 2


def kept_photo(data: bytes, image: Image, loaded_side: int) -> tuple[bytes, bool]:
    """(a JPEG to keep, whether it is the original file) of a photograph's file and its picture."""
    if data.startswith(b"\xff\xd8") and len(data) <= MOST_BYTES and loaded_side <= MOST_SIDE:
        return data, True
    encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    return encoded.tobytes(), False


def rounded(face: Landmarks) -> Landmarks:
    """As it is written, so that what is built now is what is built again."""
    points, pupils = np.round(face.points, _DIGITS), np.round(face.pupils, _DIGITS)
    return replace(face, points=points, pupils=pupils)


def record(face: Landmarks, size: int, advice: Sequence[str], original: bool) -> dict[str, Any]:
    """What source.json holds; plain data."""
    pose = head_pose(face.points)
    return {
        "texture_size": size,
        "photo_is_original": original,
        "advice": list(advice),
        "score": round(face.score, 6),
        "pupils_px": face.pupils.tolist(),
        "pose_deg": {
            "yaw": round(pose.yaw_deg, 1),
            "pitch": round(pose.pitch_deg, 1),
            "roll": round(pose.roll_deg, 1),
        },
        "fit": {
            "method": "landmarks",
            "hardy_landmarks": list(PAPER_LANDMARKS),
            "hardy_px": face.points[list(PAPER_LANDMARKS), :2].tolist(),
        },
        "made_by": dict(_makers()),
    }


def face_of(character: Character) -> tuple[Landmarks, int]:
    """(landmarks, size of the texture) that a character was made with.

    Raises `DataError` CHAR-SOURCE where it was not made from a photograph or does not say how.
    """
    fields = character.record
    if character.photo is None or character.landmarks is None or fields is None:
        raise _no_source(character, "its folder holds no photograph or no source.json")
    try:
        pupils = np.array(fields["pupils_px"], float).reshape(2, 2)
        size, score = int(fields["texture_size"]), float(fields["score"])
    except (KeyError, TypeError, ValueError) as error:
        raise _no_source(character, f"source.json: {error}") from error
    return Landmarks(character.landmarks, score, pupils), size


def _no_source(character: Character, why: str) -> DataError:
    return DataError(
        "CHAR-SOURCE",
        f"the character '{character.name}' cannot be built again: {why}",
        "Build it from a photograph with 'hypermask face build PHOTO --name NAME'.",
    )


@functools.cache
def _makers() -> Mapping[str, str]:
    try:
        program = importlib.metadata.version("hypermask")
    except importlib.metadata.PackageNotFoundError:
        program = "unknown"
    files = {
        "landmark_model_sha256": paths.models() / LANDMARKS.file,
        "texture_model_sha256": FOLDER / "morphable.webp",
    }
    return {"hypermask": program, **{name: _digest(path) for name, path in files.items()}}


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
