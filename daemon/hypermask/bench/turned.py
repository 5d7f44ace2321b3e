"""Turned photographs, rendered from frontal ones: how far the texture is from the frontal one's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import mean

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.texture import regions
from hypermask.texture.build import Image, make_texture, plain_texture
from hypermask.texture.landmarks import FaceFinder, Landmarks
from hypermask.texture.morphable import MorphableModel
from hypermask.texture.photo import load_photo
from hypermask.texture.turned_head import head

TURNS = ((0, 0), (10, 0), (20, 0), (30, 0), (-30, 0), (0, 15), (0, -15))
"""(yaw, pitch) in degrees."""
_INSIDE_MM = 10.0
Row = tuple[str | float | int | None, ...]
Errors = dict[str, float]


def turned_errors(
    photo: Path, finder: FaceFinder, model: MorphableModel | None = None
) -> dict[tuple[int, int], Errors | None]:
    """For each turn the mean difference (0 to 255) of the texture to the frontal photograph's, over
    the face: with `turning`, and plainly by each `fit`; None where no character came of it.

    model: one that has not seen this face. Raises `DataError` for the frontal photograph.
    """
    image = load_photo(photo)
    face = finder.find(image)
    wanted, _ = make_texture(image, face, model=model)
    solid = head(image, face.points, face.pupils)
    found: dict[tuple[int, int], Errors | None] = {}
    for turn in TURNS:
        seen = solid.turned(*turn)
        try:
            found[turn] = _errors(seen, finder.find(seen), wanted, model)
        except DataError:
            found[turn] = None
    return found


def _errors(
    seen: Image, face: Landmarks, wanted: Image, model: MorphableModel | None
) -> dict[str, float]:
    return {
        "84 landmarks, Hardy, not turned": difference(
            plain_texture(seen, face, "hardy", model), wanted
        ),
        "468 landmarks, not turned": difference(
            plain_texture(seen, face, "landmarks", model), wanted
        ),
        "turned to the front": difference(make_texture(seen, face, model=model)[0], wanted),
    }


def difference(texture: Image, wanted: Image) -> float:
    """Mean absolute difference over the face (h, w, 3), 0 to 255."""
    inside: NDArray[np.bool_] = regions.depth_mm() > _INSIDE_MM
    return float(np.abs(texture[inside].astype(int) - wanted[inside]).mean())


def turned_rows(
    photos: Sequence[Path], models: Callable[[Path], MorphableModel], done: Callable[[], None]
) -> list[Row]:
    """Rows of the table: each turn, each way, its mean error, and how many were built."""
    finder = FaceFinder()
    results = []
    for photo in photos:
        results.append(turned_errors(photo, finder, models(photo)))
        done()
    rows: list[Row] = []
    for turn in TURNS:
        built = [errors for result in results if (errors := result[turn]) is not None]
        name = f"yaw {turn[0]}, pitch {turn[1]} deg, {len(built)} of {len(results)} built"
        for way in built[0] if built else ():
            rows.append(("turned head", name, way, None, mean(e[way] for e in built), None, None))
    return rows
