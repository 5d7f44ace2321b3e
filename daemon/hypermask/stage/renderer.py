"""Draws actors on the mask: textured meshes through any projective map, mask-shaped, dark eyes.

The projected picture is light, so black is nothing, and a cross-fade is the sum of finished
pictures of the actors, each times its weight: two opaque actors never show what is behind them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.errors import DataError
from hypermask.stage import shaders
from hypermask.stage.clip import View, view_of
from hypermask.stage.costume import Costume, make_costume
from hypermask.stage.gpu_actor import SINGLE, GpuActor, GpuMesh
from hypermask.stage.layers import Actor, Positions
from hypermask.stage.textures import TextureStock

if TYPE_CHECKING:
    from hypermask.mask import Mask
    from hypermask.stage.settings import StageSettings

_OVER = (moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA)
_DARKEN = (moderngl.ZERO, moderngl.ONE_MINUS_SRC_ALPHA)
_ADD = (moderngl.ONE, moderngl.ONE)
_END = object()


@dataclass
class DrawItem:
    """key: a loaded actor; positions: (V, 3) float32 mask metres for each of its layers;
    opacity: its weight in 0..1. Weights that sum to more than 1 are scaled down to it."""

    key: str
    positions: tuple[Positions, ...]
    opacity: float = 1.0


class StageRenderer:
    """Owns what it has loaded into `context`; sets all GL state that it needs at each draw.

    size: (width, height) in pixels of the framebuffers to draw in.
    """

    def __init__(
        self,
        context: moderngl.Context,
        size: tuple[int, int],
        mask: Mask,
        settings: StageSettings | None = None,
        discs: NDArray[np.float32] | None = None,
        whole: bool = True,
    ) -> None:
        """discs: what `eye_discs` makes of the mask, where it is known already; whole: False where
        one actor alone is drawn until `complete`, which makes the shaders of cross-fades."""
        self._context = context
        self._size = size
        self._settings = settings or _default_settings()
        self._actors: dict[str, GpuActor] = {}
        self._stock = TextureStock(context)
        self._scratch: moderngl.Framebuffer | None = None
        self._reported = False
        self.discs = _eye_discs(mask, self._settings) if discs is None else discs
        with context:
            self._programs = [
                context.program(shaders.ACTOR_VERTEX, shaders.OPAQUE_FRAGMENT),
                context.program(shaders.ACTOR_VERTEX, shaders.TRANSPARENT_FRAGMENT),
            ]
            self._composite: moderngl.VertexArray | None = None
            self._disc_program = context.program(shaders.DISC_VERTEX, shaders.DISC_FRAGMENT)
            self._disc_array = self._upload_discs()
        for program in self._programs:
            self._set_outline(program, mask)
        if whole:
            self.complete(mask)

    def complete(self, mask: Mask) -> None:
        """The shaders that draw two actors at once, if they are not there yet. Not within a
        frame's time."""
        if self._composite is not None:
            return
        context = self._context
        with context:
            mixing = [
                context.program(shaders.ACTOR_VERTEX, shaders.OPAQUE_MIX_FRAGMENT),
                context.program(shaders.ACTOR_VERTEX, shaders.TRANSPARENT_MIX_FRAGMENT),
            ]
            self._composite = context.vertex_array(
                context.program(shaders.COMPOSITE_VERTEX, shaders.COMPOSITE_FRAGMENT), []
            )
            for mesh in {id(actor.mesh): actor.mesh for actor in self._actors.values()}.values():
                mesh.serve(mixing)
        for program in mixing:
            self._set_outline(program, mask)
            uniform(program, "other").value = 1
        self._programs += mixing

    @property
    def context(self) -> moderngl.Context:
        return self._context

    @property
    def frame_size(self) -> tuple[int, int]:
        """(width, height) in pixels of the framebuffers to draw in."""
        return self._size

    def load(self, key: str, actor: Actor, costume: Costume | None = None) -> None:
        """Send an actor to the GPU; one of the same key is replaced. Not within a frame's time.

        costume: of all its layers, where it is made already.
        """
        with self._context:
            costume = costume or self.costume(actor)
            mesh = GpuMesh(self._context, actor, self._programs)
            loaded = GpuActor(mesh, self._stock, costume)
            for _ in loaded.fill():
                pass
            self._put(key, loaded)

    def costume(self, actor: Actor, names: Sequence[str] | None = None) -> Costume:
        """The textures of an actor (of its layers in `names`) for `dress`."""
        return make_costume(actor.layers, self._settings.projector_gamma, names)

    def dress(self, key: str, like: str, costume: Costume) -> Iterator[None]:
        """Bring an actor with the mesh of the loaded one `like` to the GPU, little by little: a
        step takes a small part of a frame's time, frames may be drawn between the steps, and the
        last step puts it on the stage; one of the same key is then replaced. `like` must stay.
        """
        with self._context:
            model = self._actors[like]
            dressed = GpuActor(model.mesh, self._stock, costume, model)
        steps, more = dressed.fill(), True
        try:
            while more:
                with self._context:
                    more = next(steps, _END) is not _END
                yield
        except BaseException:
            with self._context:
                dressed.release()
            raise
        self._put(key, dressed)

    def reserve(self, sizes: Iterable[tuple[int, int]]) -> None:
        """Have spare textures (width, height) for `dress`. Not within a frame's time."""
        with self._context:
            for size in sizes:
                self._stock.reserve(size)

    def _put(self, key: str, actor: GpuActor) -> None:
        self.unload(key)
        self._actors[key] = actor

    def unload(self, key: str) -> None:
        actor = self._actors.pop(key, None)
        if actor is not None:
            with self._context:
                actor.release()

    @property
    def loaded(self) -> tuple[str, ...]:
        return tuple(self._actors)

    def draw(
        self,
        framebuffer: moderngl.Framebuffer,
        projector_from_mask: ArrayLike,
        items: Sequence[DrawItem],
        brightness: float = 1.0,
    ) -> None:
        """Draw the whole frame; black where no actor is.

        projector_from_mask: (3, 4) from mask metres to projector pixels (origin in the centre of
        the top left pixel), any scale; brightness: 0..1, times every pixel value.
        Raises `DataError` STAGE-KEY, STAGE-MESH, and the frame is black. Numbers that are not
        finite give a black frame too, and STAGE-NAN for the first of such frames in a row.
        """
        with self._context:
            self._clear(framebuffer)  # first, so that after any error the frame is black
            visible = self._visible(items, brightness)
            if not visible:
                return
            parts = [part for item in visible for part in item.positions]
            if len(self.discs):
                parts.append(self.discs[:, :3])
            try:
                lights = [brightness, *(item.opacity for item in visible)]
                if not np.isfinite(lights).all():
                    raise ValueError("not finite")
                view = view_of(projector_from_mask, np.concatenate(parts), self._size)
            except ValueError:
                self._report()
                return
            self._reported = False
            if view is not None:
                self._draw_view(framebuffer, view, visible, brightness)

    def draw_black(self, framebuffer: moderngl.Framebuffer) -> None:
        with self._context:
            self._clear(framebuffer)

    def release(self) -> None:
        for key in self.loaded:
            self.unload(key)
        with self._context:
            self._stock.release()

    def _visible(self, items: Sequence[DrawItem], brightness: float) -> list[DrawItem]:
        for item in items:
            if item.key not in self._actors:
                raise DataError(
                    "STAGE-KEY",
                    f"the actor '{item.key}' is not on the stage",
                    "Load it before it is drawn.",
                )
            self._actors[item.key].mesh.check(item.key, item.positions)
        if brightness <= 0:
            return []
        total = max(1.0, sum(item.opacity for item in items if item.opacity > 0))
        return [
            DrawItem(item.key, item.positions, item.opacity / total)
            for item in items
            if not item.opacity <= 0
        ]

    def _report(self) -> None:
        if not self._reported:
            self._reported = True
            raise DataError(
                "STAGE-NAN",
                "the face or its place on the mask came as numbers that are not finite",
                "The stage stays black until they are; look at the tracking and the calibration.",
            )

    def _clear(
        self, framebuffer: moderngl.Framebuffer, size: tuple[int, int] | None = None
    ) -> None:
        whole = (0, 0, *(size or self._size))
        framebuffer.scissor = whole
        framebuffer.depth_mask = True
        framebuffer.color_mask = True, True, True, True
        framebuffer.viewport = whole
        framebuffer.use()
        framebuffer.clear(0.0, 0.0, 0.0, 1.0)
        self._context.blend_equation = moderngl.FUNC_ADD, moderngl.FUNC_ADD

    def _draw_view(
        self,
        framebuffer: moderngl.Framebuffer,
        view: View,
        items: Sequence[DrawItem],
        brightness: float,
    ) -> None:
        matrix = np.ascontiguousarray(view.matrix.T).tobytes()
        framebuffer.scissor = view.box
        framebuffer.use()
        groups = self._groups(items)
        self._draw_group(groups[0], matrix, brightness)
        for group in groups[1:]:
            scratch = self._scratch_framebuffer()
            scratch.clear(0.0, 0.0, 0.0, 0.0, viewport=view.box)
            scratch.scissor = view.box
            scratch.use()
            self._draw_group(group, matrix, brightness)
            framebuffer.use()
            self._add(scratch)
        self._draw_discs(matrix)
        framebuffer.scissor = (0, 0, *self._size)

    def _groups(self, items: Sequence[DrawItem]) -> list[list[DrawItem]]:
        """Items one by one, or two by two where they differ by their textures alone: one pass
        over the mesh then draws both, so that a cross-fade costs hardly more than a face."""
        groups: list[list[DrawItem]] = []
        for item in items:
            last = groups[-1] if groups else []
            alike = len(last) == 1 and self._alike(last[0], item)
            if alike:
                last.append(item)
            else:
                groups.append([item])
        return groups

    def _alike(self, one: DrawItem, other: DrawItem) -> bool:
        same_places = all(a is b for a, b in zip(one.positions, other.positions, strict=False))
        return same_places and self._actors[one.key].mixes_with(self._actors[other.key])

    def _draw_group(self, group: Sequence[DrawItem], matrix: bytes, brightness: float) -> None:
        actors = [self._actors[item.key] for item in group]
        lights = [
            min(brightness, 1.0) * item.opacity * self._light_factor(actor)
            for item, actor in zip(group, actors, strict=True)
        ]
        context = self._context
        context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        context.depth_func = "<="
        context.blend_func = _OVER
        single = len(group) == 1
        for program in self._programs[:SINGLE] if single else self._programs[SINGLE:]:
            uniform(program, "clip_from_mask").write(matrix)
            name, value = ("light", lights[0]) if single else ("lights", tuple(lights))
            uniform(program, name).value = value
        actors[0].mesh.stream(group[0].positions)
        actors[0].render(None if single else actors[1])

    def _light_factor(self, actor: GpuActor) -> float:
        """What pixel values are multiplied by, so that peak and mean light keep their limits."""
        settings = self._settings
        allowed = settings.mean_light_limit / max(actor.mean_light, 1e-6)
        light = min(settings.brightness_limit, allowed)
        return float(light ** (1 / settings.projector_gamma))

    def _add(self, scratch: moderngl.Framebuffer) -> None:
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = _ADD
        picture = scratch.color_attachments[0]
        assert isinstance(picture, moderngl.Texture)
        picture.use(0)
        assert self._composite is not None
        self._composite.render(moderngl.TRIANGLES, vertices=3)

    def _draw_discs(self, matrix: bytes) -> None:
        if self._disc_array is None:
            return
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = _DARKEN
        uniform(self._disc_program, "clip_from_mask").write(matrix)
        self._disc_array.render(moderngl.TRIANGLES, vertices=len(self.discs))

    def _upload_discs(self) -> moderngl.VertexArray | None:
        if not len(self.discs):
            return None
        buffer = self._context.buffer(self.discs.tobytes())
        return self._context.vertex_array(self._disc_program, [(buffer, "4f", "in_vertex")])

    def _scratch_framebuffer(self) -> moderngl.Framebuffer:
        if self._scratch is None:
            self._scratch = self._context.framebuffer(
                [self._context.texture(self._size, 4)],
                self._context.depth_renderbuffer(self._size),
            )
        return self._scratch

    def _set_outline(self, program: moderngl.Program, mask: Mask) -> None:
        outline = mask.settings.outline
        width, height, n = outline.half_width_m, outline.half_height_m, outline.exponent
        begin = 1 - self._settings.outline_soft_m / min(width, height)
        uniform(program, "outline").value = (1 / width, 1 / height, n)
        uniform(program, "soft_scale").value = 1 / (1 - begin**n)


def uniform(program: moderngl.Program, name: str) -> moderngl.Uniform:
    member = program[name]
    assert isinstance(member, moderngl.Uniform)
    return member


def _default_settings() -> StageSettings:
    """What needs these modules is loaded when it is used: a stage that starts has no time."""
    from hypermask.stage.settings import StageSettings

    return StageSettings()


def _eye_discs(mask: Mask, settings: StageSettings) -> NDArray[np.float32]:
    from hypermask.stage.eye_discs import eye_discs

    return eye_discs(mask, settings)
