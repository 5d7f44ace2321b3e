"""What a worker is built from. On the cart and on a desk it comes from the machine file
(`MachineRig`), in a rehearsal from a scenario."""

from __future__ import annotations

import os
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

from hypermask import paths
from hypermask.calibration.fixed import Fixed, nominal_fixed
from hypermask.calibration.parameters import ProCam
from hypermask.errors import ConfigError
from hypermask.geometry import Pinhole, Pose, rotation_from_attitude
from hypermask.machine.devices import SIMULATED, make_device
from hypermask.machine.places import mask_folder, scenario_path
from hypermask.machine.settings import MachineSettings
from hypermask.mask import Mask, load_mask
from hypermask.workers.board import Board
from hypermask.workers.health import Health
from hypermask.workers.retry import Report
from hypermask_drivers.clock import Clock, RealClock
from hypermask_drivers.device import Device

if TYPE_CHECKING:
    from hypermask_sim.world import World


class Rig(Protocol):
    """Everything that a worker may ask for."""

    @property
    def machine(self) -> MachineSettings: ...

    @property
    def clock(self) -> Clock: ...

    @property
    def mask(self) -> Mask: ...

    @property
    def board(self) -> Board: ...

    @property
    def report(self) -> Report: ...

    @property
    def health(self) -> Health: ...

    @property
    def camera_model(self) -> Pinhole:
        """The camera as its factory calibration knows it."""
        ...

    def device(self, kind: str) -> Device | None:
        """A new device of that kind, not opened; None in a machine without it."""
        ...


class MachineRig:
    """A rig from the machine file. Raises `ConfigError` for what only now turns out wrong."""

    def __init__(
        self, machine: MachineSettings, board: Board, report: Report, health: Health
    ) -> None:
        self.machine, self.board, self.report, self.health = machine, board, report, health
        self.clock: Clock = RealClock()

    @cached_property
    def mask(self) -> Mask:
        return load_mask(mask_folder(self.machine.mask))

    @cached_property
    def camera_model(self) -> Pinhole:
        return camera_model(self.machine)

    @cached_property
    def world(self) -> World:
        """Of the simulated devices. Raises `ConfigError` CFG-*."""
        from hypermask_sim.scenario import load_scenario
        from hypermask_sim.world import World

        return World(load_scenario(scenario_path(self.machine.scenario)), sim_origin_s())

    def device(self, kind: str) -> Device | None:
        table = self.machine.device(kind)
        if table is None:
            return None
        world = self.world if table.driver == SIMULATED else None
        return make_device(kind, table, self.clock, world)


def camera_model(machine: MachineSettings) -> Pinhole:
    camera = machine.optics.camera
    centre = camera.centre_px or ((camera.width - 1) / 2, (camera.height - 1) / 2)
    return Pinhole.from_focal(camera.focal_px, centre, (camera.width, camera.height))


def nominal_projector(machine: MachineSettings) -> ProCam:
    """The projector by its data sheet: until somebody calibrates, and where they begin."""
    import numpy as np

    projector = machine.optics.projector
    centre = projector.centre_px or ((projector.width - 1) / 2, projector.height - 0.5)
    facing = np.diag([1.0, -1.0, -1.0])
    turned = facing @ rotation_from_attitude(*np.radians(projector.attitude_deg)) @ facing
    pose = Pose(turned.T, -turned.T @ np.array(projector.position_m))
    size = (projector.width, projector.height)
    return ProCam(Pinhole.from_focal(projector.focal_px, centre, size), pose)


def nominal_screen(machine: MachineSettings) -> Fixed:
    """As `nominal_projector`, of a screen that is fixed to the projector."""
    projector = machine.optics.projector
    size = (projector.width, projector.height)
    return nominal_fixed(
        size,
        projector.focal_px,
        projector.position_m,
        projector.k,
        projector.centre_px,
        projector.attitude_deg,
    )


def sim_origin_s() -> float:
    """CLOCK_MONOTONIC at the simulated world's time 0, the same for all services.

    `HYPERMASK_ORIGIN`, or what the first service wrote into `run()/origin`.
    """
    import contextlib
    import time

    given = os.environ.get("HYPERMASK_ORIGIN")
    if given:
        return float(given)
    path = paths.run() / "origin"
    for _ in range(100):
        with contextlib.suppress(OSError, ValueError):
            origin_s = float(path.read_text())
            if origin_s <= time.monotonic():
                return origin_s
            path.unlink()  # of the time before this machine was started
        path.parent.mkdir(parents=True, exist_ok=True)
        mine = path.with_name(f".origin.{os.getpid()}")
        mine.write_text(repr(time.monotonic()))
        with contextlib.suppress(OSError):
            os.link(mine, path)  # fails where another service was quicker
        mine.unlink(missing_ok=True)
    raise ConfigError("CFG-ORIGIN", f"cannot agree on {path}", "Remove it.")
