"""The stream workers: the blackboard of one hypermask on to that of another.

The sender reads what the others publish. The receiver publishes in the place of a voice worker,
and, if asked to, of a show worker and of a tracker: never run it beside the one it stands for.
"""

from __future__ import annotations

from collections import Counter
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hypermask.blackboard import Record
from hypermask.errors import HypermaskError
from hypermask.geometry import Pose
from hypermask.show.scene import units_at
from hypermask.stage.scene import live_mouth
from hypermask.stream.guard import Guard
from hypermask.stream.mouth_code import MOUTHS, PARAMETERS
from hypermask.stream.packet import (
    LARGEST,
    LAST_BLOCK,
    MOUTH_S,
    Block,
    Refused,
    decode,
    encode,
)
from hypermask.stream.playout import Performance, Playout, State
from hypermask.stream.settings import ReceiveSettings, SendSettings
from hypermask.tracking.motion import MotionFilter, predict
from hypermask.workers.board import MOUTH, TRACK, Board
from hypermask.workers.retry import Report
from hypermask_drivers.clock import Clock

_UNSEEN_S = 0.3
_EARLY_S = 1e-6
_AT_ONCE = 64
_SPREAD = np.diag([1e-5, 1e-5, 1e-5, 1e-6, 1e-6, 1e-6])
_LEAST_CHANGE = 1 / 128


class Sending(Protocol):
    largest: int

    def send(self, data: bytes) -> None: ...


class Receiving(Protocol):
    def receive(self) -> tuple[bytes, str] | None: ...

    def wait(self, seconds: float) -> None: ...


