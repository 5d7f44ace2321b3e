"""A photograph becomes a character (PAPERS B): landmarks, fit, normalised texture, blend."""

from __future__ import annotations

import datetime
import functools
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.errors import DataError
from hypermask.face import points
from hypermask.face.character import (
    Character,
    check_name,
    load_character,
    save_character,
)
from hypermask.texture import regions
from hypermask.texture.eyes import eye_textures
from hypermask.texture.fill import balance, belief, fill
from hypermask.texture.landmarks import FaceFinder, Landmarks
from hypermask.texture.normalise import normalise
from hypermask.texture.photo import load_photo

Image = NDArray[np.uint8]

MEAN = "mean"
"""The built-in character that stands in where a photograph shows no skin."""
_LEAST_BELIEF = 0.35
_LIP_LINE = 0.55


@functools.cache
def _finder(folder: Path) -> FaceFinder:
    return FaceFinder(folder)


def build_character(
    photo: Path, name: str, out: Path | None = None, date: datetime.date | None = None
) -> Character:
    """Make and save the character `name` in the folder `out`/`name` (default: the user's own).

    Raises `UsageError` CHAR-NAME; `DataError` PHOTO-ABSENT, PHOTO-FORMAT, PHOTO-SIZE, FACE-NONE,
    FACE-MANY, FACE-SMALL, FACE-HIDDEN, FACE-MODELS; `HypermaskError` DISK-WRITE.
    """
    check_name(name)
    image = load_photo(photo)
    face = _finder(paths.models()).find(image)
    texture, eyes = make_texture(image, face)
    made = (date or datetime.date.today()).isoformat()
    character = Character(name, photo.name, made, texture, eyes, face.points)
    save_character(character, (out or paths.home() / "characters") / name)
    return character


def make_texture(image: Image, face: Landmarks) -> tuple[Image, Image]:
    """(texture, eyes), both RGB, from a photograph (h, w, 3) BGR and its landmarks."""
    mean = mean_texture()
    flat = normalise(image, face.points[:, :2], face.eye_distance)
    eyes = eye_textures(flat)
    weight = belief(flat)
    if float(weight.max()) < _LEAST_BELIEF:
        raise DataError(
            "FACE-HIDDEN", "too little skin is seen in the photograph", "Use another photograph."
        )
    whole = balance(fill(_lip_line(flat), weight, mean), mean)
    return _rgb(whole), _rgb(eyes)


def _lip_line(texture: Image) -> Image:
    """Dark where the lips meet: a photograph with an open mouth has teeth there."""
    gap = regions.grow(regions.polygon(points.LIPS_INNER), 0.8)
    lips = texture[(regions.polygon(points.LIPS_OUTER) > 0) & (gap == 0)]
    colour = np.median(lips, axis=0) * _LIP_LINE
    share = regions.soften(gap, 0.4)[..., None]
    return np.asarray(texture * (1 - share) + colour * share, np.uint8)


@functools.cache
def mean_texture() -> Image:
    """(SIZE, SIZE, 3) BGR of the built-in mean face."""
    return _rgb(load_character(paths.configs() / "characters" / MEAN).texture)


def _rgb(image: Image) -> Image:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
