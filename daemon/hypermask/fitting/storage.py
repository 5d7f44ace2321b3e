"""A fit that is kept with its character: `fit.json` beside the photograph in its folder.

version    1
photo      file, sha256, size [width, height] of the photograph that the pixels belong to
mirror     whether the mirror lock was on
moved      level -> handle -> [x, y] pixels by which it was moved (see `fitting.shape`); in the
           level "points" a list of {"at_mm": the vertex's place on the mask, "by_px": [x, y]},
           so that another mesh finds the vertex again
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.face.character import Character, load_character, update_character
from hypermask.face.mesh import load_mesh
from hypermask.fitting.handles import LEVELS, load_levels, point_vertices
from hypermask.fitting.session import Fitting
from hypermask.texture.photo import load_photo

Array = NDArray[np.float64]

VERSION = 1
FILE = "fit.json"
_SAME_MM = 0.5
"""A vertex of another mesh so near is taken for the same."""
_MOST_OUTSIDE = 0.2
_LARGEST_PX = 1e6
_UNREADABLE = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)


@dataclass(frozen=True)
class StoredFit:
    """A session with the folder it belongs to.

    photo: the photograph's file; known: what `fit.json` says of it; kept: the share of the stored
    corrections that could be taken over, below 1 only where the mesh has changed since.
    """

    fitting: Fitting
    folder: Path
    photo: Path
    known: Mapping[str, Any]
    kept: float = 1.0

    def save(self, character: Character | None = None) -> Character:
        """Write the corrections, the texture and, if it is not there yet, the photograph.

        character: the session's, where it was made already. Raises `HypermaskError` DISK-WRITE,
        `DataError` FACE-HIDDEN.
        """
        made = character or self.fitting.character()
        files = {FILE: _encoded(self.fitting, self.known)}
        if self.photo.parent.resolve() != self.folder.resolve():
            files[str(self.known["file"])] = self.photo.read_bytes()
        update_character(made, self.folder, files)
        return made


def open_fit(folder: Path, photo: Path | None = None) -> StoredFit:
    """The fit of a character; the automatic one where nothing was corrected yet.

    photo: the photograph, for a character whose folder does not hold it. Raises `DataError`
    FIT-PHOTO, FIT-READ, CHAR-ABSENT, CHAR-READ, PHOTO-*.
    """
    character = load_character(folder)
    if character.landmarks is None:
        raise DataError(
            "FIT-PHOTO",
            f"the character '{character.name}' was not made from a photograph",
            "Make one with 'hypermask face build PHOTO --name NAME'.",
        )
    source = _photo_file(folder, photo)
    image = load_photo(source)
    _check_landmarks(character.landmarks, image.shape[1], image.shape[0], source)
    name = source.name if source.parent == folder else f"photo{source.suffix.lower()}"
    known = {
        "file": name,
        "sha256": hashlib.sha256(source.read_bytes()).hexdigest(),
        "size": [image.shape[1], image.shape[0]],
    }
    fitting = Fitting(image, character.landmarks, character)
    stored = folder / FILE
    kept = _take_over(fitting, stored, known) if stored.is_file() else 1.0
    return StoredFit(fitting, folder, source, known, kept)


def _photo_file(folder: Path, photo: Path | None) -> Path:
    if photo is not None:
        return photo
    found = sorted(file for file in folder.glob("photo.*") if file.suffix not in ("", ".json"))
    if not found:
        raise DataError(
            "FIT-PHOTO",
            f"the folder {folder} does not hold the character's photograph",
            "Give the photograph that it was made from with --photo, or build it again.",
        )
    return found[0]


def _check_landmarks(landmarks: Array, width: int, height: int, photo: Path) -> None:
    x, y = landmarks[:, 0], landmarks[:, 1]
    outside = (x < 0) | (y < 0) | (x > width - 1) | (y > height - 1)
    if outside.mean() > _MOST_OUTSIDE:
        raise _other_photo(photo, f"the face would lie outside its {width} x {height} pixels")


def _take_over(fitting: Fitting, stored: Path, known: Mapping[str, Any]) -> float:
    try:
        data = json.loads(stored.read_text("utf-8"))
        if data["version"] != VERSION:
            raise ValueError(f"its version is {data['version']}, known is {VERSION}")
        digest, mirror = str(data["photo"]["sha256"]), data["mirror"]
        moved = _decoded(data["moved"])
        if not isinstance(mirror, bool):
            raise ValueError("mirror is neither true nor false")
    except _UNREADABLE as error:
        raise DataError(
            "FIT-READ",
            f"{stored} cannot be used: {error}",
            "Delete it; the character then has its automatic fit again.",
        ) from error
    if digest != known["sha256"]:
        raise _other_photo(stored.parent / str(known["file"]), f"{stored} was made for another one")
    fitting.mirror = mirror
    return fitting.restore(moved)


def _encoded(fitting: Fitting, known: Mapping[str, Any]) -> bytes:
    levels, moved = load_levels(), fitting.moved
    fields: dict[str, Any] = {"version": VERSION, "photo": dict(known), "mirror": fitting.mirror}
    kept: dict[str, Any] = {}
    for name in LEVELS[:-1]:
        values = moved[name]
        rows = np.flatnonzero(values.any(axis=1))
        kept[name] = {levels[name].handles[row]: values[row].tolist() for row in rows}
    places = load_mesh().rest[point_vertices()] * 1000
    values = moved["points"]
    kept["points"] = [
        {"at_mm": np.round(places[row], 3).tolist(), "by_px": values[row].tolist()}
        for row in np.flatnonzero(values.any(axis=1))
    ]
    fields["moved"] = kept
    return (json.dumps(fields, indent=1, allow_nan=False) + "\n").encode()


def _decoded(data: Any) -> dict[str, Array]:
    """Level -> (H, 2). Raises ValueError, KeyError, TypeError."""
    levels = load_levels()
    moved = {name: np.zeros((len(levels[name].handles), 2)) for name in LEVELS}
    for name in LEVELS[:-1]:
        for handle, value in dict(data[name]).items():
            moved[name][levels[name].index[handle]] = _pair(value)
    places = load_mesh().rest[point_vertices()] * 1000
    for entry in data["points"]:
        at, by = _pair(entry["at_mm"]), _pair(entry["by_px"])
        gaps = np.linalg.norm(places - at, axis=1)
        row = int(gaps.argmin())
        if gaps[row] < _SAME_MM:
            moved["points"][row] = by
    return moved


def _pair(value: Any) -> Array:
    pair = np.array(value, float)
    if pair.shape != (2,) or not np.isfinite(pair).all() or np.abs(pair).max() > _LARGEST_PX:
        raise ValueError(f"{value!r} are not two numbers")
    return pair


def _other_photo(photo: Path, why: str) -> DataError:
    return DataError(
        "FIT-PHOTO",
        f"{photo} is not the photograph that the fit belongs to: {why}",
        "Give the right photograph, or build the character again.",
    )
