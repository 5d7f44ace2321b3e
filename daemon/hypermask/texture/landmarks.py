"""Faces in a photograph and their 468 landmarks, with OpenCV's own network module.

The two models are those of FACTS (Face and texture), converted by `hypermask.texture.models`.
Left and right in this file are the image's.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.texture.models import DETECTOR, LANDMARKS, model_path
from hypermask.texture.photo import scaled
from hypermask.texture.pupils import find_pupils
from hypermask.texture.usable import check_front, check_lit, check_upright, check_whole

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

LANDMARK_COUNT = 468
MIN_EYE_DISTANCE_PX = 24.0
_DETECTOR_SIDE = 128
_LANDMARK_SIDE = 192
_DETECTION_SCORE = 0.5
_LANDMARK_SCORE = 0.5
_CROP = 1.5
_OVERLAP = 0.3
_BYSTANDER = 0.3
"""A second face below this fraction of the first one's size is a bystander or a picture."""
_OUTER_CORNERS = (33, 263)


@dataclass(frozen=True)
class Detection:
    """centre (2,), size, eyes (2, 2): pixels of the photograph; score 0 to 1."""

    centre: Array
    size: float
    eyes: Array
    score: float


@dataclass(frozen=True)
class Landmarks:
    """points: (468, 3), x and y in pixels, z in the same unit, smaller is nearer; score 0 to 1;
    pupils: (2, 2) pixels, the image's left one first.
    """

    points: Array
    score: float
    pupils: Array

    @property
    def eye_distance(self) -> float:
        left, right = self.pupils
        return float(np.hypot(*(right - left)))


