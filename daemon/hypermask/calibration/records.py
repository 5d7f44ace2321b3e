"""Calibration results and clicks as plain tables (for JSON), and back."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from hypermask.calibration.fixed import Fixed
from hypermask.calibration.parallax import Parallax
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.placements import Placement
from hypermask.calibration.planar import Planar
from hypermask.calibration.positions import Position
from hypermask.geometry import Array, Fisheye, Pinhole, Pose

Table = dict[str, Any]


def _rows(array: Array) -> list[Any]:
    """Nested lists; NaN (a skipped click, an unseen LED) becomes null."""
    values: list[Any] = np.where(np.isfinite(array), array, None).tolist()  # type: ignore[call-overload]
    return values


def _array(rows: Any, shape: tuple[int, ...]) -> Array:
    """Raises ValueError for another shape or for what is no number."""
    array = np.array(rows, dtype=object)
    if array.shape != shape:
        raise ValueError(f"expected {shape}, found {array.shape}")
    missing = array == None  # noqa: E711  (element by element)
    return np.where(missing, np.nan, array).astype(float)


def _finite(rows: Any, shape: tuple[int, ...]) -> Array:
    array = _array(rows, shape)
    if not np.all(np.isfinite(array)):
        raise ValueError("a number is missing")
    return array


def pose_table(pose: Pose) -> Table:
    return {"rotation": _rows(pose.rotation), "translation_m": _rows(pose.translation)}


def pose_from(table: Table) -> Pose:
    rotation = _finite(table["rotation"], (3, 3))
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6):
        raise ValueError("the rotation is not a rotation")
    return Pose(rotation, _finite(table["translation_m"], (3,)))


def procam_table(procam: ProCam) -> Table:
    return {
        "matrix": _rows(procam.projector.matrix),
        "size": list(procam.projector.size),
        "projector_from_camera": pose_table(procam.projector_from_camera),
    }


def procam_from(table: Table) -> ProCam:
    width, height = (int(n) for n in table["size"])
    pinhole = Pinhole(_finite(table["matrix"], (3, 3)), (width, height))
    return ProCam(pinhole, pose_from(table["projector_from_camera"]))


def planar_table(planar: Planar) -> Table:
    return {
        "homography": _rows(planar.homography),
        "kind": planar.kind,
        "distance_m": planar.distance_m,
        "band_m": [b if np.isfinite(b) else None for b in planar.band_m],
        "parallax": asdict(planar.parallax),
        "condition": planar.condition,
    }


def planar_from(table: Table) -> Planar:
    kind = table["kind"]
    if kind not in ("affine", "projective"):
        raise ValueError(f"unknown kind {kind!r}")
    near, far = table["band_m"]
    return Planar(
        _finite(table["homography"], (3, 3)),
        kind,
        float(table["distance_m"]),
        (float(near), float("inf") if far is None else float(far)),
        _parallax_from(table["parallax"]),
        float(table["condition"]),
    )


def _parallax_from(table: Table) -> Parallax:
    baseline, lean = (_finite(table[name], (2,)) for name in ("baseline_m", "lean_m"))
    return Parallax(
        float(table["distance_m"]),
        (float(baseline[0]), float(baseline[1])),
        (float(lean[0]), float(lean[1])),
        float(table["lean_rms_m"]),
        float(table["aim_m"]),
    )


def fixed_table(fixed: Fixed) -> Table:
    return {
        "matrix": _rows(fixed.lens.matrix),
        "k": _rows(fixed.lens.k),
        "size": list(fixed.lens.size),
        "projector_from_mask": pose_table(fixed.projector_from_mask),
        "anchors_m": _rows(fixed.anchors),
        "weights_px": _rows(fixed.weights),
        "reach_m": fixed.reach_m,
        "expected_mm": fixed.expected_mm,
    }


def fixed_from(table: Table) -> Fixed:
    width, height = (int(n) for n in table["size"])
    lens = Fisheye(_finite(table["matrix"], (3, 3)), _finite(table["k"], (4,)), (width, height))
    count = len(table["anchors_m"])
    anchors, weights = np.zeros((0, 3)), np.zeros((0, 2))
    if count:
        anchors = _finite(table["anchors_m"], (count, 3))
        weights = _finite(table["weights_px"], (count, 2))
    reach = float(table["reach_m"])
    if not reach > 0:
        raise ValueError("the reach is not above 0")
    pose = pose_from(table["projector_from_mask"])
    return Fixed(lens, pose, anchors, weights, reach, float(table["expected_mm"]))


def calibration_table(calibration: ProCam | Planar | Fixed) -> Table:
    if isinstance(calibration, ProCam):
        return procam_table(calibration)
    return fixed_table(calibration) if isinstance(calibration, Fixed) else planar_table(calibration)


def calibration_from(method: str, table: Table) -> ProCam | Planar | Fixed:
    """Raises `KeyError`, `TypeError` or `ValueError` where the table is not one of that method."""
    if method == "click":
        return procam_from(table)
    return fixed_from(table) if method == "fixed" else planar_from(table)


def placement_table(placement: Placement) -> Table:
    return {
        "pose": pose_table(placement.pose),
        "covariance": _rows(placement.covariance),
        "points_px": _rows(placement.points),
        "pixels_px": _rows(placement.pixels),
    }


def placement_from(table: Table) -> Placement:
    return Placement(
        pose_from(table["pose"]),
        _finite(table["covariance"], (6, 6)),
        _array(table["points_px"], (5, 2)),
        _array(table["pixels_px"], (5, 2)),
    )


def position_table(position: Position) -> Table:
    return {name: getattr(position, name) for name in Position.__dataclass_fields__}


def position_from(table: Table) -> Position:
    numbers = {name: float(table[name]) for name in ("x_m", "y_m", "distance_m", "pitch", "yaw")}
    return Position(**numbers, side=int(table["side"]), level=int(table["level"]))
