"""The cast: the characters of a show, loaded once, and their meshes for any moment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import cv2
import numpy as np

from hypermask import paths
from hypermask.errors import DataError
from hypermask.face.character import find_character, load_character
from hypermask.face.face import Face
from hypermask.geometry import Array
from hypermask.mask import Mask
from hypermask.stage.layers import Actor, Positions, dots_actor
from hypermask.stage.renderer import DrawItem, StageRenderer

DOTS = "dots"
"""The test character: coloured dots at known points of the mask's surface."""


class Player(Protocol):
    """A character that can be drawn: its meshes and where their vertices are."""

    @property
    def actor(self) -> Actor: ...

    def positions(
        self, expression: Array, mouth: Array, time_s: float
    ) -> tuple[Positions, ...]: ...


class DotsPlayer:
    """The test character; it has no expression and no mouth."""

    def __init__(self, mask: Mask) -> None:
        path = paths.configs() / "characters" / DOTS / "texture.png"
        picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if picture is None:
            raise DataError("CHAR-READ", f"cannot read {path}", "Install hypermask again.")
        texture = np.ascontiguousarray(picture[..., ::-1], np.uint8)
        self.actor, self._positions = dots_actor(mask, texture)

    def positions(self, expression: Array, mouth: Array, time_s: float) -> tuple[Positions, ...]:
        return self._positions


class FacePlayer:
    """A character made from a photograph."""

    def __init__(self, name: str, mask: Mask) -> None:
        self._face = Face(load_character(find_character(name)), mask)

    @property
    def actor(self) -> Actor:
        return self._face.actor

    def positions(self, expression: Array, mouth: Array, time_s: float) -> tuple[Positions, ...]:
        return self._face.alive(time_s, expression, mouth)


class Cast:
    """Loads characters into the renderer and gives what to draw of each."""

    def __init__(self, sources: Mapping[str, str], mask: Mask, renderer: StageRenderer) -> None:
        """sources: name on the stage -> name or folder of the character."""
        self._players: dict[str, Player] = {}
        for name, source in sources.items():
            player: Player = DotsPlayer(mask) if source == DOTS else FacePlayer(source, mask)
            renderer.load(name, player.actor)
            self._players[name] = player

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._players)

    def item(
        self, name: str, opacity: float, expression: Array, mouth: Array, time_s: float
    ) -> DrawItem:
        """One character at `time_s`: expression (6,) emotion weights, mouth (13,) parameters."""
        positions = self._players[name].positions(expression, mouth, time_s)
        return DrawItem(name, positions, opacity)
