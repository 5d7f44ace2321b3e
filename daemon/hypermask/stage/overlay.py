"""What the operator's session screens need on top of the stage: a cross-hair and lines of text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask.stage import shaders
from hypermask.stage.renderer import uniform

Colour = tuple[float, float, float]

WHITE: Colour = (1.0, 1.0, 1.0)

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_KEPT_TEXTS = 32


@dataclass(frozen=True)
class Cross:
    """A cross-hair at `centre_px` (x, y), projector pixels, fractions count; origin in the centre
    of the top left pixel. half_length_px, half_width_px: of its arms;
    halves of whole numbers keep its centroid exact between pixels."""

    centre_px: tuple[float, float]
    half_length_px: float = 18.0
    half_width_px: float = 1.0
    colour: Colour = WHITE


class Overlay:
    """Draws over what a framebuffer of `size` (width, height) holds already."""

    def __init__(self, context: moderngl.Context, size: tuple[int, int]) -> None:
        self._context = context
        self._size = size
        self._texts: dict[tuple[str, int], moderngl.Texture] = {}
        with context:
            self._cross_program = context.program(shaders.OVERLAY_VERTEX, shaders.CROSS_FRAGMENT)
            self._text_program = context.program(shaders.OVERLAY_VERTEX, shaders.TEXT_FRAGMENT)
            self._cross_quad = context.vertex_array(self._cross_program, [])
            self._text_quad = context.vertex_array(self._text_program, [])

    def draw_cross(self, framebuffer: moderngl.Framebuffer, cross: Cross) -> None:
        """Anti-aliased, so that its centroid is `centre_px`. Nothing if that is not finite."""
        if not np.isfinite(cross.centre_px).all():
            return
        x, y = cross.centre_px[0] + 0.5, self._size[1] - 0.5 - cross.centre_px[1]
        reach = cross.half_length_px + 2
        with self._context:
            self._prepare(framebuffer)
            program = self._cross_program
            self._place(program, (x - reach, y - reach, 2 * reach, 2 * reach))
            uniform(program, "centre").value = (x, y)
            uniform(program, "half_extent").value = (cross.half_length_px, cross.half_width_px)
            uniform(program, "ink").value = cross.colour
            self._cross_quad.render(moderngl.TRIANGLE_STRIP, vertices=4)

    def draw_lines(
        self,
        framebuffer: moderngl.Framebuffer,
        lines: Sequence[str],
        top_left_px: tuple[int, int] = (24, 24),
        height_px: int = 22,
        colour: Colour = WHITE,
    ) -> None:
        """Lines of ASCII text, `height_px` from one capital's foot to its head."""
        with self._context:
            self._prepare(framebuffer)
            uniform(self._text_program, "ink").value = colour
            for row, line in enumerate(lines):
                if line.strip():
                    top = top_left_px[1] + round(row * 1.9 * height_px)
                    self._draw_line(line, height_px, top_left_px[0], top)

    def _draw_line(self, line: str, height_px: int, left: int, top: int) -> None:
        texture = self._text(line, height_px)
        width, height = texture.size
        self._place(self._text_program, (left, self._size[1] - top - height, width, height))
        texture.use(0)
        self._text_quad.render(moderngl.TRIANGLE_STRIP, vertices=4)

    def _prepare(self, framebuffer: moderngl.Framebuffer) -> None:
        framebuffer.viewport = (0, 0, *self._size)
        framebuffer.scissor = (0, 0, *self._size)
        framebuffer.use()
        framebuffer.color_mask = True, True, True, True
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_equation = moderngl.FUNC_ADD, moderngl.FUNC_ADD
        self._context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA

    def _place(self, program: moderngl.Program, box: tuple[float, float, float, float]) -> None:
        """box: left, bottom, width, height in window pixels."""
        width, height = self._size
        uniform(program, "box_ndc").value = (
            2 * box[0] / width - 1,
            2 * box[1] / height - 1,
            2 * box[2] / width,
            2 * box[3] / height,
        )

    def _text(self, line: str, height_px: int) -> moderngl.Texture:
        key = (line, height_px)
        if key not in self._texts:
            if len(self._texts) >= _KEPT_TEXTS:
                self._texts.pop(next(iter(self._texts))).release()
            picture = text_picture(line, height_px)
            size = (picture.shape[1], picture.shape[0])
            self._texts[key] = self._context.texture(size, 1, picture.tobytes(), alignment=1)
        return self._texts[key]


def text_picture(line: str, height_px: int) -> NDArray[np.uint8]:
    """(h, w) uint8: the line's ink, 0 to 255; row 0 is the top."""
    thickness = max(1, round(height_px / 11))
    scale = cv2.getFontScaleFromHeight(_FONT, height_px, thickness)
    (width, height), base = cv2.getTextSize(line, _FONT, scale, thickness)
    picture = np.zeros((height + base + 2 * thickness, width + 2 * thickness), np.uint8)
    foot = (thickness, height + thickness)
    cv2.putText(picture, line, foot, _FONT, scale, (255,), thickness, cv2.LINE_AA)
    return picture
