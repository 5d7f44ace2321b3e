"""The GPU's matrix says the same as the projector's, to a small part of a pixel."""

import numpy as np
import pytest

from hypermask.geometry import FACING, Pose, homogeneous_apply, rotation_from_attitude
from hypermask.stage.clip import view_of

SIZE = (1280, 720)
K = np.array([[1920, 0, 639.5], [0, 1920, 719.5], [0, 0, 1.0]])
PROJECTOR_FROM_CAMERA = Pose(np.eye(3), np.array([-0.15, 0.0, 0.0]))


def procam(roll=0.0, pitch=0.0, yaw=0.0, at=(0.15, -0.17, 1.8)):
    rotation = FACING @ rotation_from_attitude(*np.radians([roll, pitch, yaw]))
    return K @ PROJECTOR_FROM_CAMERA.compose(Pose(rotation, np.array(at))).matrix()


def cloud(count=200):
    rng = np.random.default_rng(1)
    return rng.uniform([-0.1, -0.13, -0.02], [0.1, 0.13, 0.04], (count, 3))


def window_pixels(view, points):
    """What OpenGL makes of float32 vertices, with y counted from the top."""
    clip = np.column_stack([points, np.ones(len(points))]).astype(np.float32) @ view.matrix.T
    ndc = clip[:, :3] / clip[:, 3:]
    width, height = SIZE
    return np.column_stack(
        [(ndc[:, 0] + 1) / 2 * width - 0.5, (1 - ndc[:, 1]) / 2 * height - 0.5, ndc[:, 2]]
    )


@pytest.mark.parametrize("attitude", [(0, 0, 0), (170, 20, -30), (-90, -20, 45)])
@pytest.mark.parametrize("scale", [1.0, -3e-4, 1e6])
def test_a_point_lands_where_the_matrix_says(attitude, scale):
    projection = procam(*attitude)
    view = view_of(scale * projection, cloud(), SIZE)
    expected = homogeneous_apply(projection, cloud())
    np.testing.assert_allclose(window_pixels(view, cloud())[:, :2], expected, atol=0.005)


def test_a_homography_of_the_plane_lands_too():
    homography = np.array([[2100, 40, 600], [-30, -2000, 400], [0.05, -0.1, 1]])
    planar = np.insert(homography, 2, 0.0, axis=1)
    expected = homogeneous_apply(planar, cloud())
    np.testing.assert_allclose(
        window_pixels(view_of(planar, cloud(), SIZE), cloud())[:, :2], expected, atol=0.005
    )


@pytest.mark.parametrize("attitude", [(0, 0, 0), (0, 0, 45), (0, 0, -45), (90, 20, 30)])
def test_what_is_nearer_to_the_projector_has_the_smaller_depth(attitude):
    projection = procam(*attitude)
    depth = window_pixels(view_of(projection, cloud(), SIZE), cloud())[:, 2]
    metres = (np.column_stack([cloud(), np.ones(200)]) @ projection.T)[:, 2]
    assert np.array_equal(np.argsort(depth), np.argsort(metres))
    assert np.abs(depth).max() <= 0.95


def test_where_the_projection_knows_no_depth_the_front_of_the_mask_is_nearer():
    planar = np.array([[2000, 0, 0, 640], [0, -2000, 0, 360], [0.1, 0.2, 0, 1.0]])
    pair = np.array([[0.03, 0.05, 0.0], [0.03, 0.05, 0.04]])
    back, front = window_pixels(view_of(planar, pair, SIZE), pair)[:, 2]
    assert front < back
    affine = planar.copy()
    affine[2] = [0, 0, 0, 1]
    back, front = window_pixels(view_of(affine, pair, SIZE), pair)[:, 2]
    assert front < back


def test_the_box_holds_every_point_and_little_more():
    left, bottom, width, height = view_of(procam(), cloud(), SIZE).box
    pixels = homogeneous_apply(procam(), cloud())
    top = SIZE[1] - bottom - height
    assert left <= pixels[:, 0].min() and pixels[:, 0].max() <= left + width - 1
    assert top <= pixels[:, 1].min() and pixels[:, 1].max() <= top + height - 1
    assert width <= np.ptp(pixels[:, 0]) + 5 and height <= np.ptp(pixels[:, 1]) + 5


def test_nothing_to_see_behind_the_projector_or_beside_the_frame():
    beside = procam(at=(3.0, 0.0, 1.8))
    assert view_of(beside, cloud(), SIZE) is None
    across = procam(at=(0.15, 0.0, 0.02))
    assert view_of(across, cloud(), SIZE) is None
    assert view_of(np.zeros((3, 4)), cloud(), SIZE) is None


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(bad):
    projection = procam()
    projection[1, 2] = bad
    with pytest.raises(ValueError):
        view_of(projection, cloud(), SIZE)
    points = cloud()
    points[7, 1] = bad
    with pytest.raises(ValueError):
        view_of(procam(), points, SIZE)
