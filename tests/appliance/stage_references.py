"""What the projector has to show: drawn on the host by the stage's own renderer.

A reference is a picture (height, width, 3) RGB, row 0 at the top, for a pose of the mask, a
character and a cue of the default show, with the mouth closed and without blinks, gaze and breath.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.config import read_toml
from hypermask.face.life import Life
from hypermask.geometry import Pose
from hypermask.machine.files import packaged_path, validated
from hypermask.machine.places import mask_folder
from hypermask.machine.settings import MachineSettings
from hypermask.services.rig import nominal_projector
from hypermask.show.expressions import expressions_of
from hypermask.show.showfile import load_show
from hypermask.stage.renderer import StageRenderer
from hypermask.workers.cast import Cast
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.mask import load_mask
from hypermask_drivers.projector import ProjectorMode
from hypermask_drivers.projector.offscreen import OffscreenProjector
from hypermask_sim.optics import Sensor
from hypermask_sim.scenario import (
    Attitude,
    CameraSettings,
    PerformerSettings,
    ProjectorSettings,
    Scenario,
)
from hypermask_sim.world import World

Image = NDArray[np.uint8]

LIT = 10
"""Grey level from which a pixel counts as lit."""
_STILL = Life(blinks=False, gaze=False, breath=False)
_NOISES = 4


@dataclass(frozen=True)
class Place:
    """Where the mask is held: metres from the camera, right of and above the middle of the
    projector's picture as the camera sees it; degrees."""

    distance_m: float = 1.4
    right_m: float = 0.0
    up_m: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0


class Cart:
    """The virtual cart as it truly is: its camera, its projector and what they see and show."""

    def __init__(self) -> None:
        path = packaged_path("qemu")
        self.machine: MachineSettings = validated(read_toml(path), str(path))
        self.mask = load_mask(mask_folder(self.machine.mask))
        self.show = load_show(paths.configs() / "shows" / f"{self.machine.show}.toml")
        self._procam = nominal_projector(self.machine)
        self.width = self.machine.optics.projector.width
        self.height = self.machine.optics.projector.height

    def world(self, place: Place, motion: str = "still", speed: float = 1.0) -> World:
        camera, projector = self.machine.optics.camera, self.machine.optics.projector
        roll, pitch, yaw = projector.attitude_deg
        scenario = Scenario(
                mask=str(mask_folder(self.machine.mask)),
                camera=CameraSettings(
                    width=camera.width, height=camera.height, focal_px=camera.focal_px,
                    centre_px=camera.centre_px, rate_hz=60,
                ),
                projector=ProjectorSettings(
                    width=projector.width, height=projector.height, focal_px=projector.focal_px,
                    centre_px=projector.centre_px, position_m=projector.position_m,
                    attitude_deg=Attitude(roll=roll, pitch=pitch, yaw=yaw),
                ),
                performer=PerformerSettings(
                    motion=(motion,), speed=speed, distance_m=place.distance_m,
                    attitude_deg=Attitude(roll=place.roll, pitch=place.pitch, yaw=place.yaw),
                ),
            )  # fmt: skip
        x, y, z = World(scenario).rest
        rest = (float(x) + place.right_m, float(y) - place.up_m, float(z))
        performer = scenario.performer.model_copy(update={"position_m": rest})
        return World(scenario.model_copy(update={"performer": performer}))

    def frames(self, place: Place) -> bytes:
        """What the camera sees of a mask that is held still: some frames that differ in noise."""
        world = self.world(place)
        return self._exposed(world, np.zeros(_NOISES))

    def moving_frames(self, place: Place, rate_hz: float, seconds: float) -> bytes:
        """Once to the side and back, from rest to rest as somebody moves who stood still; the
        built-in path sways at 0.4 Hz times its speed, and a quarter of it leads to the side."""
        world = self.world(place, "sway", speed=1 / (0.4 * 2 * seconds))
        turn = 2 * np.pi * np.arange(round(seconds * rate_hz)) / (seconds * rate_hz)
        return self._exposed(world, seconds / 2 * (1 - np.cos(turn)) / 2)

    def dark_frames(self) -> bytes:
        """The room without a mask."""
        return self._sensor(self.world(Place())).expose(None, 0.0, 0).tobytes()

    def _exposed(self, world: World, times: NDArray[np.float64]) -> bytes:
        sensor = self._sensor(world)
        return b"".join(
            sensor.expose(world.spots(float(time_s), 1e-3), 0.0, number).tobytes()
            for number, time_s in enumerate(times)
        )

    @staticmethod
    def _sensor(world: World) -> Sensor:
        settings = world.scenario.camera
        return Sensor(world.camera.size, settings.ambient, settings.read_noise, 1)

    # What the projector must show

    @cached_property
    def _stage(self) -> tuple[OffscreenProjector, StageRenderer, Cast]:
        optics = self.machine.optics.projector
        projector = OffscreenProjector(
            ProjectorMode(optics.width, optics.height, 60.0, 0.0), VirtualClock()
        )
        projector.open()
        size = (optics.width, optics.height)
        renderer = StageRenderer(projector.context, size, self.mask, self.machine.stage)
        names = self.show.characters
        return projector, renderer, Cast({name: name for name in names}, self.mask, renderer)

    def reference(self, place: Place, character: str, cue: str = "neutral") -> Image:
        projector, renderer, cast = self._stage
        rotation, position = self.world(place).camera_from_mask(0.0)
        matrix = self._procam.projector_from_mask(Pose(rotation, position))
        units = expressions_of(self.show)[cue].units[-1]
        items = cast.items([(character, 1.0)], units, np.zeros(13), 0.0, _STILL)
        renderer.draw(projector.framebuffer, matrix, items, self.show.brightness)
        return projector.read_picture()


@dataclass(frozen=True)
class Verdict:
    """overlap: intersection over union of what is lit; shift_px: how far the picture is from the
    reference; likeness: correlation of the pixels within the reference's light, -1 to 1."""

    overlap: float
    shift_px: float
    likeness: float


def judge(shown: Image, wanted: Image) -> Verdict:
    if shown.shape != wanted.shape:  # another mode, or none yet
        return Verdict(0.0, float("inf"), 0.0)
    lit, due = is_lit(shown), is_lit(wanted)
    both = float((lit & due).sum())
    either = float((lit | due).sum())
    if not lit.any() or not due.any():
        return Verdict(0.0, float("inf"), 0.0)
    return Verdict(both / either, _shift(lit, due), likeness(shown, wanted))


def is_lit(picture: Image) -> NDArray[np.bool_]:
    return np.asarray(picture.max(axis=2) >= LIT)


def _shift(lit: NDArray[np.bool_], due: NDArray[np.bool_]) -> float:
    """Between the centroids of what is lit and what should be."""
    centres = [np.argwhere(area).mean(axis=0) for area in (lit, due)]
    return float(np.linalg.norm(centres[0] - centres[1]))


def likeness(shown: Image, wanted: Image) -> float:
    """Correlation of the pixels, slightly blurred, where the reference is lit."""
    due = is_lit(wanted)
    a, b = (
        cv2.GaussianBlur(picture, (0, 0), 1.0)[due].astype(float).ravel()
        for picture in (shown, wanted)
    )
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size else 0.0