class FaceFinder:
    """Loads both models once. Raises `DataError` FACE-MODELS where they are absent."""

    def __init__(self, folder: Path | None = None) -> None:
        self._detector = _network(model_path(DETECTOR, folder))
        self._landmarks = _network(model_path(LANDMARKS, folder))
        self._anchors = _anchors()

    def find(self, image: Image) -> Landmarks:
        """The one face of a photograph (h, w, 3) BGR.

        Raises `DataError` FACE-NONE, FACE-MANY, FACE-SMALL, FACE-TURNED, FACE-CUT, FACE-DARK.
        """
        faces = self.find_all(image)
        if not faces:
            raise DataError(
                "FACE-NONE",
                "no face was found in the photograph",
                "Use a sharp, frontal photograph of one person in even light.",
            )
        if len(faces) > 1:
            raise DataError(
                "FACE-MANY",
                f"the photograph shows {len(faces)} faces",
                "Cut it so that one face remains.",
            )
        if faces[0].eye_distance < MIN_EYE_DISTANCE_PX:
            raise DataError(
                "FACE-SMALL",
                f"the face is too small: {faces[0].eye_distance:.0f} pixels between the eyes",
                f"Use a photograph with at least {MIN_EYE_DISTANCE_PX:.0f}, better 100 pixels.",
            )
        face = faces[0]
        check_upright(image, face.score, self._best_score)
        check_front(face.points)
        check_whole(face.points, (image.shape[1], image.shape[0]))
        check_lit(image, face.points)
        return face

    def _best_score(self, image: Image) -> float:
        return max((face.score for face in self.find_all(image)), default=0.0)

    def find_all(self, image: Image) -> list[Landmarks]:
        """All faces of the first scale at which there are any, largest first, bystanders out."""
        for boxes in _scales(image.shape[1], image.shape[0]):
            detections = [d for box in boxes for d in self._detect(image, box)]
            faces = [self.refine(image, detection) for detection in _suppress(detections)]
            found = _distinct([face for face in faces if face.score > _LANDMARK_SCORE])
            if found:
                return [f for f in found if f.eye_distance > _BYSTANDER * found[0].eye_distance]
        return []

    def refine(self, image: Image, detection: Detection) -> Landmarks:
        """Landmarks from the detection's crop, then again from the crop they give themselves."""
        left, right = detection.eyes
        first = self._run(image, detection.centre, detection.size * _CROP, right - left)
        points = first.points[:, :2]
        axis = points[_OUTER_CORNERS[1]] - points[_OUTER_CORNERS[0]]
        low, high = points.min(0), points.max(0)
        return self._run(image, (low + high) / 2, float((high - low).max()) * _CROP, axis)

    def _run(self, image: Image, centre: Array, size: float, axis: Array) -> Landmarks:
        """Landmarks of the square crop whose x axis lies along `axis`."""
        angle = float(np.arctan2(axis[1], axis[0]))
        scale = size / _LANDMARK_SIDE
        turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        offset = centre - turn @ np.full(2, (_LANDMARK_SIDE - 1) / 2)
        crop = cv2.warpAffine(
            image,
            np.column_stack([turn, offset]),
            (_LANDMARK_SIDE, _LANDMARK_SIDE),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        self._landmarks.setInput(cv2.dnn.blobFromImage(crop, 1 / 255, swapRB=True))
        raw, score = self._landmarks.forward(["conv2d_21", "conv2d_31"])
        points = np.asarray(raw, float).reshape(LANDMARK_COUNT, 3)
        points[:, :2] = points[:, :2] @ turn.T + offset
        points[:, 2] *= scale
        pupils = find_pupils(image, points[:, :2])
        return Landmarks(points, _sigmoid(float(score.item())), pupils)

    def _detect(self, image: Image, box: Array) -> list[Detection]:
        """Detections in the square box (x, y, side), which may reach beyond the photograph."""
        x, y, side = box
        scale = side / _DETECTOR_SIDE
        matrix = np.array([[scale, 0, x + scale / 2 - 0.5], [0, scale, y + scale / 2 - 0.5]])
        source = image
        if scale > 2:  # a bilinear warp of a much larger picture would alias
            factor = 2 / scale
            source = scaled(image, factor)
            matrix = matrix * factor
        crop = cv2.warpAffine(
            source,
            matrix,
            (_DETECTOR_SIDE, _DETECTOR_SIDE),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        )
        blob = cv2.dnn.blobFromImage(crop, 1 / 127.5, mean=(127.5,) * 3, swapRB=True)
        self._detector.setInput(blob)
        boxes, scores = self._detector.forward(["regressors", "classificators"])
        likely = _sigmoid_all(np.asarray(scores, float).ravel())
        chosen = np.flatnonzero(likely > _DETECTION_SCORE)
        values = np.asarray(boxes, float).reshape(-1, 8, 2)[chosen] * scale
        places = self._anchors[chosen] * side + (x, y)
        return [
            Detection(place + v[0], float(v[1].max()), place + v[2:4], float(s))
            for place, v, s in zip(places, values, likely[chosen], strict=True)
        ]


def _network(path: Path) -> cv2.dnn.Net:
    try:
        return cv2.dnn.readNetFromONNX(str(path))
    except cv2.error as error:
        raise DataError(
            "FACE-MODELS",
            f"the face model {path} cannot be read",
            "Delete it and run 'make models'.",
        ) from error


def _anchors() -> Array:
    """(896, 2) centres in the unit square: 16 x 16 cells twice, then 8 x 8 cells six times."""
    rows = []
    for cells, count in ((16, 2), (8, 6)):
        line = (np.arange(cells) + 0.5) / cells
        grid = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
        rows.append(np.repeat(grid, count, axis=0))
    return np.concatenate(rows)


def _scales(width: int, height: int) -> list[list[Array]]:
    """Square boxes: the whole photograph, then with a border (close-ups), then tiles."""
    long = max(width, height)

    def around(side: float) -> Array:
        return np.array([(width - side) / 2, (height - side) / 2, side])

    scales = [[around(long)], [around(1.6 * long)]]
    for fraction in (0.5, 0.25):
        side = fraction * long
        xs = _tile_starts(width, side)
        ys = _tile_starts(height, side)
        scales.append([np.array([x, y, side]) for y in ys for x in xs])
    return scales


def _tile_starts(length: int, side: float) -> Array:
    if length <= side:
        return np.array([(length - side) / 2])
    count = int(np.ceil((length - side) / (side / 2))) + 1
    return np.linspace(0, length - side, count)


def _suppress(detections: list[Detection]) -> list[Detection]:
    """The best of each group of overlapping detections, in order of size."""
    kept: list[Detection] = []
    for detection in sorted(detections, key=lambda d: -d.score):
        if all(_apart(detection, other) for other in kept):
            kept.append(detection)
    return sorted(kept, key=lambda d: -d.size)


def _apart(a: Detection, b: Detection) -> bool:
    low = np.maximum(a.centre - a.size / 2, b.centre - b.size / 2)
    high = np.minimum(a.centre + a.size / 2, b.centre + b.size / 2)
    common = float(np.prod(np.maximum(high - low, 0)))
    return common < _OVERLAP * min(a.size, b.size) ** 2


def _distinct(faces: list[Landmarks]) -> list[Landmarks]:
    """Faces whose landmarks do not coincide, largest first."""
    kept: list[Landmarks] = []
    for face in sorted(faces, key=lambda f: -f.eye_distance):
        middle = face.points[:, :2].mean(0)
        gaps = [np.hypot(*(middle - other.points[:, :2].mean(0))) for other in kept]
        if all(gap > other.eye_distance for gap, other in zip(gaps, kept, strict=True)):
            kept.append(face)
    return kept


def _sigmoid(value: float) -> float:
    return float(1 / (1 + np.exp(-np.clip(value, -80, 80))))


def _sigmoid_all(values: Array) -> Array:
    return np.asarray(1 / (1 + np.exp(-np.clip(values, -80, 80))))
