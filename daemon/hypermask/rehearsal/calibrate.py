"""The calibration of a rehearsal: the program's own session, with a simulated operator."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.calibration import storage
from hypermask.calibration.fixed import Fixed
from hypermask.calibration.nudging import Nudging
from hypermask.calibration.outcome import Method, Outcome
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.planar import Planar
from hypermask.calibration.positions import Position
from hypermask.calibration.rehearsed import MOST_KEYS, rehearse
from hypermask.calibration.session import LEAST_FRAMES, Phase, Session, planned_positions
from hypermask.calibration.still import Sighting
from hypermask.errors import ConfigError, DataError
from hypermask.rehearsal.cart import (
    SimulatedCart,
    calibration_cart,
    camera_model,
    nominal_screen,
    true_procam,
    true_screen,
)
from hypermask.rehearsal.journal import Journal
from hypermask.stage.overlay import Cross, Overlay
from hypermask.tracking.motion import MotionFilter
from hypermask.tracking.tracker import Tracker, TrackerSettings
from hypermask_drivers.clock import VirtualClock
from hypermask_sim.devices.keypad import HELD_S
from hypermask_sim.operator import Operator, screen_look, true_look
from hypermask_sim.scenario import Attitude, Scenario
from hypermask_sim.world import World

STILL_FRAMES = 60
SAME_CART_M = 0.025
SAME_FOCAL = 0.1
_PLANAR: dict[str, Method] = {"planar": "affine", "planar_projective": "projective"}


def method_of(scenario: Scenario) -> Method | None:
    """The session a scenario asks for; None for one that needs no clicks.

    Raises `ConfigError` CFG-VALUE where mapping and method do not go together.
    """
    method = scenario.calibration.method
    if scenario.mapping == "fixed":
        return None if method in ("exact", "stored") else "fixed"
    if scenario.mapping == "procam":
        if method in ("affine", "projective"):
            raise ConfigError(
                "CFG-VALUE",
                f"calibration.method '{method}' does not give what mapping 'procam' needs",
                "Set mapping to planar, or the method to click.",
            )
        return None if method in ("exact", "stored") else "click"
    return method if method in ("affine", "projective") else _PLANAR[scenario.mapping]


def calibrate(world: World, journal: Journal) -> ProCam | Planar | Fixed:
    """Run the session that the scenario asks for, before the show."""
    settings = world.scenario.calibration
    if settings.file is not None or settings.method == "stored":
        return _stored(world.scenario, journal)
    method = method_of(world.scenario)
    if method is None:
        journal(0.0, "CAL-EXACT", "The true projector is used; no calibration was made.")
        return true_screen(world) if world.mounted is not None else true_procam(world)
    outcome, presses = rehearsed_calibration(world, method)
    positions = f"{len(outcome.placements)} positions, " if outcome.placements else ""
    journal(
        0.0,
        "CAL-DONE",
        f"{method}: {positions}{presses} key presses; " + "; ".join(outcome.lines()),
    )
    return outcome.calibration


def rehearsed_calibration(world: World, method: Method) -> tuple[Outcome, int]:
    """The whole session with a simulated operator; the outcome and how many keys were pressed."""
    if method == "fixed":
        return calibrate_by_nudging(world)
    return calibrate_by_clicks(world, method)


def _stored(scenario: Scenario, journal: Journal) -> ProCam | Planar | Fixed:
    """Raises `DataError` CAL-READ, CAL-NONE; `ConfigError` CFG-VALUE for another mapping's."""
    file = scenario.calibration.file
    stored, warning = (
        (storage.read(Path(file)), None) if file is not None else storage.load_current()
    )
    if warning is not None:
        journal(0.0, "CAL-READ", warning)
    wanted = {"procam": ProCam, "fixed": Fixed}.get(scenario.mapping, Planar)
    if not isinstance(stored.calibration, wanted):
        raise ConfigError(
            "CFG-VALUE",
            f"the calibration {stored.name} ({stored.method}) does not fit mapping "
            f"'{scenario.mapping}'",
            "Choose the mapping that it was made for, or calibrate again.",
        )
    _check_cart(stored, scenario)
    journal(0.0, "CAL-STORED", f"{stored.name}: {stored.expected_mm:.2f} mm expected")
    return stored.calibration


