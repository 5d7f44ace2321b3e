"""A face for the fitting tests that needs no model and no photograph of anybody."""

from __future__ import annotations

import functools
from pathlib import Path

import cv2
import numpy as np

from hypermask import paths
from hypermask.face.character import Character, load_character, save_character
from hypermask.face.mesh import HALF_HEIGHT_M, HALF_WIDTH_M, LANDMARKS, load_mesh
from hypermask.fitting.session import Fitting

SIZE = (760, 900)
CENTRE = (380.0, 440.0)
PIXELS_PER_M = 2900.0
ROLL = np.radians(12.0)


def to_photo(places: np.ndarray, roll: float = ROLL) -> np.ndarray:
    """(n, 2) pixels of places on the mask (n, 2) in metres: scaled, rolled, y down."""
    turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    return (places * (1, -1) * PIXELS_PER_M) @ turn.T + CENTRE


@functools.cache
def photo(roll: float = ROLL) -> np.ndarray:
    """(h, w, 3) BGR: the mean face's texture, rolled, with a pattern finer than skin has."""
    texture = load_character(paths.configs() / "characters" / "mean").texture[..., ::-1].copy()
    side = texture.shape[0]
    corners = np.array([(0, 0), (side, 0), (0, side)], np.float32)
    half = np.array((HALF_WIDTH_M, HALF_HEIGHT_M))
    on_mask = (corners / side * 2 - 1) * half * (1, -1)
    warp = cv2.getAffineTransform(corners - 0.5, to_photo(on_mask, roll).astype(np.float32))
    picture = cv2.warpAffine(texture, warp, SIZE, borderMode=cv2.BORDER_REPLICATE)
    noise = np.random.default_rng(5).normal(0, 4, (SIZE[1], SIZE[0], 1))
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def landmarks(roll: float = ROLL) -> np.ndarray:
    """(468, 3) pixels, not quite symmetric, as landmarks are."""
    rest = load_mesh().rest[:LANDMARKS]
    wobble = np.random.default_rng(3).normal(0, 0.15, rest.shape)
    return np.column_stack([to_photo(rest, roll) + wobble, np.zeros(LANDMARKS)])


def fitting(roll: float = ROLL) -> Fitting:
    return Fitting(photo(roll), landmarks(roll))


def saved(folder: Path, with_photo: bool = True) -> Path:
    """A character on disk made of this face; gives its folder."""
    texture, eyes = fitting().texture()
    save_character(Character("face", "photo.png", "2000-01-01", texture, eyes, landmarks()), folder)
    if with_photo:
        cv2.imwrite(str(folder / "photo.png"), photo())
    return folder
