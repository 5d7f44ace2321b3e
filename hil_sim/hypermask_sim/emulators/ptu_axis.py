"""One axis of the emulated pan-tilt unit: steps, trapezoidal speed, limits."""

from __future__ import annotations

from dataclasses import dataclass

from hypermask_sim.devices.pantilt import Move, Phase, plan


@dataclass
class AxisData:
    """Positions in steps, speeds in steps/s; the defaults are those of the PTU-46-17.5's pan."""

    low: int = -3090
    high: int = 3090
    resolution: float = 185.1428
    slowest: int = 31
    fastest: int = 2902
    base: int = 1000
    acceleration: int = 2000
    speed: int = 1000


PAN = AxisData()
TILT = AxisData(low=-907, high=604)


class Axis:
    """A stepper: below the base speed it starts and stops within a step, above it ramps."""

    def __init__(self, letter: str, data: AxisData) -> None:
        self.letter, self.data = letter, data
        self.target = 0
        self._move = Move(0.0, 0.0, 0.0, [])

    def exact(self, now_s: float) -> float:
        return self._move.at(now_s)[0]

    def position(self, now_s: float) -> int:
        return round(self.exact(now_s))

    def speed(self, now_s: float) -> int:
        moving = now_s < self._move.end_s
        return round(abs(self._move.at(now_s)[1])) if moving else 0

    @property
    def end_s(self) -> float:
        return self._move.end_s

    def place(self, steps: float, now_s: float) -> None:
        self._move = Move(now_s, steps, 0.0, [])
        self.target = round(steps)

    def go(self, target: int, now_s: float) -> None:
        """Section 4.4.1: trapezoidal, at once at up to the base speed."""
        position, velocity = self._move.at(now_s)
        if now_s >= self._move.end_s:
            velocity = 0.0
        self.target = target
        distance = target - position
        top = float(self.data.speed)
        if max(top, abs(velocity)) <= self.data.base:
            phases = _at_once(distance, top)
            start = phases[0].acceleration if phases else 0.0
            steady = [Phase(phase.duration_s, 0.0) for phase in phases]
            self._move = Move(now_s, position, start, steady)
            return
        phases = plan(distance, velocity, top, float(self.data.acceleration))
        self._move = Move(now_s, position, velocity, phases)

    def halt(self, now_s: float) -> None:
        """Section 4.3.8: stops as fast as it can without losing steps."""
        position, velocity = self._move.at(now_s)
        moving = now_s < self._move.end_s
        if not moving or abs(velocity) <= self.data.base:
            self.place(self.position(now_s), now_s)
            return
        stop_s = abs(velocity) / self.data.acceleration
        brake = Phase(stop_s, -self.data.acceleration if velocity > 0 else self.data.acceleration)
        self._move = Move(now_s, position, velocity, [brake])
        self.target = round(position + velocity * stop_s / 2)


def _at_once(distance: float, speed: float) -> list[Phase]:
    """One phase whose `acceleration` is its constant speed; none for no distance."""
    if not distance:
        return []
    return [Phase(abs(distance) / speed, speed if distance > 0 else -speed)]
