"""A show in lock-step whose keypad is lent to a calibration, and a simulated operator at it.

He sees light: where the cross-hair is he finds in the projected picture, and what he presses comes
through the simulated keypad. The words that he is told he does not need to parse: which LED, which
mark and which place they name is read from the session that says them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from hypermask import paths
from hypermask.calibration.fixed import Fixed
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.session import LEAST_FRAMES, Phase
from hypermask.rehearsal.cart import (
    SimulatedCart,
    calibration_cart,
    nominal_screen,
)
from hypermask.rehearsal.lockstep import Flip, LockStep
from hypermask.rehearsal.show_parts import casting_of
from hypermask.workers.background import OnTheSpot
from hypermask.workers.board import Board
from hypermask.workers.calibration_mode import CalibrationMode, Subject, calibration_modes
from hypermask.workers.modes import Modes
from hypermask_drivers.clock import VirtualClock
from hypermask_sim.dots import load_dots
from hypermask_sim.judge import Judge
from hypermask_sim.operator import Operator, screen_look, true_look
from hypermask_sim.scenario import Attitude, Scenario
from hypermask_sim.world import World

BRIGHT = 128
"""The cross-hair is bright, the marks that are done are faint."""
BETWEEN_KEYS = 2
"""Flips from a key to the next: the key's way to the light."""


def judge_of(world: World) -> Judge:
    return Judge(world, load_dots(paths.configs() / "characters" / "dots"))


@dataclass
class LiveCart:
    """All workers on one board."""

    scenario: Scenario
    calibration: ProCam | Fixed | None = None
    positions: Any = None
    world: World = field(init=False)
    flips: int = 0

    def __post_init__(self) -> None:
        self.world = World(self.scenario)
        self.cart = SimulatedCart(self.world, VirtualClock())
        fixed = self.scenario.mapping == "fixed"
        if self.calibration is None:
            nominal = nominal_screen if fixed else (lambda world: calibration_cart(world).nominal)
            self.calibration = nominal(self.world)
        self.lockstep = LockStep(
            self.cart, self.calibration, casting_of(self.scenario), modes=self._modes
        )
        self._play = self.lockstep.play(3600.0)

    def _modes(self, board: Board) -> Modes:
        subject = Subject(
            self.scenario.mapping,
            lambda: self.world.mask,
            lambda: calibration_cart(self.world),
            lambda: nominal_screen(self.world),
        )
        return calibration_modes(subject, board, self.cart.journal, OnTheSpot(), self.positions)

    def flip(self, count: int = 1) -> Flip:
        for _ in range(count):
            flip = next(self._play)
            assert flip is not None
            self.flips += 1
        return flip

    @property
    def mode(self) -> CalibrationMode:
        mode = self.lockstep.show.keeper._mode
        assert isinstance(mode, CalibrationMode)
        return mode

    @property
    def session(self) -> Any:
        return self.mode.course.session  # type: ignore[union-attr]

    @property
    def rms_mm(self) -> float:
        """How far the test dots are beside their places, in the frame that is shown next."""
        flip = self.flip()
        return judge_of(self.world).examine(flip.probe, flip.picture.light_s).rms_mm

    def begin(self, name: str = "calibrate") -> None:
        self.lockstep.show.keeper.begin(name, self.cart.clock.now())
        self.flip(2)

    @property
    def active(self) -> bool:
        return self.lockstep.show.keeper.active != ""

    def press(self, key: str) -> None:
        self.cart.keypad.press(key)
        self.flip(BETWEEN_KEYS)

    def said(self, code: str) -> list[str]:
        return [event.text for event in self.cart.journal.events if event.code == code]

    def close(self) -> None:
        self.lockstep.close()


def cross_seen(flip: Flip) -> tuple[float, float]:
    """The centroid of what is brightly lit in the projected picture."""
    light = flip.shown[..., 1].astype(np.float32)
    moments = cv2.moments(np.where(light >= BRIGHT, light, 0))
    assert moments["m00"] > 0, "no cross-hair is lit"
    return moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]


def operator_of(live: LiveCart, error: float) -> Operator:
    """error: of his aim an axis; pixels at an LED, millimetres on a screen."""
    world, seed = live.world, live.scenario.seed
    if world.mounted is not None:
        return Operator(screen_look(world, live.session.points, error, seed), 0.0, seed)
    projector = world.projector
    look = true_look(
        projector.K,
        (projector.R, projector.t),
        world.mask.leds,
        lambda: world.camera_from_mask(live.cart.clock.now()),
    )
    return Operator(look, error, seed)


def operate(live: LiveCart, operator: Operator, until: Callable[[], bool]) -> None:
    """Look, press, look again, until he may stop; ends when the mode does."""
    for _ in range(700):
        if not live.active or until():
            return
        session = live.session
        if session.phase is Phase.CLICK:
            live.press(operator.key(cross_seen(live.flip()), session.view().led))
        elif session.phase is Phase.PLACE:
            _place(live, operator, session.view().target)
        else:
            live.press("enter")
    raise AssertionError("the calibration comes to no end")


def _place(live: LiveCart, operator: Operator, target: Any) -> None:
    """Bring the mask where he is told to, wait until it is seen, and begin there."""
    where, turned = operator.place(
        (target.x_m, target.y_m, target.distance_m), (0.0, target.pitch, target.yaw)
    )
    roll, pitch, yaw = (float(angle) for angle in np.degrees(turned))
    live.world.put(where, Attitude(roll=roll, pitch=pitch, yaw=yaw))
    live.flip(12)
    live.press("enter")
    live.flip(LEAST_FRAMES + 2)
