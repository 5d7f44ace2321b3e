"""The ways to calibrate, as `workers.calibration_mode` leads through them: a click session that
lives on what the tracker sees, and a fixed screen's control points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from hypermask.blackboard import Record
from hypermask.calibration.fixed import Fixed
from hypermask.calibration.nudging import Nudging
from hypermask.calibration.outcome import Cart, Method, Outcome
from hypermask.calibration.positions import Position
from hypermask.calibration.session import Phase, Session, View
from hypermask.calibration.still import Sighting
from hypermask.geometry import Array, Pose
from hypermask.mask import Mask

Table = dict[str, Any]


class KeyLed(Protocol):
    """What clicking and nudging have in common: keys in, words and a result out."""

    @property
    def phase(self) -> Phase: ...
    @property
    def outcome(self) -> Outcome | None: ...
    def key(self, key: str, time_s: float) -> None: ...
    def view(self) -> View: ...
    def snapshot(self) -> Table: ...


class Course:
    """One of the ways to calibrate."""

    method: Method

    def __init__(self, session: KeyLed) -> None:
        self._session = session

    @property
    def phase(self) -> Phase:
        return self._session.phase

    @property
    def outcome(self) -> Outcome | None:
        return self._session.outcome

    def key(self, key: str, time_s: float) -> None:
        self._session.key(key, time_s)

    def view(self) -> View:
        return self._session.view()

    def snapshot(self) -> Table:
        return self._session.snapshot()

    def look(self, track: Record | None, now_s: float) -> None:
        """The newest track record; a way without a camera needs none."""

    def marks(self) -> Array:
        """Points (n, 2) px that stay lit beside the cross-hair."""
        return np.zeros((0, 2))


class ClickCourse(Course):
    """The cart's session, on what the tracker puts on the board."""

    def __init__(
        self,
        cart: Cart,
        method: Method,
        snapshot: Table | None = None,
        positions: Sequence[Position] | None = None,
    ) -> None:
        """positions: instead of the best ones, which take a second to find."""
        self.method = method
        self.session = (
            Session(cart, method, positions) if snapshot is None else Session.resume(cart, snapshot)
        )
        super().__init__(self.session)
        self._taken_s = -np.inf

    def look(self, track: Record | None, now_s: float) -> None:
        """Every frame of the tracker's once, and the passing of time."""
        if track is None or float(track["time_s"]) <= self._taken_s:
            self.session.sighting(None, now_s)
            return
        self._taken_s = float(track["time_s"])
        self.session.sighting(sighting_of(track), now_s)


class NudgeCourse(Course):
    """A fixed screen's control points."""

    method = "fixed"

    def __init__(self, nominal: Fixed, mask: Mask, snapshot: Table | None = None) -> None:
        self.session = (
            Nudging(nominal, mask) if snapshot is None else Nudging.resume(nominal, mask, snapshot)
        )
        super().__init__(self.session)

    def marks(self) -> Array:
        return self.session.marks()


def sighting_of(track: Record) -> Sighting | None:
    """The pose that was measured in the record's newest frame, None where there was none."""
    motion, points = track["motion"], track["points"]
    time_s = float(track["time_s"])
    fresh = bool(track["locked"]) and float(motion["time_s"]) == time_s and motion["samples"]
    if not fresh:
        return None
    pose = Pose(motion["rotation"].copy(), motion["translation"].copy())
    seen = points["seen_s"] == time_s
    image = np.where(seen[:, None], points["measured"], np.nan)
    return Sighting(time_s, pose, motion["measured_covariance"].copy(), image)
