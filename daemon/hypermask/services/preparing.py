"""Preparing the stage's next start while this show plays; see `overture`. The dresser does it, for
writing to a disk takes longer than a flip."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.calibration import storage
from hypermask.calibration.parameters import ProCam
from hypermask.errors import ConfigError, DataError, HypermaskError
from hypermask.face.character import find_character, load_character
from hypermask.face.face import Face
from hypermask.machine.devices import device_settings
from hypermask.machine.files import etc, last_good_path, layer_paths
from hypermask.machine.places import mask_folder
from hypermask.services import overture, prepared
from hypermask.services.playbill import playable_show, show_path
from hypermask.services.rig import Rig, nominal_projector
from hypermask.show.scene import SCENE
from hypermask.show.showfile import ShowFile
from hypermask.stage.eye_discs import eye_discs
from hypermask.workers.board import TRACK
from hypermask.workers.costumes import MODEL, Costumes
from hypermask.workers.retry import Report

LOOK_S = 5.0
LONGEST_S = 80.0
"""Between two attempts while the disk is full: each sews a costume for nothing."""


class Preparing:
    """One step at a time: a costume that is missing, then the overture."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._store = Costumes(rig.machine.stage.projector_gamma)
        self._inputs: list[list[Any]] | None = None
        self._steps = iter(())
        self._next_s = -np.inf
        self._pause_s = LOOK_S
        self._complained = False

    def step(self) -> bool:
        """True when something was done."""
        now_s = self._rig.clock.now()
        if now_s < self._next_s:
            return False
        try:
            return self._step(now_s)
        except HypermaskError as error:
            if not self._complained:
                self._rig.report(now_s, error.code, str(error))
            self._complained = True
            self._next_s, self._inputs = now_s + self._pause_s, None
            self._pause_s = min(2 * self._pause_s, LONGEST_S)
            return False

    def _step(self, now_s: float) -> bool:
        show = _quietly(self._rig.machine.show)
        for name in show.characters:
            if self._sew(name):
                return True
        inputs = self._states(show)
        if inputs != self._inputs:
            self._write(show, inputs)
            self._inputs, self._complained, self._pause_s = inputs, False, LOOK_S
            return True
        self._next_s = now_s + LOOK_S
        return False

    def _sew(self, name: str) -> bool:
        """Make a character's costume where there is none; one that cannot be read is left out."""
        try:
            return self._store.sew(name, self._rig.mask)
        except (DataError, ConfigError):
            return False  # the stage says it

    def _states(self, show: ShowFile) -> list[list[Any]]:
        """Of all that the overture is made from."""
        machine = self._rig.machine
        files = [etc(), *layer_paths(), paths.configs() / "machines", last_good_path()]
        files += [mask_folder(machine.mask) / name for name in ("mask.toml", "relief.png")]
        files += [storage.folder(), storage.folder() / storage.CURRENT, show_path(machine.show)]
        for name in show.characters:
            try:
                folder = find_character(name)
            except HypermaskError:
                continue
            files += [folder, folder / "texture.png", folder / "eyes.png"]
        return prepared.state_of(files)

    def _write(self, show: ShowFile, inputs: list[list[Any]]) -> None:
        rig, machine = self._rig, self._rig.machine
        calibration, driver = _calibration(rig), machine.projector
        cast = {name: self._store.path(name) for name in self._playing(show)}
        if (
            machine.mapping != "procam"
            or not isinstance(calibration, ProCam)
            or driver is None
            or driver.driver not in overture.DRIVERS
            or not cast
        ):
            prepared.path().unlink(missing_ok=True)
            return
        face = Face(load_character(find_character(next(iter(cast)))), rig.mask)
        model = self._store.keep(MODEL, self._store.of_model(face))
        layers = face.actor.layers
        table = {
            "code": overture.CODE,
            "inputs": inputs,
            "projector": {
                "driver": driver.driver,
                "settings": device_settings("projector", driver).model_dump(),
            },
            "track": prepared.description(TRACK),
            "scene": prepared.description(SCENE),
            "stage": machine.stage.model_dump(),
            "outline": rig.mask.settings.outline.model_dump(),
            "layers": [[layer.name, layer.shaded] for layer in layers],
            "model": str(model),
            "cast": {name: str(path) for name, path in cast.items()},
        }
        matrix = calibration.projector.matrix @ calibration.projector_from_camera.matrix()
        arrays: dict[str, NDArray[Any]] = {
            "projector_from_camera": matrix,
            "discs": eye_discs(rig.mask, machine.stage),
        }
        for number, (layer, places) in enumerate(zip(layers, face.positions(), strict=True)):
            arrays[f"triangles{number}"] = layer.triangles
            arrays[f"uv{number}"] = layer.uv
            arrays[f"places{number}"] = places
        prepared.write(prepared.path(), table, arrays)

    def _playing(self, show: ShowFile) -> list[str]:
        playing = []
        for name in show.characters:
            try:
                if self._store.find(name) is not None:
                    playing.append(name)
            except HypermaskError:
                continue
        return playing


def _quietly(name: str) -> ShowFile:
    """The show's process says what is wrong with it."""
    silent: Report = lambda time_s, code, text: None  # noqa: E731
    return playable_show(name, silent, 0.0)


def _calibration(rig: Rig) -> object:
    try:
        return storage.load_current()[0].calibration
    except HypermaskError:
        return nominal_projector(rig.machine)
