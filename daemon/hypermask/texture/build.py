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
from hypermask.face.character import (
    Character,
    check_name,
    load_character,
    save_character,
)
from hypermask.texture.eyes import eye_textures
from hypermask.texture.fill import balance, belief, fill
from hypermask.texture.landmarks import FaceFinder, Landmarks
from hypermask.texture.normalise import normalise
from hypermask.texture.photo import load_photo

Image = NDArray[np.uint8]

MEAN = "mean"
"""The built-in character that stands in where a photograph shows no skin."""
_LEAST_BELIEF = 0.35


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
    whole = balance(fill(flat, weight, mean), mean)
    return _rgb(whole), _rgb(eyes)


@functools.cache
def mean_texture() -> Image:
    """(SIZE, SIZE, 3) BGR of the built-in mean face."""
    return _rgb(load_character(paths.configs() / "characters" / MEAN).texture)


def _rgb(image: Image) -> Image:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
