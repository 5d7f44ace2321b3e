"""The head's part of a report: where it was told to look, what it did, how far it was behind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hypermask.blackboard import Record
from hypermask.neck.gestures import movement
from hypermask.neck.trajectory import Array, NeckLimits, Trajectory

TURN_DEG = 1.0
"""A swing that goes back by less is no swing."""


@dataclass(frozen=True)
class Order:
    """What the show asked for at `time_s`. look: pan and tilt, rad."""

    time_s: float
    gesture: str
    look: tuple[float, float]
    planned: Trajectory


@dataclass
class HeadLog:
    """Fed at every turn of the pan-tilt worker with what the show wants and where the unit is."""

    orders: list[Order] = field(default_factory=list)
    path: list[tuple[float, float, float]] = field(default_factory=list)  # clock s, rad, rad
    _number: int | None = None

    def take(
        self, time_s: float, neck: Record | None, place: tuple[float, float], limits: NeckLimits
    ) -> None:
        self.path.append((time_s, *place))
        if neck is None or int(neck["order"]) == self._number:
            return
        self._number = int(neck["order"])
        start, speed = np.array(place), np.zeros(2)
        if self.orders:
            start, speed = self.orders[-1].planned.at(time_s)
        planned = movement(neck, start, speed, time_s, limits)
        look = (float(neck["pan_rad"]), float(neck["tilt_rad"]))
        self.orders.append(Order(time_s, bytes(neck["gesture"].item()).decode(), look, planned))

    def report(self, origin_s: float) -> dict[str, Any] | None:
        """Degrees and milliseconds; None for a show without a head."""
        if not self.path:
            return None
        behind = [abs(where - wanted) for where, wanted in self._behind()]
        degrees = np.degrees([place[1:] for place in self.path])
        return {
            "behind_deg": {
                "p50": _number(float(np.degrees(np.percentile(behind, 50)))),
                "max": _number(float(np.degrees(max(behind)))),
            },
            "behind_ms": _number(self._behind_s() * 1e3),
            "pan_deg": [_number(float(v)) for v in (degrees[:, 0].min(), degrees[:, 0].max())],
            "tilt_deg": [_number(float(v)) for v in (degrees[:, 1].min(), degrees[:, 1].max())],
            "orders": [self._order(index, origin_s) for index in range(len(self.orders))],
            "path": {
                "time_s": [round(p[0] - origin_s, 4) for p in self.path],
                "pan_deg": [_number(float(v)) for v in degrees[:, 0]],
                "tilt_deg": [_number(float(v)) for v in degrees[:, 1]],
            },
        }

    def _behind(self, shift_s: float = 0.0) -> list[tuple[float, float]]:
        """(where it is, where it should be) of both axes at every turn since the first order."""
        pairs: list[tuple[float, float]] = []
        if not self.orders:
            return [(0.0, 0.0)]
        number = 0
        for time_s, pan, tilt in self.path:
            now_s = time_s - shift_s
            while number + 1 < len(self.orders) and self.orders[number + 1].time_s <= now_s:
                number += 1
            wanted = self.orders[number].planned.at(now_s)[0]
            pairs += [(pan, float(wanted[0])), (tilt, float(wanted[1]))]
        return pairs

    def _behind_s(self) -> float:
        """The delay at which the path and the orders agree best."""
        shifts = np.arange(-0.1, 0.3, 0.005)
        costs = [sum((a - b) ** 2 for a, b in self._behind(float(shift))) for shift in shifts]
        return float(shifts[int(np.argmin(costs))])

    def _order(self, index: int, origin_s: float) -> dict[str, Any]:
        order = self.orders[index]
        last = index + 1 == len(self.orders)
        end_s = self.path[-1][0] + 1e-9 if last else self.orders[index + 1].time_s
        mine = np.array([p[1:] for p in self.path if order.time_s <= p[0] < end_s])
        wanted = order.planned.at(order.planned.end_s)[0]
        came = end_s >= order.planned.end_s + 0.15 and len(mine) > 0
        off = float(np.max(np.abs(mine[-1] - wanted))) if came else float("nan")
        return {
            "time_s": round(order.time_s - origin_s, 4),
            "gesture": order.gesture,
            "look_deg": [_number(math.degrees(v)) for v in order.look],
            "takes_s": _number(order.planned.end_s - order.time_s),
            "off_deg": _number(math.degrees(off)),
            "swings": [swings(mine[:, axis]) if len(mine) else 0 for axis in (0, 1)],
        }


def swings(angles: Array | Sequence[float]) -> int:
    """How often an axis turned back by more than `TURN_DEG`."""
    limit = math.radians(TURN_DEG)
    count, way = 0, 0
    extreme = float(angles[0])
    for angle in angles[1:]:
        step = float(angle) - extreme
        if way == 0:
            way = int(np.sign(step)) if abs(step) > limit else 0
            extreme = float(angle) if way else extreme
        elif step * way > 0:
            extreme = float(angle)
        elif abs(step) > limit:
            count, way, extreme = count + 1, -way, float(angle)
    return count


def _number(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None
