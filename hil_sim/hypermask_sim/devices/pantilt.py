"""The simulated pan-tilt unit: two axes with trapezoidal speed, limits and homing."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hypermask_drivers.clock import Clock
from hypermask_drivers.pantilt import PanTilt, PanTiltLimits, PanTiltState
from hypermask_sim.devices.base import SimDevice
from hypermask_sim.world import World


@dataclass(frozen=True)
class Phase:
    """Constant acceleration for `duration_s`, from where the phase before ended."""

    duration_s: float
    acceleration: float


def plan(distance: float, speed: float, top_speed: float, acceleration: float) -> list[Phase]:
    """The quickest way over `distance` from `speed` to standstill; rad, rad/s, rad/s^2.

    Speeds up at `acceleration` to `top_speed` at most, cruises, slows down. An axis that moves the
    wrong way, or too fast to stop in time, first brakes to a standstill.
    """
    way = math.copysign(1.0, distance)
    forward = speed * way
    if forward < 0 or forward**2 / (2 * acceleration) > abs(distance) + 1e-12:
        stop_s = abs(speed) / acceleration
        brake = Phase(stop_s, -math.copysign(acceleration, speed))
        return [brake, *plan(distance - speed * stop_s / 2, 0.0, top_speed, acceleration)]
    peak = min(top_speed, math.sqrt(acceleration * abs(distance) + forward**2 / 2))
    # A speed above a newly lowered top speed is brought down to it first.
    first = Phase(abs(peak - forward) / acceleration, math.copysign(acceleration, peak - forward))
    covered = (forward + peak) / 2 * first.duration_s + peak**2 / (2 * acceleration)
    cruise_s = max(0.0, abs(distance) - covered) / peak if peak > 0 else 0.0
    return [
        Phase(first.duration_s, first.acceleration * way),
        Phase(cruise_s, 0.0),
        Phase(peak / acceleration, -acceleration * way),
    ]


@dataclass(frozen=True)
class Move:
    """One axis under way since `start_s`: position and speed at the start, and the phases."""

    start_s: float
    position: float
    speed: float
    phases: list[Phase]

    def at(self, time_s: float) -> tuple[float, float]:
        """Position and speed at `time_s`."""
        left = time_s - self.start_s
        position, speed = self.position, self.speed
        for phase in self.phases:
            t = min(max(left, 0.0), phase.duration_s)
            position += speed * t + phase.acceleration * t * t / 2
            speed += phase.acceleration * t
            left -= phase.duration_s
        return position, speed

    @property
    def end_s(self) -> float:
        return self.start_s + sum(phase.duration_s for phase in self.phases)


class SimPanTilt(SimDevice, PanTilt):
    """Stands at the limits' middle until homed; homing takes `homing_s` and ends at zero."""

    kind, code, noun = "pantilt", "PTU", "pan-tilt unit"

    def __init__(self, world: World, clock: Clock) -> None:
        super().__init__(world, clock)
        settings = world.scenario.pantilt
        self._ranges = tuple(
            (math.radians(low), math.radians(high))
            for low, high in (settings.pan_deg, settings.tilt_deg)
        )
        self._top_speed = math.radians(settings.speed_deg_s)
        self._acceleration = math.radians(settings.acceleration_deg_s2)
        self._homing_s = settings.homing_s
        self._moves = [Move(0.0, (low + high) / 2, 0.0, []) for low, high in self._ranges]

    def place_at(self, time_s: float) -> tuple[float, float]:
        """Pan and tilt in rad at a clock time, by the orders so far; for `World.neck`."""
        time_s -= self.world.origin_s
        pan, tilt = (move.at(time_s)[0] for move in self._moves)
        return pan, tilt

    @property
    def limits(self) -> PanTiltLimits:
        return PanTiltLimits(self._ranges[0], self._ranges[1], self._top_speed)

    def home(self) -> None:
        now = self._check()
        self._moves = [Move(now, 0.0, 0.0, [Phase(self._homing_s, 0.0)]) for _ in self._moves]

    def move(self, pan_rad: float, tilt_rad: float, speed_rad_s: float) -> None:
        now = self._check()
        top = min(max(abs(speed_rad_s), 1e-6), self._top_speed)
        for axis, target in enumerate((pan_rad, tilt_rad)):
            low, high = self._ranges[axis]
            position, speed = self._moves[axis].at(now)
            distance = min(max(target, low), high) - position
            self._moves[axis] = Move(
                now, position, speed, plan(distance, speed, top, self._acceleration)
            )

    def halt(self) -> None:
        now = self._check()
        self._moves = [Move(now, move.at(now)[0], 0.0, []) for move in self._moves]

    def read(self) -> PanTiltState:
        now = self._check()
        pan, tilt = (move.at(now)[0] for move in self._moves)
        moving = any(move.end_s > now + 1e-9 for move in self._moves)
        return PanTiltState(pan, tilt, moving, now + self.world.origin_s)
