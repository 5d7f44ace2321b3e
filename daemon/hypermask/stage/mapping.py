"""Where mask points go in the projector's picture at the moment of the light.

Two ways, one answer: a (3, 4) projective map from mask metres to projector pixels. `ProCamMapping`
is the product's default (pose and the projector's full matrix), `PlanarMapping` the paper's
(predicted LED image points and a camera-to-projector map of the plane; PAPERS A1, A2).
The calibrations and predictors come in by protocol.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.geometry import Pose
from hypermask.mask import Mask

Array = NDArray[np.float64]

PredictPose = Callable[[float], Pose | None]
"""camera_from_mask at a time; None when the mask's place is unknown."""

PredictPoints = Callable[[float], Array | None]
"""The five LEDs' image points (5, 2) px at a time, NaN where one is unknown; None for all."""


class ProCamCalibration(Protocol):
    def projector_from_mask(self, camera_from_mask: Pose, /) -> Array: ...


class PlanarCalibration(Protocol):
    def projector_from_mask(self, points: Array, mask: Mask, /) -> Array: ...


class Mapping(Protocol):
    """What the stage asks, at the latch, for a frame's light time."""

    def at(self, light_s: float) -> Array | None:
        """(3, 4) projector_from_mask, or None when there is nothing to draw on."""
        ...


class ProCamMapping:
    """Pose at light time, then the projector's full matrix."""

    def __init__(self, calibration: ProCamCalibration, predict: PredictPose) -> None:
        self._calibration = calibration
        self._predict = predict

    def at(self, light_s: float) -> Array | None:
        pose = self._predict(light_s)
        return None if pose is None else _finite(self._calibration.projector_from_mask(pose))


class PlanarMapping:
    """LED image points at light time, then the plane's map. Right only in its depth band."""

    def __init__(self, calibration: PlanarCalibration, mask: Mask, predict: PredictPoints) -> None:
        self._calibration = calibration
        self._mask = mask
        self._predict = predict

    def at(self, light_s: float) -> Array | None:
        points = self._predict(light_s)
        if points is None or np.isfinite(points[:4]).all(axis=1).sum() < 4:
            return None
        try:
            return _finite(self._calibration.projector_from_mask(points, self._mask))
        except DataError:  # the predicted corners fell on one line: nothing to draw on
            return None


def _finite(matrix: Array) -> Array | None:
    return matrix if np.isfinite(matrix).all() else None
