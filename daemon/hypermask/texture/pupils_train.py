"""Makes the correction of the pupils' places from photographs with pupils placed by hand.

    python -m hypermask.texture.pupils_train FOLDER

FOLDER: photographs (*.jpg), beside each a *.pts.csv whose first two points are the pupils (pixels,
a line of titles first). Prints the error on faces left out (5 folds) before and after.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import HypermaskError
from hypermask.storage import write_atomically
from hypermask.texture.landmarks import FaceFinder
from hypermask.texture.morphable_train import folds
from hypermask.texture.photo import load_photo
from hypermask.texture.pupils import FILE, RINGS, VERSION, eye_patch

Array = NDArray[np.float64]
_COMPONENTS = 40
_PENALTY = 30.0


def solve(views: Array, wanted: Array) -> tuple[Array, Array]:
    """(weights (n, 2), constant (2,)): ridge on the views' (m, n) principal components."""
    middle = views.mean(axis=0)
    axes = np.linalg.svd(views - middle, full_matrices=False)[2][:_COMPONENTS]
    scores = (views - middle) @ axes.T
    unit = scores[:, 0].std() / 3
    inputs = np.column_stack([scores / unit, np.ones(len(views))])
    penalty = _PENALTY * np.diag([1.0] * len(axes) + [0.0])
    found = np.linalg.solve(inputs.T @ inputs + penalty, inputs.T @ wanted)
    weights = axes.T @ found[:-1] / unit
    return weights, found[-1] - middle @ weights


def read(folder: Path) -> tuple[Array, Array, Array, Array]:
    """(views (m, n), wanted (m, 2), px between the pupils (m,), all in the patch; face (m,))."""
    finder = FaceFinder()
    views, wanted, units, faces = [], [], [], []
    for number, photo in enumerate(sorted(folder.glob("*.jpg"))):
        image = load_photo(photo)
        points = finder.find(image).points[:, :2]
        placed = np.loadtxt(photo.with_suffix(".pts.csv"), delimiter=",", skiprows=1)[:2]
        for side, ring in enumerate(RINGS):
            patch = eye_patch(image, points, ring, bool(side))
            views.append(patch.view())
            wanted.append(patch.to_patch(placed[side]) - patch.guess)
            units.append(float(np.hypot(*(placed[1] - placed[0]))) / patch.pixel)
            faces.append(number)
    return np.array(views), np.array(wanted), np.array(units), np.array(faces)


def main() -> int:
    parser = argparse.ArgumentParser(description="Make the correction of the pupils' places.")
    parser.add_argument("folder", type=Path)
    arguments = parser.parse_args()
    try:
        views, wanted, units, faces = read(arguments.folder)
        errors = np.zeros(len(views))
        for known, unknown in folds(int(faces.max()) + 1):
            weights, constant = solve(views[np.isin(faces, known)], wanted[np.isin(faces, known)])
            out = np.isin(faces, unknown)
            left = views[out] @ weights + constant - wanted[out]
            errors[out] = np.linalg.norm(left, axis=1) / units[out]
        weights, constant = solve(views, wanted)
        data = {
            "version": VERSION,
            "weights": np.round(weights, 5).tolist(),
            "constant": np.round(constant, 4).tolist(),
        }
        write_atomically(FILE, (json.dumps(data) + "\n").encode())
    except HypermaskError as error:
        print(error, file=sys.stderr)
        return 1
    for name, values in (("before", np.linalg.norm(wanted, axis=1) / units), ("after", errors)):
        parts = [f"{np.percentile(values, p):.2%}" for p in (50, 95, 100)]
        print(f"{name}: mean {values.mean():.2%}, median, 95 % and most {', '.join(parts)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
