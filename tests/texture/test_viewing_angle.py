"""What is seen edge on is not believed."""

import numpy as np

from hypermask.face.mesh import LANDMARKS, load_mesh
from hypermask.texture import regions
from hypermask.texture.viewing import cosines, viewing


def _round_head(yaw_deg: float) -> np.ndarray:
    """(468, 3) pixels of the mesh laid round a cylinder of 75 mm and turned; y down, z away."""
    rest = load_mesh().rest[:LANDMARKS] * 1000
    angle = rest[:, 0] / 75 + np.radians(yaw_deg)
    return 3 * np.column_stack([75 * np.sin(angle), -rest[:, 1], -75 * np.cos(angle)])


def test_the_cosine_is_that_of_the_angle_to_the_camera() -> None:
    rest = load_mesh().rest[:LANDMARKS] * 1000
    inner = (np.abs(rest[:, 0]) < 50) & (np.abs(rest[:, 1]) < 60)
    for yaw in (0, 30, -45):
        expected = np.cos(rest[:, 0] / 75 + np.radians(yaw))
        np.testing.assert_allclose(cosines(_round_head(yaw))[inner], expected[inner], atol=0.12)


def test_a_turned_head_hides_its_far_side() -> None:
    x, y = regions.grid_mm()
    row = np.abs(y) < 20
    turned = viewing(_round_head(45))
    assert turned[row & (x > 68) & (x < 72)].max() < 0.1
    assert turned[row & (x < -10) & (x > -70)].min() > 0.95
    frontal = viewing(_round_head(0))
    assert frontal[row & (np.abs(x) < 60)].min() > 0.95
