"""The audience's view of a Mask-bot: its screen glows from inside, its unit turns the head.

Where the light of the picture comes out is traced once through the true lens on to the true relief.
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask_sim import audience_scene as scene
from hypermask_sim import audience_shaders as shaders
from hypermask_sim.audience import SIZE, STAGE_FROM_CAMERA, Audience, Window, _Boxes, _rigid
from hypermask_sim.surface import Surface
from hypermask_sim.world import World

Array = NDArray[np.float64]

FULL_AT = 0.5
"""The screen's light is seen as white where this part of it is darker."""


class RobotAudience(Audience):
    """As `Audience`, for a world with a screen fixed to its projector (`World.mounted`)."""

    _world: World

    def _face_program(self) -> Any:
        return self._program(shaders.SCREEN_VERTEX, shaders.SCREEN_FRAGMENT)

    def _face_mesh(self, program: Any) -> Any:
        mesh = scene.mask_mesh(self._world.mask)
        content = np.column_stack([mesh.vertices, self._lit(mesh.vertices.astype(float))])
        vertices = self._keep(self._context.buffer(content.astype(np.float32).tobytes()))
        triangles = self._keep(self._context.buffer(mesh.triangles.tobytes()))
        layout = (vertices, "3f 3f", "in_position", "in_light")
        return self._keep(self._context.vertex_array(program, [layout], triangles, 4))

    def _lit(self, points: Array) -> Array:
        """(V, 3): the picture's place (u, v) whose light comes out at points (V, 3), and how
        bright it is there."""
        assert self._world.mounted is not None
        rotation, translation = self._world.mounted
        optics = self._world.projector
        seen = points @ rotation.T + translation
        uv = (optics.lens.image(seen) + 0.5) / optics.size
        slope = Surface(self._world.mask).slope(points[:, 0], points[:, 1])
        normals = np.column_stack([-slope, np.ones(len(points))])
        away = points + rotation.T @ translation  # from the lens to the point
        distance = np.linalg.norm(away, axis=1)
        incidence = np.maximum(np.sum(normals * away, axis=1), 0)
        incidence /= np.linalg.norm(normals, axis=1) * distance
        light = optics.lens.density(seen) * incidence / distance**2
        inside = self._world.mask.inside(points[:, 0], points[:, 1])
        return np.column_stack([uv, light / np.quantile(light[inside], FULL_AT)])

    def _build_figure(self, cloth: list[Any]) -> None:
        self._shell, _ = self._mesh(cloth, scene.shell(self._world.mask))
        self._pedestal, _ = self._mesh(cloth, scene.pedestal())

    def _draw_figure(self, boxes: _Boxes) -> None:
        self._set(albedo=(0.30, 0.30, 0.30), mask_from_model=np.eye(4))
        self._rim.render()
        self._context.front_face = "cw"  # they are ccw, but the view is drawn upside down
        self._context.enable(moderngl.CULL_FACE)
        self._set(albedo=(0.55, 0.56, 0.60))
        self._shell.render()
        self._set(mask_from_model=self._mask_from_stage @ _rigid(np.eye(3), self._axes))
        self._set(albedo=(0.22, 0.22, 0.24))
        self._pedestal.render()
        self._context.disable(moderngl.CULL_FACE)
        self._context.front_face = "ccw"

    @property
    def _axes(self) -> Array:
        """Where pan and tilt axes meet, stage axes: the head turns, they stay."""
        world = self._world
        upright = STAGE_FROM_CAMERA @ np.diag([1.0, -1.0, -1.0])
        return np.asarray(self._rest + upright @ np.array(world.scenario.screen.pivot_m))

    def _followed(self, time_s: float, span_s: float) -> Array:
        return np.asarray(self._rest)

    def _spill_boxes(self, lit: Window | None) -> _Boxes:
        return _Boxes(None, None)  # all light stays inside the head


def audience_of(context: moderngl.Context, world: World, size: tuple[int, int] = SIZE) -> Audience:
    """The view that suits the world."""
    kind = Audience if world.mounted is None else RobotAudience
    return kind(context, world, size)
