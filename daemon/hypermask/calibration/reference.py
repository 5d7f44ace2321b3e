"""`cv2.calibrateCamera` on the same clicks: what the product's own solution is measured against."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from hypermask.calibration.parameters import ProCam
from hypermask.calibration.placements import Placement, check_placements
from hypermask.errors import DataError
from hypermask.geometry import Array, Pinhole, Pose


def solve_opencv(placements: Sequence[Placement], leds: Array, nominal: ProCam) -> ProCam:
    """The same clicks through `cv2.calibrateCamera`: the reference for `solve`.

    All clicks are one view of points in the camera frame, with the nominal projector as the
    guess, fixed aspect, free principal point, no distortion, no prior and no outlier test.
    Raises `DataError` CAL-DEPTH, CAL-FEW, or CAL-SOLVE where OpenCV refuses.
    """
    check_placements(placements)
    points = np.concatenate([p.pose.apply(leds[p.clicked]) for p in placements])
    pixels = np.concatenate([p.pixels[p.clicked] for p in placements])
    flags = (
        cv2.CALIB_USE_INTRINSIC_GUESS
        | cv2.CALIB_FIX_ASPECT_RATIO
        | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_K1
        | cv2.CALIB_FIX_K2
        | cv2.CALIB_FIX_K3
    )
    try:
        _, matrix, _, turns, shifts = cv2.calibrateCamera(
            [points.astype(np.float32)],
            [pixels.astype(np.float32)],
            nominal.projector.size,
            nominal.projector.matrix.copy(),
            np.zeros(5),
            flags=flags,
        )
    except cv2.error as error:
        raise DataError(
            "CAL-SOLVE", "the clicks have no solution", "Click more positions."
        ) from error
    rotation = np.asarray(cv2.Rodrigues(turns[0])[0], float)
    pose = Pose(rotation, np.asarray(shifts[0], float).reshape(3))
    return ProCam(Pinhole(np.asarray(matrix, float), nominal.projector.size), pose)
