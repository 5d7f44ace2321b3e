"""A character's sheet as the audience sees it: each picture projected on to a mask."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask.face.character import Character
from hypermask.face.face import Face
from hypermask.face.mouth import MOUTH_SHAPES
from hypermask.face.sheet import POSES, Pose, joined, titled, unit_poses
from hypermask.geometry import Pose as Place
from hypermask.mask import Mask
from hypermask.rehearsal.cart import true_procam
from hypermask.rehearsal.lockstep import read_back
from hypermask.stage.renderer import DrawItem, StageRenderer
from hypermask_drivers.projector.gles import create_context
from hypermask_sim.audience import Audience
from hypermask_sim.scenario import Attitude, PerformerSettings, Scenario
from hypermask_sim.world import World

Image = NDArray[np.uint8]

_DISTANCE_M = 1.8
_VIEW = (960, 720)
_PART = (slice(150, 475), slice(345, 615))
"""Rows and columns of the view that show the mask: the audience's eye always follows it."""


def projected_sheet(
    character: Character, mask: Mask, columns: int = 7, poses: Sequence[Pose] | None = None
) -> Image:
    """(h, w, 3) RGB: the pictures of `face.sheet`, each drawn by the stage's renderer, projected
    by the simulated cart on to its mask at 1.8 m and seen from the audience.
    """
    context = create_context()
    try:
        theatre = _Theatre(context, character, mask)
        pictures = [
            titled(theatre.seen(pose), pose.title)
            for pose in ((*POSES, *unit_poses()) if poses is None else poses)
        ]
        return joined(pictures, columns)
    finally:
        context.release()


class _Theatre:
    """The simulated cart's projector, a mask, and the audience."""

    def __init__(self, context: moderngl.Context, character: Character, mask: Mask) -> None:
        self._context = context
        self._face = Face(character, mask)
        size = Scenario().projector
        self._size = (size.width, size.height)
        self._renderer = StageRenderer(context, self._size, mask)
        self._renderer.load("face", self._face.actor)
        with context:
            self._framebuffer = context.framebuffer(
                [context.texture(self._size, 4)], context.depth_renderbuffer(self._size)
            )
        self._audience = cache(lambda world: Audience(context, world, _VIEW))
        self._world = cache(_world)

    def seen(self, pose: Pose) -> Image:
        """The part of the audience's view that shows the mask."""
        world = self._world(pose.turn)
        place = Place(*world.camera_from_mask(0.0))
        positions = self._face.positions(
            pose.expression, MOUTH_SHAPES[pose.mouth], pose.lids, pose.units, pose.gaze
        )
        matrix = true_procam(world).projector_from_mask(place)
        self._renderer.draw(self._framebuffer, matrix, [DrawItem("face", positions)])
        audience = self._audience(world)
        view = audience.render(read_back(self._framebuffer), 0.0)
        return np.ascontiguousarray(view[_PART])


def _world(turn: tuple[float, float]) -> World:
    yaw, pitch = turn
    attitude = Attitude(yaw=yaw, pitch=pitch)
    performer = PerformerSettings(distance_m=_DISTANCE_M, attitude_deg=attitude)
    return World(Scenario(performer=performer))
