"""The simulated cart as the show sees it: devices, and what the show believes of its hardware."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from hypermask.calibration.fixed import Fixed, control_points, nominal_fixed, solve
from hypermask.calibration.outcome import Cart as CalibrationCart
from hypermask.calibration.parameters import PARAMETERS, ProCam, updated
from hypermask.geometry import Pinhole, Pose
from hypermask.rehearsal.journal import Journal
from hypermask_drivers.clock import Clock
from hypermask_drivers.device import Device
from hypermask_drivers.registry import driver_class
from hypermask_sim.devices.camera import SimCamera
from hypermask_sim.devices.keypad import SimKeypad
from hypermask_sim.devices.pantilt import SimPanTilt
from hypermask_sim.devices.projector import SimProjector
from hypermask_sim.devices.sound import SimSoundIn
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World

D = TypeVar("D", bound=Device)

# How far a data sheet and a tape measure are from the truth (one sigma): focal length 1 %,
# principal point 10 px, turn 0.5 degrees, place 2 mm.
_DATA_SHEET_SIGMA = np.array([19.0, 10, 10, *np.radians([0.5] * 3), 0.002, 0.002, 0.002])


@dataclass
class SimulatedCart:
    """Every device of the cart, simulated from one world on one clock."""

    world: World
    clock: Clock
    journal: Journal = field(default_factory=Journal)

    def __post_init__(self) -> None:
        self.camera = self._device("camera", SimCamera)
        self.projector = self._device("projector", SimProjector)
        self.keypad = self._device("keypad", SimKeypad)
        self.sound = self._device("sound", SimSoundIn)
        self.pantilt = self._device("pantilt", SimPanTilt)
        if self.scenario.neck:
            self.world.neck = self.pantilt.place_at

    @property
    def scenario(self) -> Scenario:
        return self.world.scenario

    def _device(self, kind: str, expected: type[D]) -> D:
        device = driver_class(kind, "sim")(self.world, self.clock)  # type: ignore[call-arg]
        assert isinstance(device, expected)
        return device


def camera_model(world: World) -> Pinhole:
    """The camera as its factory calibration knows it."""
    return Pinhole(world.camera.K, world.camera.size)


def nominal_screen(world: World) -> Fixed:
    """A Mask-bot's screen as its builder knows it."""
    projector, screen = world.scenario.projector, world.scenario.screen
    size = (projector.width, projector.height)
    return nominal_fixed(size, projector.focal_px, screen.lens_m, screen.k, projector.centre_px)


def true_screen(world: World) -> Fixed:
    """The true map of a Mask-bot, as near as a calibration can hold it."""
    assert world.mounted is not None
    points = control_points(world.mask, 9, 13)
    rotation, translation = world.mounted
    pixels = world.projector.lens.image(points @ rotation.T + translation)
    return solve(points, pixels, nominal_screen(world), world.mask, sigma_px=0.02).fixed


def true_procam(world: World) -> ProCam:
    projector = world.projector
    return ProCam(Pinhole(projector.K, projector.size), Pose(projector.R, projector.t))


def calibration_cart(world: World) -> CalibrationCart:
    """What is known before the first click; the nominal projector is wrong as data sheets are."""
    settings = world.scenario.calibration
    error = np.random.default_rng([world.scenario.seed, 0xCA]).normal(0, 1, PARAMETERS)
    return CalibrationCart(
        mask=world.mask,
        camera=camera_model(world),
        nominal=updated(true_procam(world), error * _DATA_SHEET_SIGMA),
        sigma_px=max(settings.operator_error_px, 0.3),
        distances_m=settings.distances_m,
    )