class StreamSender:
    """Samples the blackboard every 20 ms; a datagram every 80 ms, never more."""

    def __init__(
        self,
        link: Sending,
        board: Board,
        clock: Clock,
        report: Report,
        session: int,
        settings: SendSettings | None = None,
        key: bytes | None = None,
    ) -> None:
        self._link, self._board, self._clock, self._report = link, board, clock, report
        self._settings, self._key = settings or SendSettings(), key
        self._session, self._start_s = session, clock.now()
        self._tick = 0
        self._mouths = np.zeros((MOUTHS, PARAMETERS))
        self._before: tuple[int, NDArray[np.float64]] = (-2, self._mouths)
        self._failing = False
        self.sent = self.sent_bytes = 0

    def step(self, timeout_s: float = 0.0) -> bool:
        """Sample when it is time; True when a datagram was due."""
        self._clock.sleep_until(min(self._due_s(), self._clock.now() + timeout_s))
        now_s = self._clock.now()
        if now_s < self._due_s() - _EARLY_S:
            return False
        mouth = self._mouth(now_s)
        last = int((now_s - self._start_s) / MOUTH_S + _EARLY_S / MOUTH_S)
        self._tick = max(self._tick, last - last % MOUTHS)  # what nobody sampled is over
        while self._tick <= last:
            self._mouths[self._tick % MOUTHS] = mouth
            self._tick += 1
        if self._tick % MOUTHS:
            return False
        self._send(self._tick // MOUTHS - 1, now_s)
        return True

    def _due_s(self) -> float:
        return self._start_s + self._tick * MOUTH_S

    def _send(self, number: int, now_s: float) -> None:
        if number > LAST_BLOCK:
            self._session, self._start_s, self._tick, number = self._session + 1, now_s, 0, 0
        block = Block(
            self._session,
            number,
            self._mouths,
            self._before[1] if self._before[0] == number - 1 else None,
            self._units(now_s),
            self._head(now_s),
            self._level_db(),
        )
        data = encode(block, self._key, min(self._link.largest, LARGEST))
        self._before = (number, self._mouths.copy())
        try:
            self._link.send(data)
        except HypermaskError as error:
            if not self._failing:
                self._report(now_s, error.code, str(error))
            self._failing = True
            return
        if self._failing:
            self._report(now_s, "STREAM-SENDS", "The stream is sent again.")
        self._failing = False
        self.sent += 1
        self.sent_bytes += len(data)

    def _mouth(self, now_s: float) -> NDArray[np.float64]:
        record = self._board.mouth.latest() if self._settings.mouth else None
        if record is None:
            return np.zeros(PARAMETERS)
        return live_mouth(record["parameters"], now_s - float(record["time_s"]))

    def _level_db(self) -> float:
        record = self._board.mouth.latest()
        level_db = -100.0 if record is None else float(record["level_db"])
        return level_db if np.isfinite(level_db) else -100.0

    def _units(self, now_s: float) -> NDArray[np.float64] | None:
        scene = self._board.scene.latest() if self._settings.expression else None
        return None if scene is None else units_at(scene, now_s)

    def _head(self, now_s: float) -> Pose | None:
        track = self._board.track.latest() if self._settings.head else None
        if track is None or not track["motion"]["samples"]:
            return None
        if now_s - float(track["seen_s"]) > _UNSEEN_S:
            return None
        return predict(track["motion"], now_s).pose


class StreamReceiver:
    """Plays another's stream on to the blackboard; see `ReceiveSettings`.

    scene: the local show's, whose expression is the other's from now on; None leaves it alone.
    """

    def __init__(
        self,
        link: Receiving,
        board: Board,
        clock: Clock,
        report: Report,
        settings: ReceiveSettings | None = None,
        key: bytes | None = None,
        guard: Guard | None = None,
        scene: Record | None = None,
    ) -> None:
        self._link, self._board, self._clock, self._report = link, board, clock, report
        self._settings, self._key = settings or ReceiveSettings(), key
        self._guard = guard or Guard(key is not None)
        self._playout = Playout(self._settings.buffer_ms * 1e-3)
        self._motion, self._track = MotionFilter(), np.zeros((), TRACK)
        self._track["seen_s"] = -np.inf
        self._scene = None if scene is None else scene.copy()
        self._state: State = "absent"
        self._complained: set[str] = set()
        self.received = 0
        self.refused: Counter[str] = Counter()

    def step(self, timeout_s: float = 0.0) -> bool:
        """Take what came and publish what is to be seen now; False when nothing came."""
        if timeout_s > 0:
            self._link.wait(timeout_s)
        came = False
        for _ in range(_AT_ONCE):
            item = self._link.receive()
            if item is None:
                break
            came = self._take(*item) or came
        self._publish(self._clock.now())
        return came

    def status(self) -> dict[str, Any]:
        return {
            "state": self._playout.state(self._clock.now()),
            "received": self.received,
            "refused": dict(self.refused),
        }

    def _take(self, data: bytes, address: str) -> bool:
        now_s = self._clock.now()
        try:
            block = decode(data, self._key)
        except Refused as error:
            self._refuse(error.why, address, now_s)
            return False
        lost = self._playout.state(now_s) != "playing"
        if not self._guard.begins(block.session, address, lost):
            self._refuse("session", address, now_s)
            return False
        if not self._guard.is_new(block.session, block.number, address):
            self._refuse("again", address, now_s)
            return False
        if not self._playout.add(block, now_s):
            self._refuse("time", address, now_s)
            return False
        self.received += 1
        return True

    def _refuse(self, why: str, address: str, now_s: float) -> None:
        self.refused[why] += 1
        words = _REFUSALS.get(why)
        if words is not None and why not in self._complained:
            self._complained.add(why)
            self._report(now_s, f"STREAM-{why.upper()}", words.format(address))

    def _publish(self, now_s: float) -> None:
        seen = self._playout.at(now_s)
        if seen.state != self._state:
            self._report(now_s, *_STATES[seen.state])
            self._state = seen.state
        if seen.state == "absent":
            return
        settings = self._settings
        if settings.mouth:
            record = np.zeros((), MOUTH)
            record["time_s"], record["level_db"] = now_s, seen.level_db
            record["parameters"] = seen.mouth
            self._board.mouth.publish(record)
        if settings.expression and self._scene is not None:
            self._show(self._scene, seen, now_s)
        if settings.head:
            self._move(seen.head, now_s)

    def _show(self, scene: Record, seen: Performance, now_s: float) -> None:
        """The units as they are now; fades were worked out where they were performed."""
        if scene["frames"] and np.abs(scene["frame_units"][0] - seen.units).max() < _LEAST_CHANGE:
            return
        scene["mood"], scene["frames"] = b"stream", 1
        scene["frame_times"][0], scene["frame_units"][0] = 0.0, seen.units
        scene["previous_units"], scene["expression_fade"] = 0.0, (now_s, 0.0)
        self._board.scene.publish(scene)

    def _move(self, head: Pose | None, now_s: float) -> None:
        track = self._track
        track["locked"], track["time_s"] = head is not None, now_s
        if head is not None:
            self._motion.update(now_s, head, _SPREAD)
            track["motion"], track["seen_s"] = self._motion.record(), now_s
            track["frames"] += 1
        self._board.track.publish(track)


_STATES: dict[State, tuple[str, str]] = {
    "playing": ("STREAM-PLAYS", "The stream plays."),
    "lost": ("STREAM-LOST", "The stream stopped. The mouth is closed; it goes on by itself."),
    "absent": ("STREAM-ABSENT", "There is no stream yet."),
}
_REFUSALS = {
    "version": "The stream from {} is of another version. Install the same version on both sides.",
    "key": "The stream from {} has another key, or one side has none. Give both the same key.",
    "session": "A second stream, from {}, is left out while the first one plays.",
}