def _check_cart(stored: storage.Stored, scenario: Scenario) -> None:
    """Raises `DataError` CAL-CART where the calibration was made on another cart."""
    calibration, projector = stored.calibration, scenario.projector
    if isinstance(calibration, Fixed):
        _check_screen(stored.name, calibration, scenario)
        return
    baseline_m = float(np.linalg.norm(projector.position_m[:2]))
    if isinstance(calibration, Planar):
        kind = _PLANAR.get(scenario.mapping)
        made_m = float(np.linalg.norm(calibration.parallax.baseline_m))
        same = kind is None or kind == calibration.kind
    else:
        made_m = calibration.baseline_m
        same = calibration.projector.size == (projector.width, projector.height)
    if not same or abs(made_m - baseline_m) > SAME_CART_M:
        raise DataError(
            "CAL-CART",
            f"the calibration {stored.name} was made on another cart: {stored.method}, camera and "
            f"projector {made_m * 1e3:.0f} mm apart, here {baseline_m * 1e3:.0f} mm",
            "Calibrate this cart.",
        )


def _check_screen(name: str, calibration: Fixed, scenario: Scenario) -> None:
    projector = scenario.projector
    focal_px = float(calibration.lens.matrix[0, 0])
    size = (projector.width, projector.height)
    if calibration.lens.size != size or abs(focal_px / projector.focal_px - 1) > SAME_FOCAL:
        raise DataError(
            "CAL-CART",
            f"the calibration {name} was made on another projector: picture "
            f"{calibration.lens.size[0]} x {calibration.lens.size[1]}, focal length "
            f"{focal_px:.0f} px, here {size[0]} x {size[1]}, {projector.focal_px:.0f} px",
            "Calibrate this head.",
        )


def calibrate_by_nudging(world: World) -> tuple[Outcome, int]:
    """A fixed screen's control points, with a simulated operator: the outcome and his presses."""
    settings = world.scenario.calibration
    session = Nudging(nominal_screen(world), world.mask)
    look = screen_look(world, session.points, settings.operator_error_mm, world.scenario.seed)
    operator = Operator(look, 0.0, world.scenario.seed)
    with _Bench(world, operator) as bench:
        for _ in range(MOST_KEYS):
            view = session.view()
            if session.phase is Phase.DONE:
                assert session.outcome is not None
                return session.outcome, session.key_presses
            if session.problem is not None:
                raise session.problem
            if view.cross_hair is None or view.led is None:
                session.key("enter", 0.0)
            else:
                session.key(bench.press(view.cross_hair, view.led), 0.0)
    raise DataError(
        "CAL-ENDLESS", f"no end after {MOST_KEYS} key presses", "Check the operator's aim."
    )


def calibrate_by_clicks(world: World, method: Method) -> tuple[Outcome, int]:
    """The whole session with a simulated operator; the outcome and how many keys were pressed."""
    with _Bench(world) as bench:
        return _clicked(bench, world, method)


def _clicked(bench: _Bench, world: World, method: Method) -> tuple[Outcome, int]:
    cart = calibration_cart(world)
    settings = world.scenario.calibration
    distance = None
    if method != "click":
        several = len(settings.distances_m) > 1
        distance = float(world.rest[2]) if several else settings.distances_m[0]
    positions = planned_positions(cart, method, settings.poses_per_distance, distance)
    result = rehearse(Session(cart, method, positions), bench.measure, bench.press)
    return result.outcome, result.key_presses


