"""The product's mapping and the paper's, from what is predicted for the moment of the light."""

from pathlib import Path

import numpy as np

from hypermask.errors import DataError
from hypermask.geometry import FACING, Pose, homogeneous_apply
from hypermask.mask import load_mask
from hypermask.stage.mapping import PlanarMapping, ProCamMapping

MASK = load_mask(Path(__file__).parents[2] / "configs" / "masks" / "reference")
K = np.array([[1920, 0, 640], [0, 1920, 720], [0, 0, 1.0]])
LEDS_PX = np.array([[100, 100], [260, 100], [260, 320], [100, 320], [180, 232.0]])


def moving(time_s):
    return Pose(FACING, np.array([0.5 * time_s, 0.0, 1.8]))


class ProCam:
    def projector_from_mask(self, pose):
        return K @ pose.matrix()


class Planar:
    """A pixel a millimetre, put where the LEDs are."""

    def projector_from_mask(self, points, mask):
        if np.ptp(points[:4, 0]) == 0:
            raise DataError("CAL-PLANAR", "the corners lie on a line", "Move.")
        centre = points[:4].mean(axis=0)
        return np.array([[1000, 0, 0, centre[0]], [0, -1000, 0, centre[1]], [0, 0, 0, 1.0]])


def test_procam_takes_the_pose_at_the_time_of_the_light():
    mapping = ProCamMapping(ProCam(), moving)
    early, late = (homogeneous_apply(mapping.at(t), MASK.leds[4]) for t in (1.0, 1.02))
    np.testing.assert_allclose(late - early, [1920 * 0.5 * 0.02 / (1.8 - 0.04), 0])


def test_planar_takes_the_points_at_the_time_of_the_light():
    mapping = PlanarMapping(Planar(), MASK, lambda t: LEDS_PX + np.array([100 * t, 0]))
    found = homogeneous_apply(mapping.at(0.1), MASK.leds[:4])
    np.testing.assert_allclose(found, LEDS_PX[:4] + np.array([10, 0]))


def test_an_unknown_place_maps_nowhere():
    assert ProCamMapping(ProCam(), lambda t: None).at(1.0) is None
    assert PlanarMapping(Planar(), MASK, lambda t: None).at(1.0) is None
    broken = Pose(FACING, np.array([np.nan, 0, 1.8]))
    assert ProCamMapping(ProCam(), lambda t: broken).at(1.0) is None


def test_planar_needs_all_four_corners_off_one_line_but_not_the_label():
    hidden = LEDS_PX.copy()
    hidden[4] = np.nan
    assert PlanarMapping(Planar(), MASK, lambda t: hidden).at(1.0) is not None
    hidden[2] = np.nan
    assert PlanarMapping(Planar(), MASK, lambda t: hidden).at(1.0) is None
    line = np.zeros((5, 2))
    assert PlanarMapping(Planar(), MASK, lambda t: line).at(1.0) is None
