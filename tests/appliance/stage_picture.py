"""One picture drawn by the stage's own renderer: the same in the guest and on the host."""

from pathlib import Path

import numpy as np

from hypermask.geometry import FACING, Pose, rotation_from_attitude
from hypermask.stage.layers import dots_actor
from hypermask.stage.renderer import DrawItem, StageRenderer
from hypermask_drivers.mask import load_mask
from hypermask_drivers.projector import Projector


def draw_mask(projector: Projector, root: Path) -> None:
    """The mask with a chequered ramp on it at 1.8 m, turned a little. root: the repository."""
    size = (projector.mode.width, projector.mode.height)
    mask = load_mask(root / "configs/masks/reference")
    down, right = np.mgrid[:512, :512]
    texture = np.dstack([right // 2, down // 2, 128 * (down // 64 + right // 64 & 1)])
    actor, positions = dots_actor(mask, texture.astype(np.uint8))
    renderer = StageRenderer(projector.context, size, mask)
    renderer.load("dots", actor)
    pose = Pose(FACING @ rotation_from_attitude(0.1, 0.05, 0.3), np.array([0.0, 0.0, 1.8]))
    matrix = np.array([[2500.0, 0, size[0] / 2], [0, 2500.0, size[1] / 2], [0, 0, 1]])
    items = [DrawItem("dots", positions)]
    renderer.draw(projector.framebuffer, np.asarray(matrix @ pose.matrix()), items)