class _Bench:
    """The mask held still at one position after another before the cart's own camera.

    The cross-hair is drawn by the stage into the projector's picture, the operator sees where its
    lit pixels fall, and what he presses comes in through the keypad.
    """

    def __init__(self, world: World, operator: Operator | None = None) -> None:
        """operator: instead of one who clicks LEDs."""
        self._clock = VirtualClock()
        self._cart = SimulatedCart(World(_quiet(world.scenario)), self._clock)
        self._overlay: Overlay | None = None
        self._scenario = world.scenario
        self._still = world
        self._lit = (0.0, 0.0)
        self.operator = operator or self._clicker(world)

    def _clicker(self, world: World) -> Operator:
        projector, scenario = world.projector, world.scenario
        return Operator(
            true_look(
                projector.K,
                (projector.R, projector.t),
                world.mask.leds,
                lambda: self._still.camera_from_mask(0.0),
            ),
            scenario.calibration.operator_error_px,
            scenario.seed,
        )

    def __enter__(self) -> _Bench:
        projector = self._cart.projector
        projector.open()
        self._cart.keypad.open()
        projector.add_listener(self._look)
        self._overlay = Overlay(projector.context, (projector.mode.width, projector.mode.height))
        return self

    def __exit__(self, *error: object) -> None:
        self._cart.projector.close()

    def press(self, cross_hair: tuple[int, int], led: int) -> str:
        """Light the cross-hair, let the operator look and press, and read the keypad."""
        assert self._overlay is not None
        projector, keypad = self._cart.projector, self._cart.keypad
        with projector.context:
            projector.framebuffer.clear()
        self._overlay.draw_cross(projector.framebuffer, Cross(cross_hair))
        self._clock.sleep_until(projector.present())
        keypad.press(self.operator.key(self._lit, led))
        self._clock.sleep_until(self._clock.now() + HELD_S)
        events = []
        while (event := keypad.read(0.0)) is not None:
            events.append(event.key)
        return events[0]

    def _look(self, picture: NDArray[np.uint8], flip_s: float, light_s: float) -> None:
        """Where the light of the picture is: the centroid of its lit pixels."""
        light = picture[..., 1].astype(np.float32)
        moments = cv2.moments(light)
        if moments["m00"] > 0:
            self._lit = (moments["m10"] / moments["m00"], moments["m01"] / moments["m00"])

    def measure(self, position: Position) -> Iterator[Sighting]:
        """Track the mask where the operator puts it when asked for `position`."""
        asked = (position.x_m, position.y_m, position.distance_m)
        where, turned = self.operator.place(asked, (0.0, position.pitch, position.yaw))
        self._still = World(self._held(where, np.degrees(turned)))
        clock = VirtualClock()
        cart = SimulatedCart(self._still, clock)
        motion = MotionFilter()
        tracker = Tracker(
            self._still.mask.leds, camera_model(self._still), TrackerSettings(), motion
        )
        found = 0
        with cart.camera as camera:
            for _ in range(STILL_FRAMES):
                clock.sleep_until(camera.next_arrival_s())
                frame = camera.read(0.0)
                if frame is None:
                    continue
                result = tracker.process(frame.image, frame.time_s, frame.sequence)
                if result.estimate is not None:
                    found += 1
                    estimate = result.estimate
                    yield Sighting(frame.time_s, estimate.pose, estimate.covariance, result.points)
                if found >= LEAST_FRAMES + 24:
                    return

    def _held(self, where: np.ndarray, turned_deg: np.ndarray) -> Scenario:
        roll, pitch, yaw = (float(angle) for angle in turned_deg)
        still = self._scenario.still(float(where[2]), Attitude(roll=roll, pitch=pitch, yaw=yaw))
        performer = still.performer.model_copy(
            update={"position_m": tuple(float(x) for x in where)}
        )
        return _quiet(still.model_copy(update={"performer": performer}))


def _quiet(scenario: Scenario) -> Scenario:
    """The scenario without faults and without the show's own key presses."""
    performer = scenario.performer.model_copy(update={"keys": ()})
    return scenario.model_copy(update={"performer": performer, "faults": ()})
