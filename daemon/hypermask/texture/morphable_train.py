"""Makes the texture morphable model from the faces in a folder of photographs.

    python -m hypermask.texture.morphable_train FOLDER [--bases 32]

Every face counts twice, the second time mirrored. Where a photograph shows no skin the texture is
completed, first from the mean face, then twice by the model that was made of the completed faces.
How far an unknown face is from the model is measured on faces left out (5 folds).
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from hypermask.errors import DataError, HypermaskError
from hypermask.face.mesh import LANDMARKS, load_mesh
from hypermask.texture.build import mean_texture
from hypermask.texture.estimate import estimate, small
from hypermask.texture.fill import belief, fill
from hypermask.texture.landmarks import FaceFinder
from hypermask.texture.morphable import (
    FOLDER,
    SIDE,
    MorphableModel,
    principal_components,
    save_model,
)
from hypermask.texture.normalise import normalise
from hypermask.texture.photo import load_photo

Map = NDArray[np.float32]

FOLDS = 5
SHIPPED = 32
_ROUNDS = 2
_LEAST_SPREAD = 6.0


def read_faces(folder: Path, bar: Progress, limit: int | None = None) -> tuple[Map, Map, Map]:
    """(textures, completed (n, SIDE, SIDE, 3), weights (n, SIDE, SIDE)) of a folder's photographs.

    limit: so many of them, evenly chosen. Raises `DataError` FACES-FEW, PHOTO-*, FACE-*.
    """
    photos = sorted(folder.glob("*.jpg"))
    if limit is not None and limit < len(photos):
        photos = [photos[i] for i in np.linspace(0, len(photos) - 1, limit).astype(int)]
    if len(photos) < 2 * FOLDS:
        raise DataError(
            "FACES-FEW",
            f"{folder} holds {len(photos)} photographs (*.jpg)",
            f"Name a folder with at least {2 * FOLDS} photographs of one face each.",
        )
    finder = FaceFinder()
    rows = []
    for photo in bar.track(photos, description="faces"):
        image = load_photo(photo)
        face = finder.find(image)
        texture = normalise(image, face.points[:, :2], face.eye_distance)
        weight = belief(texture)
        rows.append((small(texture), small(fill(texture, weight, mean_texture())), small(weight)))
    textures, completed, weights = (np.array(column) for column in zip(*rows, strict=True))
    return textures, completed, weights


def make_model(completed: Map, count: int) -> MorphableModel:
    """The model of textures (n, SIDE, SIDE, 3), every one also mirrored."""
    both = np.concatenate([completed, completed[:, :, ::-1]])
    mean, bases, variances = principal_components(both, count)
    left = left_over(completed[:64], mean, bases)
    landmarks = load_mesh().rest[:LANDMARKS] * 1000
    spread = np.full((SIDE, SIDE), 1e3, np.float32)
    return MorphableModel(mean, bases, variances, spread, float(np.square(left).mean()), landmarks)


def left_over(textures: Map, mean: Map, bases: Map) -> Map:
    """What the bases leave of textures (n, ...)."""
    flat, axes = (textures - mean).reshape(len(textures), -1), bases.reshape(len(bases), -1)
    return np.asarray((flat - (flat @ axes.T) @ axes).reshape(textures.shape), np.float32)


def folds(count: int, number: int = FOLDS) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """(known, left out) faces of each fold, always the same."""
    order = np.random.default_rng(1).permutation(count)
    return [(np.sort(np.delete(order, np.s_[i::number])), np.sort(order[i::number]))
            for i in range(number)]  # fmt: skip


def complete_again(textures: Map, weights: Map, model: MorphableModel) -> Map:
    """Each texture completed by the model where its weight is low."""
    rows = []
    for texture, weight in zip(textures, weights, strict=True):
        share = weight[..., None]
        rows.append(share * texture + (1 - share) * estimate(model, texture, weight).whole)
    return np.array(rows)


def train(textures: Map, completed: Map, weights: Map, count: int, bar: Progress) -> MorphableModel:
    for _ in bar.track(range(_ROUNDS), description="completing"):
        completed = complete_again(textures, weights, make_model(completed, count))
    squares, seen = np.zeros((SIDE, SIDE)), np.zeros((SIDE, SIDE))
    for known, unknown in bar.track(folds(len(textures)), description="left out"):
        model = make_model(completed[known], min(count, 2 * len(known) - 1))
        for face in unknown:
            found = estimate(model, textures[face], weights[face])
            residual = cv2.GaussianBlur(textures[face] - found.modelled, (0, 0), 2)
            squares += np.square(residual).mean(axis=2) * weights[face]
            seen += weights[face]
    both = squares + squares[:, ::-1], seen + seen[:, ::-1]
    spread = np.sqrt(both[0] / np.maximum(both[1], 1e-6))
    noise = float(squares.sum() / seen.sum())
    spread = np.where(both[1] > 0.1 * len(textures), spread, np.sqrt(noise))
    spread = cv2.GaussianBlur(np.maximum(spread, _LEAST_SPREAD), (0, 0), 3)
    model = make_model(completed, count)
    return replace(model, spread=spread.astype(np.float32), noise=noise)


def main() -> int:
    parser = argparse.ArgumentParser(description="Make the texture morphable model.")
    parser.add_argument("folder", type=Path, help="photographs (*.jpg), one frontal face each")
    parser.add_argument("--bases", type=int, default=SHIPPED)
    parser.add_argument("--out", type=Path, default=FOLDER)
    arguments = parser.parse_args()
    try:
        with Progress(console=Console(stderr=True)) as bar:
            textures, completed, weights = read_faces(arguments.folder, bar)
            model = train(textures, completed, weights, arguments.bases, bar)
        size = save_model(model, arguments.out)
    except HypermaskError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{len(textures)} faces, {model.count} bases, {size / 1000:.0f} kB in {arguments.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
