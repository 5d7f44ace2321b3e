"""Costumes that were made before: a character's textures as the GPU takes them, kept on disk.

`paths.home()/cache/costumes/KEY`, the key made from all that goes into a costume. Whoever finds a
costume missing may make it; on the appliance the dresser does, and the stage only where nobody did.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from hypermask import paths
from hypermask.errors import DataError
from hypermask.face.character import find_character, load_character
from hypermask.face.face import Face
from hypermask.mask import Mask
from hypermask.stage import costume as costumes
from hypermask.stage.costume import Costume, make_costume, read_costume, write_costume

WORN = ("skin", "eyes")
"""The layers whose textures differ from face to face; teeth, tongue and throat are everybody's."""
MODEL = "model"
_KEPT = 64
_PARTS = ("character.toml", "texture.png", "eyes.png")


def folder() -> Path:
    return paths.home() / "cache" / "costumes"


class Costumes:
    """The store for one projector's gamma."""

    def __init__(self, gamma: float) -> None:
        self._gamma = gamma

    def path(self, name: str) -> Path:
        """Where the costume of a character (or of `MODEL`) is, whether it is there or not.

        Raises `DataError` CHAR-ABSENT.
        """
        seal = hashlib.sha256(f"{costumes.VERSION} {self._gamma} {name == MODEL}".encode())
        source = _built_in() if name == MODEL else find_character(name)
        for part in _PARTS:
            with contextlib.suppress(OSError):
                seal.update((source / part).read_bytes())
        return folder() / seal.hexdigest()[:32]

    def find(self, name: str) -> Costume | None:
        """None where it was not made yet, or cannot be read. Raises `DataError` CHAR-ABSENT."""
        try:
            path = self.path(name)
            found = read_costume(path)
        except DataError as error:
            if error.code == "COSTUME-READ":
                return None
            raise
        with contextlib.suppress(OSError):
            os.utime(path)
        return found

    def sew(self, name: str, mask: Mask) -> bool:
        """Make and keep a character's costume where there is none; whether there was none.

        Raises `DataError` CHAR-*, `HypermaskError` DISK-WRITE.
        """
        if self.find(name) is not None:
            return False
        self.keep(name, self.make(name, mask))
        return True

    def make(self, name: str, mask: Mask) -> Costume:
        """Make a character's costume. Raises `DataError` CHAR-*."""
        return self.of_face(Face(load_character(find_character(name)), mask))

    def of_face(self, face: Face) -> Costume:
        return make_costume(face.actor.layers, self._gamma, WORN)

    def of_model(self, face: Face) -> Costume:
        """What all faces have in common, and a black dot for what each has of its own."""
        layers = face.actor.layers
        own = [layer.name not in WORN for layer in layers]
        made = make_costume(
            layers,
            self._gamma,
            [layer.name for layer, common in zip(layers, own, strict=True) if common],
        )
        dot = np.array([[[0, 0, 0, 255]]], np.uint8)
        bare = {number: (dot,) for number, common in enumerate(own) if not common}
        return replace(made, textures=made.textures | bare)

    def keep(self, name: str, costume: Costume) -> Path:
        """Raises `HypermaskError` DISK-WRITE."""
        path = self.path(name)
        write_costume(costume, path)
        for old in sorted(folder().iterdir(), key=_age)[:-_KEPT]:
            old.unlink(missing_ok=True)
        return path


def _built_in() -> Path:
    """The common parts come with the program; any built-in character stands for its version."""
    return paths.configs() / "characters" / "mean"


def _age(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
