"""What the audience sees: the mask in a dim theatre, with the projector's light on it.

The light goes from the true projector on to the true relief at the true pose; what misses the mask
falls on the figure's dark clothes and on the curtain behind. Nothing of the program's own idea of
the scene enters. Stage axes: x to the audience's right, y up, z to the audience.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask_sim import audience_scene as scene
from hypermask_sim import audience_shaders as shaders
from hypermask_sim.judge import DARK_LEVEL, Truth
from hypermask_sim.lens import projector_from_mask

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

STAGE_FROM_CAMERA: Array = np.diag([1.0, -1.0, -1.0])
SIZE = (960, 720)
VIEW_HEIGHT_M = 0.58  # what the picture's height spans at the figure's place
BESIDE_M = 0.42  # the eye, to the right of the cart's camera
ABOVE_M = 0.16
FOLLOW_S = 0.7  # the eye follows the figure as slowly as a camera operator
NECK = (0.0, -0.115, -0.085)  # in the mask frame
FIGURE_DEPTH_M = 0.25  # to either side of the neck
CURTAIN_BEHIND_M = 1.5
HOOD_WIDER = 1.2  # than the mask
EYE_LEVEL_M = 1.62  # of the figure's mask above the floor
LAMP_GAIN_AT_REST = 0.95
KEY_LIGHT = (-0.55, 0.75, 0.45)
RIM_LIGHT = (0.65, 0.55, -0.65)


Box = tuple[int, int, int, int]  # x, y, width, height
Window = tuple[int, int, int, int]  # left, top, right, bottom


@dataclass(frozen=True)
class _Boxes:
    """Window boxes (x, y, width, height), None where no light can fall."""

    figure: Box | None
    curtain: Box | None


class Theatre(Truth, Protocol):
    """What the view must know of the world (`hypermask_sim.world.World`)."""

    @property
    def rest(self) -> Array: ...
    def camera_from_masks(self, times_s: Array, /) -> tuple[Array, Array]: ...


class Audience:
    """Renders with a GLES 3.0 `context`, which may be shared: all state it needs it sets."""

    def __init__(
        self, context: moderngl.Context, world: Theatre, size: tuple[int, int] = SIZE
    ) -> None:
        self._context = context
        self._world = world
        self._size = size
        self._rest = STAGE_FROM_CAMERA @ np.asarray(world.rest, float)
        self._uploaded = (0, 0)
        self._lamp_gain = LAMP_GAIN_AT_REST * float(self._rest @ self._rest)
        with context:
            self._build()

    def render(self, picture: Picture, light_s: float) -> Picture:
        """The view (height, width, 3) RGB, row 0 at the top, when `picture`'s light arrives.

        picture: the projector's frame (h, w, 3) uint8 RGB, row 0 at the top.
        """
        with self._context:
            lit = lit_window(picture)
            self._upload(picture, lit)
            self._place(light_s)
            self._draw(self._spill_boxes(lit))
            data = self._framebuffer.read(components=4)
        pixels = np.frombuffer(data, np.uint8).reshape(self._size[1], self._size[0], 4)
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGBA2RGB), np.uint8)

    def close(self) -> None:
        with self._context:
            for resource in reversed(self._resources):
                resource.release()
        self._resources.clear()

    # Objects -----------------------------------------------------------------------------------

    def _build(self) -> None:
        context, mask = self._context, self._world.mask
        self._resources: list[Any] = []
        self._picture = self._texture(np.zeros((*self._world.projector.size[::-1], 3), np.uint8))
        self._skin = self._texture(scene.skin(mask))
        self._curtain_paint = self._texture(scene.paint_curtain())
        self._floor_paint = self._texture(scene.paint_floor())
        target = self._keep(context.texture(self._size, 4))
        depth = self._keep(context.depth_renderbuffer(self._size))
        self._framebuffer = self._keep(context.framebuffer([target], depth))

        face = self._face_program()
        cloth = [
            self._program(shaders.CLOTH_VERTEX, fragment)
            for fragment in (shaders.CLOTH_FRAGMENT, shaders.CLOTH_SPILL_FRAGMENT)
        ]
        backdrop = [
            self._program(shaders.BACKDROP_VERTEX, fragment)
            for fragment in (shaders.BACKDROP_FRAGMENT, shaders.BACKDROP_SPILL_FRAGMENT)
        ]
        depth_only = self._program(shaders.FACE_VERTEX, shaders.DEPTH_FRAGMENT)
        self._programs = (face, depth_only, *cloth, *backdrop)
        self._face = self._face_mesh(face)
        (self._face_depth,) = self._mesh([depth_only], scene.mask_mesh(mask, within=0.97))
        self._rim, _ = self._mesh(cloth, scene.mask_rim(mask))
        self._build_figure(cloth)
        self._floor, _ = self._mesh(backdrop, scene.floor_mesh())
        self._curtain, self._curtain_lit = self._mesh(backdrop, scene.curtain_mesh())
        outline = mask.settings.outline
        shape = (1 / outline.half_width_m, 1 / outline.half_height_m, outline.exponent)
        self._set(outline=shape, lamp_gain=self._lamp_gain, half_size=mask.half_size_m)
        # Past the mask the hood round it stops the light as well.
        backdrop[1]["outline"].value = (shape[0] / HOOD_WIDER, shape[1] / HOOD_WIDER, shape[2])
        self._set(picture=0, skin=1, painting=2)

    def _face_program(self) -> Any:
        return self._program(shaders.FACE_VERTEX, shaders.FACE_FRAGMENT)

    def _face_mesh(self, program: Any) -> Any:
        return self._mesh([program], scene.mask_mesh(self._world.mask))[0]

    def _build_figure(self, cloth: list[Any]) -> None:
        self._hood, self._hood_lit = self._mesh(cloth, scene.hood(self._world.mask))
        self._cloak, self._cloak_lit = self._mesh(cloth, scene.cloak())

    def _keep(self, resource: Any) -> Any:
        self._resources.append(resource)
        return resource

    def _texture(self, image: NDArray[np.uint8]) -> Any:
        height, width, channels = image.shape
        texture = self._keep(
            self._context.texture((width, height), channels, image.tobytes(), alignment=1)
        )
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return texture

    def _upload(self, picture: Picture, lit: Window | None) -> None:
        """Only the rows that are lit or were in the picture before."""
        rows = (lit[1], lit[3]) if lit is not None else (0, 0)
        spans = [span for span in (rows, self._uploaded) if span[1] > span[0]]
        self._uploaded = rows
        if spans:
            top, bottom = min(span[0] for span in spans), max(span[1] for span in spans)
            band = np.ascontiguousarray(picture[top:bottom])
            box = (0, top, picture.shape[1], bottom - top)
            self._picture.write(band, viewport=box, alignment=1)

    def _program(self, vertex: str, fragment: str) -> Any:
        return self._keep(self._context.program(vertex_shader=vertex, fragment_shader=fragment))

    def _mesh(self, programs: list[Any], mesh: scene.Mesh) -> list[Any]:
        """One vertex array for each program, over the same buffers."""
        vertices = self._keep(self._context.buffer(mesh.vertices.tobytes()))
        triangles = self._keep(self._context.buffer(mesh.triangles.tobytes()))
        layout = {
            3: ("3f", "in_position"),
            5: ("3f 2f", "in_position", "in_uv"),
            6: ("3f 3f", "in_position", "in_normal"),
        }[mesh.vertices.shape[1]]
        return [
            self._keep(self._context.vertex_array(p, [(vertices, *layout)], triangles, 4))
            for p in programs
        ]

    def _set(self, **values: Any) -> None:
        """Set uniforms by name in every program that has them; arrays (4, 4) as matrices."""
        for program in self._programs:
            for name, value in values.items():
                if name not in program:
                    continue
                if isinstance(value, np.ndarray) and value.shape == (4, 4):
                    program[name].write(value.T.astype("f4").tobytes())
                else:
                    program[name].value = tuple(value) if np.ndim(value) else value

    # Geometry ----------------------------------------------------------------------------------

    def _place(self, time_s: float) -> None:
        """All uniforms that depend on where the mask is."""
        rotation, translation = self._world.camera_from_mask(time_s)
        stage_from_mask = _rigid(STAGE_FROM_CAMERA @ rotation, STAGE_FROM_CAMERA @ translation)
        self._mask_from_stage = np.linalg.inv(stage_from_mask)
        to_mask = self._mask_from_stage[:3, :3]
        view, eye = self._view(time_s)
        optics = self._world.projector
        from_mask = _rigid(*projector_from_mask(self._world, time_s))
        lamp = np.linalg.inv(from_mask)[:3, 3]
        self._clip_from_stage = self._lens() @ view
        self._set(
            clip_from_mask=self._clip_from_stage @ stage_from_mask,
            picture_from_mask=_picture_matrix(optics.K, optics.size) @ from_mask,
            lamp=lamp,
            eye=(self._mask_from_stage @ np.append(eye, 1))[:3],
            key=to_mask @ _unit(KEY_LIGHT),
            rim=to_mask @ _unit(RIM_LIGHT),
            facing=to_mask[:, 2],
        )
        self._neck = (stage_from_mask @ [*NECK, 1])[:3]

    def _followed(self, time_s: float, span_s: float) -> Array:
        """The mask's mean place around a time, stage axes."""
        times = time_s + np.linspace(-span_s, span_s, 9)
        weights = np.cos(np.linspace(-1.3, 1.3, 9))
        _, places = self._world.camera_from_masks(times)
        mean: Array = weights @ places / weights.sum() @ STAGE_FROM_CAMERA.T
        return mean

    def _view(self, time_s: float) -> tuple[Array, Array]:
        """(eye_from_stage (4, 4), eye (3,)): beside the cart, turned to the figure."""
        aim = self._followed(time_s, FOLLOW_S) + np.array([0, -0.035, 0])
        eye = np.array([BESIDE_M, self._rest[1] * 0.6 + ABOVE_M, 0.0])
        back = _unit(eye - aim)
        right = _unit(np.cross([0, 1, 0], back))
        rotation = np.stack([right, np.cross(back, right), back])
        return _rigid(rotation, -rotation @ eye), eye

    def _lens(self) -> Array:
        """Clip from eye; y points down in the picture, so that row 0 of a read-back is the top."""
        eye = np.array([BESIDE_M, self._rest[1] * 0.6 + ABOVE_M, 0.0])
        distance = float(np.linalg.norm(eye - self._rest))
        scale = 2 * distance / VIEW_HEIGHT_M
        near, far = 0.2, 12.0
        matrix = np.zeros((4, 4))
        matrix[0, 0] = scale * self._size[1] / self._size[0]
        matrix[1, 1] = -scale
        matrix[2, 2:] = (near + far) / (near - far), 2 * near * far / (near - far)
        matrix[3, 2] = -1
        return matrix

    # Drawing -----------------------------------------------------------------------------------

    def _draw(self, boxes: _Boxes) -> None:
        """Near things first, so that little is shaded twice; the mask's soft edge comes last."""
        context, framebuffer = self._context, self._framebuffer
        framebuffer.use()
        framebuffer.viewport = (0, 0, *self._size)
        framebuffer.scissor = None
        framebuffer.depth_mask = True
        framebuffer.color_mask = (True, True, True, True)
        framebuffer.clear(0.01, 0.01, 0.015, 1.0, depth=1.0)
        self._picture.use(0)
        self._skin.use(1)
        context.disable(moderngl.BLEND | moderngl.CULL_FACE)
        context.enable(moderngl.DEPTH_TEST)
        context.depth_func = "<="
        framebuffer.color_mask = (False, False, False, False)
        self._face_depth.render()
        framebuffer.color_mask = (True, True, True, True)
        self._draw_figure(boxes)
        self._draw_backdrop(boxes)
        context.enable(moderngl.BLEND)
        context.blend_equation = (moderngl.FUNC_ADD, moderngl.FUNC_ADD)
        context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._face.render()
        context.disable(moderngl.DEPTH_TEST | moderngl.BLEND)

    def _draw_backdrop(self, boxes: _Boxes) -> None:
        origin = self._rest + np.array([0, -EYE_LEVEL_M, -CURTAIN_BEHIND_M])
        place = _rigid(np.eye(3), origin)
        self._set(mask_from_model=self._mask_from_stage @ place)
        if self._sees_floor(origin):
            self._floor_paint.use(2)
            self._floor.render()
        self._curtain_paint.use(2)
        self._curtain.render()
        self._within(boxes.curtain, self._curtain_lit)

    def _draw_figure(self, boxes: _Boxes) -> None:
        self._set(albedo=(0.30, 0.30, 0.30), mask_from_model=np.eye(4))
        self._rim.render()
        self._context.front_face = "cw"  # they are ccw, but the view is drawn upside down
        self._context.enable(moderngl.CULL_FACE)
        self._set(albedo=(0.105, 0.100, 0.112))
        self._hood.render()
        self._within(boxes.figure, self._hood_lit)
        neck = _rigid(np.eye(3), self._neck)
        self._set(mask_from_model=self._mask_from_stage @ neck)
        self._cloak.render()
        self._within(boxes.figure, self._cloak_lit)
        self._context.disable(moderngl.CULL_FACE)
        self._context.front_face = "ccw"

    def _sees_floor(self, origin: Array) -> bool:
        """Whether the floor's far edge, behind everything, is above the picture's lower edge."""
        half = scene.CURTAIN_SIZE_M[0] / 2
        edge = self._window(origin + np.array([[-half, 0, 0], [half, 0, 0]]))
        return bool(edge[:, 1].min() < self._size[1])

    def _within(self, box: Box | None, mesh: Any) -> None:
        if box is not None:
            self._framebuffer.scissor = box
            mesh.render()
            self._framebuffer.scissor = None

    def _spill_boxes(self, lit: Window | None) -> _Boxes:
        """Where in the view the picture's lit part can fall on the figure and the curtain."""
        if lit is None:
            return _Boxes(None, None)
        left, top, right, bottom = lit
        optics = self._world.projector
        corners = np.array([[x, y, 1] for x in (left, right) for y in (top, bottom)])
        rays = np.linalg.solve(optics.K, corners.T).T @ optics.R @ STAGE_FROM_CAMERA.T
        curtain = self._rest[2] - CURTAIN_BEHIND_M
        return _Boxes(
            self._box(rays, (self._neck[2] - FIGURE_DEPTH_M, self._neck[2] + FIGURE_DEPTH_M)),
            self._box(rays, (curtain,)),
        )

    def _box(self, rays: Array, depths: tuple[float, ...]) -> Box | None:
        """Window box (x, y, width, height) round where the rays cross these stage depths."""
        optics = self._world.projector
        lamp = STAGE_FROM_CAMERA @ (-optics.R.T @ np.asarray(optics.t).reshape(3))
        ways = (np.array(depths)[:, None] - lamp[2]) / np.minimum(rays[:, 2], -1e-3)
        if np.any(ways <= 0):
            return None
        window = self._window((lamp + rays * ways[..., None]).reshape(-1, 3))
        low = np.clip(np.floor(window.min(0)), 0, self._size).astype(int)
        width, height = np.clip(np.ceil(window.max(0)), 0, self._size).astype(int) - low
        return (int(low[0]), int(low[1]), int(width), int(height)) if width and height else None

    def _window(self, points: Array) -> Array:
        clip = np.column_stack([points, np.ones(len(points))]) @ self._clip_from_stage.T
        ndc = clip[:, :2] / clip[:, 3:]
        window: Array = (ndc + 1) / 2 * self._size
        return window


def lit_window(picture: Picture) -> Window | None:
    """(left, top, right, bottom) round all pixels that are not black; None for a black picture."""
    rows = np.flatnonzero(picture.reshape(len(picture), -1).max(axis=1) > DARK_LEVEL)
    if not len(rows):
        return None
    top, bottom = int(rows[0]), int(rows[-1]) + 1
    columns = np.flatnonzero(picture[top:bottom].max(axis=0).max(axis=1) > DARK_LEVEL)
    return int(columns[0]), top, int(columns[-1]) + 1, bottom


def _rigid(rotation: Array, translation: Array) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation
    return matrix


def _unit(vector: Any) -> Array:
    array = np.asarray(vector, float)
    unit: Array = array / np.linalg.norm(array)
    return unit


def _picture_matrix(matrix: Array, size: tuple[int, int]) -> Array:
    """Texture coordinates (u w, v w, w) from projector metres; texel centres at (i + 0.5) / n."""
    to_uv = np.array([[1 / size[0], 0, 0.5 / size[0]], [0, 1 / size[1], 0.5 / size[1]], [0, 0, 1]])
    picture = np.zeros((4, 4))
    picture[:3, :3] = to_uv @ np.asarray(matrix)
    picture[3, 3] = 1
    return picture
