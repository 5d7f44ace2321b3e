"""How the head is turned in a photograph, and its landmarks turned to the front.

A rigid head (the mean of 130 frontal faces' landmarks, `data/head.json`) is laid on the
photograph's 468 points in space by a similarity (Umeyama 1991). The turn back is linear in the
landmarks, and so is Hardy's fit: a texel's place in the photograph is the same whether the mesh is
fitted before or after the turn. What the turn adds is knowledge: which skin is hidden behind the
nose (`viewing`), that the landmarks of a turned face are less sure (`register`), and what the
person looks like from the front.

    python -m hypermask.texture.pose FOLDER      makes data/head.json from frontal photographs
"""

from __future__ import annotations

import argparse
import functools
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.face.mesh import LANDMARKS, load_mesh

Array = NDArray[np.float64]

VERSION = 1
FILE = Path(__file__).with_name("data") / "head.json"
PUPILS_MM = 63.0
MOST_DEG = 39.0
"""Turned further, half of the face is guesswork. Heads rendered at 30 degrees measure up to 38."""
_ROUNDS = 3


@dataclass(frozen=True)
class HeadPose:
    """photograph = scale * rotation @ head + place: head in mm, x right, y down, z away from the
    camera. rotation: (3, 3); scale: pixels a mm; place: (3,) pixels.
    """

    rotation: Array
    scale: float
    place: Array

    @property
    def yaw_deg(self) -> float:
        """Above 0 the nose points to the picture's right."""
        ahead = -self.rotation[:, 2]
        return float(np.degrees(np.arctan2(ahead[0], -ahead[2])))

    @property
    def pitch_deg(self) -> float:
        """Above 0 the nose points up."""
        ahead = -self.rotation[:, 2]
        return float(np.degrees(np.arctan2(-ahead[1], np.hypot(ahead[0], ahead[2]))))

    @property
    def roll_deg(self) -> float:
        """Above 0 the head leans to the picture's right."""
        return float(np.degrees(np.arctan2(self.rotation[1, 0], self.rotation[0, 0])))

    @property
    def off_front_deg(self) -> float:
        """The angle between the line of the nose and the line to the camera."""
        return float(np.degrees(np.arccos(np.clip(self.rotation[2, 2], -1, 1))))

    def frontal(self, landmarks: Array) -> Array:
        """(n, 3) mm: landmarks (n, 3) of the photograph as the person's own head from the front."""
        return np.asarray((landmarks - self.place) @ self.rotation / self.scale)


def head_pose(landmarks: Array) -> HeadPose:
    """The pose of the head from landmarks (468, 3): pixels, z in the same unit, smaller nearer."""
    return _similarity(landmarks, mean_head())


def _similarity(points: Array, model: Array) -> HeadPose:
    """Least squares over all points (Umeyama 1991)."""
    middle, centre = points.mean(axis=0), model.mean(axis=0)
    inner = model - centre
    u, spread, vt = np.linalg.svd((points - middle).T @ inner)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * signs) @ vt
    scale = float((spread * signs).sum() / np.square(inner).sum())
    return HeadPose(rotation, scale, middle - scale * rotation @ centre)


@functools.cache
def mean_head() -> Array:
    """(468, 3) mm, symmetric, the eyes' corners about 0, `PUPILS_MM` between the pupils."""
    data = json.loads(FILE.read_text("utf-8"))
    return np.array(data["points_mm"], float)


def average(heads: Array) -> Array:
    """(468, 3) mm: the symmetric mean of frontal heads (n, 468, 3), each turned and sized to it."""
    mirror = load_mesh().mirror[:LANDMARKS]
    mean = heads.mean(axis=0)
    for _ in range(_ROUNDS):
        mean = (mean + mean[mirror] * (-1, 1, 1)) / 2
        mean = np.mean([_similarity(one, mean).frontal(one) for one in heads], axis=0)
    return np.asarray((mean + mean[mirror] * (-1, 1, 1)) / 2)


def main() -> int:
    from hypermask.texture.landmarks import FaceFinder
    from hypermask.texture.photo import load_photo

    parser = argparse.ArgumentParser(description="Make the mean head from frontal photographs.")
    parser.add_argument("folder", type=Path)
    arguments = parser.parse_args()
    finder, heads = FaceFinder(), []
    try:
        for photo in sorted(arguments.folder.glob("*.jpg")):
            face = finder.find(load_photo(photo))
            unit = face.eye_distance / PUPILS_MM
            middle = np.append(face.pupils.mean(axis=0), face.points[[33, 263], 2].mean())
            heads.append((face.points - middle) / unit)
    except DataError as error:
        print(error, file=sys.stderr)
        return 1
    data = {"version": VERSION, "unit": "mm, x right, y down, z away from the camera"}
    points = np.round(average(np.array(heads)), 2).tolist()
    FILE.write_text(json.dumps({**data, "points_mm": points}) + "\n", "utf-8")
    print(f"{len(heads)} heads, {FILE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
