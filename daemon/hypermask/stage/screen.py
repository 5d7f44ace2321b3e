"""Drawing on a face-shaped screen that is lit from behind through a fisheye lens.

No projective map does that, so there are two passes. The first draws the characters as the
audience in front sees them, flat: a picture over the screen's x and y, in which what lies nearer to
the audience hides what is behind it. (Drawn straight through the lens, from behind, the eyeballs
would hide the lids.) The second lays that picture on a fine mesh of the screen's relief, whose
corners were taken through the calibrated lens once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import moderngl
import numpy as np
from numpy.typing import ArrayLike

from hypermask.errors import DataError
from hypermask.geometry import Array
from hypermask.mask import Mask
from hypermask.stage import shaders
from hypermask.stage.layers import relief_mesh
from hypermask.stage.renderer import DrawItem, StageRenderer, uniform
from hypermask.stage.settings import StageSettings

PICTURE_PX_PER_M = 3000
"""As fine as a projector of 1280 x 800 pixels lights the screen's middle."""
MESH_M = 0.004
_DIM_QUANTILE = 0.1
"""Where even light is asked for, this part of the screen keeps all the light it gets."""


class FixedCalibration(Protocol):
    @property
    def size(self) -> tuple[int, int]:
        """Of the projector's picture (width, height) that it is for."""
        ...

    def project(self, points: ArrayLike, /) -> Array: ...
    def density(self, points: ArrayLike, normals: ArrayLike, /) -> Array: ...


def flat_matrix(mask: Mask) -> tuple[Array, tuple[int, int]]:
    """(3, 4) from mask metres to the flat picture's pixels, and its size (width, height)."""
    half_width, half_height = mask.half_size_m
    size = (round(2 * half_width * PICTURE_PX_PER_M), round(2 * half_height * PICTURE_PX_PER_M))
    scale = PICTURE_PX_PER_M
    matrix = np.array(
        [
            [scale, 0, 0, (size[0] - 1) / 2],
            [0, -scale, 0, (size[1] - 1) / 2],
            [0, 0, 0, 1.0],
        ]
    )
    return matrix, size


class ScreenMapping:
    """The stage's mapping of a fixed screen: always the flat picture."""

    def __init__(self, mask: Mask) -> None:
        self._matrix, _ = flat_matrix(mask)

    def at(self, light_s: float) -> Array:
        return self._matrix


class ScreenRenderer(StageRenderer):
    """A `StageRenderer` whose pictures go through a calibrated lens on to their screen.

    size: of the projector's framebuffers; draw with the matrix of `ScreenMapping`.
    """

    def __init__(
        self,
        context: moderngl.Context,
        size: tuple[int, int],
        mask: Mask,
        calibration: FixedCalibration,
        settings: StageSettings | None = None,
    ) -> None:
        matrix, flat = flat_matrix(mask)
        super().__init__(context, flat, mask, settings)
        self._projector_size = size
        positions, triangles = relief_mesh(mask, MESH_M)
        self._places = positions.astype(float)
        flat_px = self._places @ matrix[:2, :3].T + matrix[:2, 3]
        self._uv = np.column_stack(
            [(flat_px[:, 0] + 0.5) / flat[0], 1 - (flat_px[:, 1] + 0.5) / flat[1]]
        )
        slope_m = 1e-3
        x, y = self._places[:, 0], self._places[:, 1]
        slopes = [
            (mask.height(x + dx, y + dy) - mask.height(x - dx, y - dy)) / (2 * slope_m)
            for dx, dy in ((slope_m, 0.0), (0.0, slope_m))
        ]
        normals = np.column_stack([-slopes[0], -slopes[1], np.ones(len(x))])
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        with context:
            self._flat = context.texture(flat, 4)
            self._flat.filter = (moderngl.LINEAR, moderngl.LINEAR)
            self._flat.repeat_x = self._flat.repeat_y = False
            self._flat_buffer = context.framebuffer([self._flat], context.depth_renderbuffer(flat))
            self._lens_program = context.program(shaders.LENS_VERTEX, shaders.LENS_FRAGMENT)
            self._corners = context.buffer(reserve=len(positions) * 5 * 4)
            indices = context.buffer(triangles.astype(np.uint32).tobytes())
            content = [(self._corners, "2f 2f 1f", "in_ndc", "in_uv", "in_light")]
            self._screen = context.vertex_array(self._lens_program, content, index_buffer=indices)
        uniform(self._lens_program, "flat_picture").value = 0
        if not self.bend(calibration):
            raise DataError(
                "CAL-CART",
                f"the calibration is for a picture of {calibration.size[0]} x "
                f"{calibration.size[1]} pixels, the projector's has {size[0]} x {size[1]}",
                "Correct [optics.projector], then calibrate this head.",
            )

    @property
    def frame_size(self) -> tuple[int, int]:
        return self._projector_size

    def bend(self, calibration: FixedCalibration) -> bool:
        """Draw through another calibration from the next frame on, which takes some milliseconds;
        False, and nothing changes, where it is for pictures of another size."""
        width, height = self._projector_size
        if calibration.size != (width, height):
            return False
        pixels = calibration.project(self._places)
        ndc = np.column_stack(
            [(pixels[:, 0] + 0.5) / width * 2 - 1, 1 - (pixels[:, 1] + 0.5) / height * 2]
        )
        light = self._evened(calibration.density(self._places, self._normals))
        corners = np.column_stack([ndc, self._uv, light]).astype(np.float32)
        if not np.isfinite(corners).all():
            return False
        with self._context:
            self._corners.write(corners.tobytes())
        return True

    def _evened(self, density: Array) -> Array:
        """(V,) what pixel values are multiplied by, against the light that falls off outwards."""
        share = self._settings.even_light
        dim = np.quantile(density, _DIM_QUANTILE)
        light = np.minimum(dim / np.maximum(density, 1e-9), 1.0) ** share
        return np.asarray(light ** (1 / self._settings.projector_gamma))

    def draw(
        self,
        framebuffer: moderngl.Framebuffer,
        projector_from_mask: ArrayLike,
        items: Sequence[DrawItem],
        brightness: float = 1.0,
    ) -> None:
        self.draw_black(framebuffer)  # first, so that after any error the frame is black
        super().draw(self._flat_buffer, projector_from_mask, items, brightness)
        with self._context:
            framebuffer.use()
            framebuffer.viewport = (0, 0, *self._projector_size)
            framebuffer.scissor = (0, 0, *self._projector_size)
            self._context.enable_only(moderngl.NOTHING)
            self._flat.use(0)
            self._screen.render(moderngl.TRIANGLES)

    def draw_black(self, framebuffer: moderngl.Framebuffer) -> None:
        with self._context:
            self._clear(framebuffer, self._projector_size)

    def release(self) -> None:
        super().release()
        with self._context:
            for resource in (self._screen, self._corners, self._flat_buffer, self._flat):
                resource.release()
