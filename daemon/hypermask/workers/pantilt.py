"""The pan-tilt worker: orders of the show in, a head that moves, and one that stops, out.

The unit is only ever sent to where the head should be a moment later: if this process dies or the
line breaks, the head comes to rest there, within `lookahead_s`, by itself.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from hypermask.blackboard import Record
from hypermask.errors import HypermaskError
from hypermask.neck.gestures import movement
from hypermask.neck.record import HEAD
from hypermask.neck.settings import NeckSettings
from hypermask.neck.trajectory import Array, NeckLimits, Trajectory, through
from hypermask.workers.board import KEPT, Board
from hypermask.workers.retry import Kept, Report
from hypermask_drivers.clock import Clock
from hypermask_drivers.pantilt import PanTilt, PanTiltState

PERIOD_S = 0.05
"""How often `step` should be called: a unit at 9600 baud cannot follow much faster."""
_LATE_S = 1.0
_HOME_AGAIN_S = 10.0


class PanTiltWorker:
    """Owns the pan-tilt unit; reads `Board.neck`, writes `Board.head` at every step.

    alone: there will be no master, so it finds the zero by itself, to park.
    """

    def __init__(
        self,
        head: PanTilt,
        board: Board,
        clock: Clock,
        report: Report,
        settings: NeckSettings | None = None,
        alone: bool = False,
    ) -> None:
        self.head = Kept(head, "pantilt", clock, report)
        self._alone = alone
        self._board, self._clock, self._report = board, clock, report
        self.settings = settings or NeckSettings()
        self._record = np.zeros((), HEAD)
        self._record["state"] = b"absent"
        self._trajectory: Trajectory | None = None
        self._order: int | None = None
        self._silent_s: float | None = None
        self._stepped_s: float | None = None
        self._homing = self._home_failed = False
        self._home_s = -math.inf  # when it may be homed again
        self.compute_s: deque[float] = deque(maxlen=KEPT)

    def step(self) -> bool:
        """One turn; False while there is no unit."""
        began = self._clock.now()
        state = self.head.use(lambda head: head.read())
        if state is None:
            self._gone()
        else:
            self._turn(state, began)
        self._stepped_s = began
        self._publish(began, state)
        self.compute_s.append(self._clock.now() - began)
        return state is not None

    def words(self) -> str:
        """What the head does, in a word."""
        return f"the head is {self._record['state'].item().decode()}"

    def stop(self) -> None:
        """Halt, and let go of the unit; one that is lost is not sought again for that."""
        if self.head.is_ready:
            self.head.use(lambda head: head.halt())
        self.head.device.close()

    def _gone(self) -> None:
        if self._record["ready"]:
            self._record["losses"] += 1
        self._forget()
        self._homing, self._home_s = False, -math.inf
        self._record["state"] = b"absent"

    def _forget(self) -> None:
        self._trajectory, self._order = None, None

    def _turn(self, state: PanTiltState, now_s: float) -> None:
        self._notice_limits(state)
        self._notice_zero(state, now_s)
        neck = self._listen(now_s)
        if neck is None and self._silent_s == now_s:
            self._halt(b"halted")
        elif not state.homed:
            self._find_zero(neck is not None or self._alone, now_s)
        elif neck is None:
            self._park(state, now_s)
        else:
            self._obey(neck, state, now_s)

    def _notice_limits(self, state: PanTiltState) -> None:
        if state.limit_hits > int(self._record["limit_hits"]):
            self._report(
                self._clock.now(), "NECK-LIMIT", "The head ran into its end; it is homed again."
            )
            self._forget()
        self._record["limit_hits"] = state.limit_hits

    def _notice_zero(self, state: PanTiltState, now_s: float) -> None:
        """A reset that ended without a zero is told once, and tried again after a while."""
        if state.homed:
            self._homing = self._home_failed = False
        elif self._homing and not state.moving:
            self._homing, self._home_s = False, now_s + _HOME_AGAIN_S
            if not self._home_failed:
                self._report(
                    now_s,
                    "NECK-HOME",
                    "The head did not find its zero; look whether something blocks it. "
                    f"It tries again every {_HOME_AGAIN_S:.0f} s.",
                )
            self._home_failed = True

    # --- the master -----------------------------------------------------------------------

    def _listen(self, now_s: float) -> Record | None:
        """The neck record, None while its master is silent or this worker was held up itself."""
        settings, neck = self.settings, self._board.neck.latest()
        stalled = self._stepped_s is not None and now_s - self._stepped_s > settings.silence_s
        silent = neck is None or now_s - float(neck["time_s"]) > settings.silence_s
        if silent or stalled:
            if self._silent_s is None:
                self._silent_s = now_s
                word = "worker was held up" if stalled and not silent else "show is silent"
                self._report(now_s, "NECK-SILENT", f"The {word}; the head halts.")
            return None
        if self._silent_s is not None:
            self._report(now_s, "NECK-BACK", "The show is back; the head follows it.")
            self._silent_s = None
            self._forget()
        return neck

    def _halt(self, state: bytes) -> None:
        self._forget()
        self._homing = False
        self._record["state"] = state
        self._record["halts"] += 1
        self.head.use(lambda head: head.halt())

    def _find_zero(self, allowed: bool, now_s: float) -> None:
        """allowed: somebody is in charge, as a reset swings the head through all its range."""
        if allowed and not self._homing and now_s >= self._home_s:
            self._homing = self.head.use(lambda head: head.home() or True) is not None
        self._record["state"] = b"homing" if self._homing else b"halted"

    # --- moving ---------------------------------------------------------------------------

    def limits(self) -> NeckLimits:
        """The unit's limits and ours, whichever are narrower."""
        unit, settings = self.head.device.limits, self.settings
        pairs = ((unit.pan_rad, settings.pan_deg), (unit.tilt_rad, settings.tilt_deg))
        low = [max(hard[0], math.radians(soft[0])) for hard, soft in pairs]
        high = [min(hard[1], math.radians(soft[1])) for hard, soft in pairs]
        speed = min(unit.speed_rad_s, math.radians(settings.speed_deg_s))
        return NeckLimits(
            (low[0], low[1]), (high[0], high[1]), speed, math.radians(settings.acceleration_deg_s2)
        )

    def _now_at(self, state: PanTiltState, now_s: float) -> tuple[Array, Array]:
        """Place and speed to go on from: the planned ones where there is a plan."""
        if self._trajectory is not None:
            return self._trajectory.at(now_s)
        return np.array([state.pan_rad, state.tilt_rad]), np.zeros(2)

    def _obey(self, neck: Record, state: PanTiltState, now_s: float) -> None:
        if int(neck["order"]) != self._order:
            late = now_s - float(neck["start_s"]) > _LATE_S
            place, speed = self._now_at(state, now_s)
            try:
                self._trajectory = movement(neck, place, speed, now_s, self.limits(), late)
            except HypermaskError as error:
                self._report(now_s, error.code, str(error))
            self._order = int(neck["order"])
        self._follow(state, now_s, b"following")

    def _park(self, state: PanTiltState, now_s: float) -> None:
        assert self._silent_s is not None
        if now_s - self._silent_s < self.settings.park_after_s:
            return
        if self._trajectory is None:
            place, speed = self._now_at(state, now_s)
            park = np.radians(self.settings.park_deg)
            limits = self.limits().scaled(self.settings.park_vigour)
            self._trajectory = through(place, speed, [park], now_s, limits)
        self._follow(state, now_s, b"parking")
        if now_s > self._trajectory.end_s and not state.moving:
            self._record["state"] = b"parked"

    def _follow(self, state: PanTiltState, now_s: float, word: bytes) -> None:
        """Send the unit to where the head should be in a moment, as fast as that takes."""
        if self._trajectory is None:
            self._record["state"] = b"still"
            return
        limits, ahead_s = self.limits(), self.settings.lookahead_s
        target = limits.clamp(self._trajectory.at(now_s + ahead_s)[0])
        here = np.array([state.pan_rad, state.tilt_rad])
        self._record["lag_rad"] = float(np.max(np.abs(self._trajectory.at(now_s)[0] - here)))
        speed = min(float(np.max(np.abs(target - here))) / ahead_s, limits.speed)
        self.head.use(lambda head: head.move(float(target[0]), float(target[1]), speed))
        still = now_s > self._trajectory.end_s and not state.moving
        self._record["state"] = b"still" if still else word

    def _publish(self, now_s: float, state: PanTiltState | None) -> None:
        record = self._record
        record["time_s"] = now_s
        record["ready"] = state is not None
        record["master_silent"] = self._silent_s is not None
        record["order"] = -1 if self._order is None else self._order
        if state is not None:
            record["pan_rad"], record["tilt_rad"] = state.pan_rad, state.tilt_rad
            record["homed"] = state.homed
        record["moving"] = state is not None and state.moving
        self._board.head.publish(record)
