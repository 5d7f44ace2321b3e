"""The cast: the characters of a show, loaded once, and their meshes for any moment."""

from __future__ import annotations

from collections.abc import Generator, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.errors import DataError
from hypermask.face.character import find_character, load_character
from hypermask.face.face import Face
from hypermask.face.life import LIFE, Life
from hypermask.geometry import Array
from hypermask.mask import Mask
from hypermask.stage.costume import Costume
from hypermask.stage.layers import Positions, dots_actor
from hypermask.stage.renderer import DrawItem, StageRenderer
from hypermask.workers.costumes import WORN

DOTS = "dots"
"""The test character: coloured dots at known points of the mask's surface."""

_MODEL = "."
"""Key of an actor that is never drawn: what all faces have in common is borrowed from it."""
_SPARE_SIZES = ((512, 512), (1024, 1024), (320, 112))


class Cast:
    """Loads characters into the renderer and gives what to draw of each.

    All faces move by the same rig on the same mask, so that one face's places are everybody's.
    """

    def __init__(self, sources: Mapping[str, str], mask: Mask, renderer: StageRenderer) -> None:
        """sources: name on the stage -> name or folder of the character; without any, `lend` comes
        first, and characters join one by one."""
        self._renderer = renderer
        self._names: list[str] = []
        self._dots: tuple[Positions, ...] = ()
        self._face: Face | None = None
        for name, source in sources.items():
            if source == DOTS:
                actor, self._dots = dots_actor(mask, _dots_texture())
                renderer.load(name, actor)
            else:
                face = Face(load_character(find_character(source)), mask)
                if self._face is None:
                    self._face = face
                    renderer.load(_MODEL, face.actor)
                for _ in renderer.dress(name, _MODEL, renderer.costume(face.actor, WORN)):
                    pass
            self._names.append(name)
        renderer.reserve(_SPARE_SIZES if self._face else ())
        self._first = self._names[0] if self._names else ""

    def lend(self, face: Face, common: Costume | None = None) -> None:
        """All who join are dressed on this face's mesh. common: its own costume, None where the
        renderer has it already. Not within a frame's time."""
        self._face = face
        if common is not None:
            self._renderer.load(_MODEL, face.actor, common)

    def reserve(self) -> None:
        """Have room for those who come during the show. Not within a frame's time."""
        self._renderer.reserve(_SPARE_SIZES)

    def adopt(self, name: str) -> None:
        """One whom the renderer has dressed already."""
        self._first = self._first or name
        if name not in self._names:
            self._names.append(name)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._names)

    def join(self, name: str, costume: Costume) -> Generator[None, None, None]:
        """Dress one more character, or an old one anew, a little at each step; after the last one
        it can be drawn. Raises `DataError` STAGE-KEY in a show without faces."""
        if self._face is None:
            raise DataError("STAGE-KEY", "this show has no faces", "Choose another character.")
        yield from self._renderer.dress(name, _MODEL, costume)
        self.adopt(name)

    def leave(self, name: str) -> None:
        """One that joined leaves."""
        if name in self._names and name != self._first:
            self._names.remove(name)
            self._renderer.unload(name)

    def items(
        self,
        wanted: list[tuple[str, float]],
        units: Array,
        mouth: Array,
        time_s: float,
        life: Life = LIFE,
    ) -> tuple[DrawItem, ...]:
        """What to draw of (name, opacity) at `time_s`: units (88,), mouth (13,).

        A name that is not there is left out and the others take its light; when none is there, the
        first of the cast plays.
        """
        known = [(name, opacity) for name, opacity in wanted if name in self._names]
        known = known or [(self._first, 1.0)] * bool(self._first)
        total = sum(opacity for _, opacity in known)
        places = self._pose(units, mouth, time_s, life)
        return tuple(
            DrawItem(name, self._dots if name == DOTS else places, opacity / total)
            for name, opacity in known
        )

    def dots(self) -> DrawItem:
        """The test character, which has no expression and no mouth."""
        return DrawItem(DOTS, self._dots, 1.0)

    def _pose(self, units: Array, mouth: Array, time_s: float, life: Life) -> tuple[Positions, ...]:
        if self._face is None:
            return ()
        return self._face.alive(time_s, None, mouth, units, life)


def _dots_texture() -> NDArray[np.uint8]:
    path = paths.configs() / "characters" / DOTS / "texture.png"
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise DataError("CHAR-READ", f"cannot read {path}", "Install hypermask again.")
    return np.ascontiguousarray(picture[..., ::-1], np.uint8)
