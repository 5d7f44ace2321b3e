"""Calibrating while the show is on: the keypad belongs to the session, the face is dark, and the
stage lights what the session wants lit.

A click session lives on what the tracker sees, a fixed screen's on keys alone. What was done is
kept after every point: after a power cut, or when the mode was left, it goes on there. Until a new
calibration is whole and stored, the last good one stays in use.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from hypermask.calibration import storage
from hypermask.calibration.fixed import Fixed
from hypermask.calibration.outcome import Cart, Method
from hypermask.calibration.positions import Position
from hypermask.calibration.session import Phase
from hypermask.errors import DataError, HypermaskError, UsageError
from hypermask.mask import Mask
from hypermask.stage.marks import new_overlay
from hypermask.workers.background import Background, OneThread
from hypermask.workers.board import Board
from hypermask.workers.calibration_courses import ClickCourse, Course, NudgeCourse, Table
from hypermask.workers.modes import Mode
from hypermask.workers.retry import Report

NAME = "calibrate"
ANEW = "slash"
BEAT_S = 0.2
LONGEST = 160

OpenCourse = Callable[[Table | None], Course]
"""A course from a snapshot, or from the beginning; it may take a second.
Raises `DataError` CAL-READ."""


class CalibrationMode:
    """See `workers.modes.Mode`. background: where what takes long is done."""

    name = NAME

    def __init__(
        self,
        method: Method,
        open_course: OpenCourse,
        board: Board,
        report: Report,
        background: Background | None = None,
    ) -> None:
        self._method, self._open = method, open_course
        self._board, self._report = board, report
        self._background = background or OneThread()
        self.course: Course | None = None
        self._keys: deque[tuple[str, float]] = deque(maxlen=200)
        self._words = "The calibration begins in a moment."
        self._note = ""
        self._anew = False
        self._failed: HypermaskError | None = None
        self._kept: Table | None = None
        self._stored: str | None = None
        self._said_s = -np.inf

    # --- the mode -------------------------------------------------------------------------

    def begin(self, now_s: float) -> None:
        snapshot = self._interrupted(now_s)
        self._do(lambda: self._enter(snapshot))
        self._show(now_s)

    def press(self, key: str, now_s: float) -> None:
        self._keys.append((key, now_s))
        self._work(now_s)

    def step(self, now_s: float) -> bool:
        self._work(now_s)
        if self._failed is not None:
            failed, self._failed = self._failed, None
            raise failed
        if self._stored is not None and not self._background.busy:
            self._report(now_s, "CAL-DONE", f"{self._method}: {self._stored}")
            return False
        if self.course is not None and not self._background.busy:
            self.course.look(self._board.track.latest(), now_s)
        self._show(now_s)
        return True

    def words(self) -> str:
        if self.course is not None and not self._background.busy:
            lines = self.course.view().lines
            first = [self._note] if self._note else []
            self._words = "\n".join([*first, *lines[:2]])
        return self._words[:LONGEST]

    def end(self, now_s: float) -> None:
        self._board.overlay.publish(new_overlay(now_s, False))

    # --- its work -------------------------------------------------------------------------

    def _interrupted(self, now_s: float) -> Table | None:
        """What was done before the power went, or before the mode was left."""
        try:
            snapshot = storage.load_progress()
        except DataError as error:
            self._report(now_s, error.code, f"{error} It begins anew.")
            return None
        return snapshot if snapshot is not None and snapshot.get("method") == self._method else None

    def _enter(self, snapshot: Table | None) -> None:
        try:
            self.course = self._open(snapshot)
        except DataError as error:
            if snapshot is None or error.code != "CAL-READ":
                raise
            self.course, snapshot = self._open(None), None
        self._kept = self.course.snapshot()
        self._note = "It goes on where it was left. slash twice: anew." if snapshot else ""

    def _work(self, now_s: float) -> None:
        """The keys that wait, one after another, unless one of them is being worked on."""
        while self._keys and self.course is not None and not self._background.busy:
            if self._stored is not None or self._failed is not None:
                self._keys.clear()
                return
            key, time_s = self._keys.popleft()
            self._note = ""
            if key == ANEW:
                self._start_anew()
                continue
            self._anew = False
            self._do(partial(self._press, self.course, key, time_s))
            self._show(now_s)

    def _start_anew(self) -> None:
        if not self._anew:
            self._anew = True
            self._note = "slash again: forget all points and start anew."
            return
        self._anew = False
        storage.clear_progress()
        self._do(lambda: self._enter(None))

    def _press(self, course: Course, key: str, time_s: float) -> None:
        course.key(key, time_s)
        if course.phase is Phase.DONE:
            self._store(course)
            return
        if key in ("enter", "0", "backspace", "star", "plus"):
            now = course.snapshot()
            if _done(now) != _done(self._kept):
                storage.save_progress(now)
            self._kept = now

    def _store(self, course: Course) -> None:
        outcome = course.outcome
        assert outcome is not None
        path = storage.save(outcome, course.method)
        storage.clear_progress()
        self._stored = f"{path.name}; " + "; ".join(outcome.lines())

    def _do(self, action: Callable[[], None]) -> None:
        def guarded() -> None:
            try:
                action()
            except HypermaskError as error:
                self._failed = error

        self._background.start(guarded)

    def _show(self, now_s: float) -> None:
        """Light what the course wants lit; the face stays dark as long as this is said anew."""
        if self.course is None or self._background.busy:
            if now_s - self._said_s >= BEAT_S:
                record = self._board.overlay.latest()
                record = new_overlay(now_s, True) if record is None else record.copy()
                record["time_s"], record["on"] = now_s, True
                self._board.overlay.publish(record)
                self._said_s = now_s
            return
        cross = self.course.view().cross_hair
        self._board.overlay.publish(new_overlay(now_s, True, cross, self.course.marks()))
        self._said_s = now_s


def _done(snapshot: Table | None) -> Table:
    """A snapshot without what changes by every nudge."""
    return {key: value for key, value in (snapshot or {}).items() if key != "key_presses"}


@dataclass(frozen=True)
class Subject:
    """What there is to calibrate. cart: None without a camera; screen: None where nothing is fixed
    to the projector. mapping: as in the machine file. Asked for only when a mode begins."""

    mapping: str
    mask: Callable[[], Mask]
    cart: Callable[[], Cart] | None = None
    screen: Callable[[], Fixed] | None = None


_DEFAULT: dict[str, Method] = {
    "procam": "click",
    "planar": "affine",
    "planar_projective": "projective",
    "fixed": "fixed",
}


def calibration_modes(
    subject: Subject,
    board: Board,
    report: Report,
    background: Background | None = None,
    positions: Sequence[Position] | None = None,
) -> dict[str, Callable[[], Mode]]:
    """`calibrate`, the machine's own method, and `calibrate-METHOD` for each that it can do."""
    opens: dict[Method, OpenCourse] = {}
    cart, screen = subject.cart, subject.screen
    if subject.mapping == "fixed" and screen is not None:
        opens["fixed"] = lambda snapshot: NudgeCourse(screen(), subject.mask(), snapshot)
    elif cart is not None:
        for method in ("click", "affine", "projective"):
            opens[method] = _clicking(cart, method, positions)

    def made(method: Method) -> Callable[[], Mode]:
        return lambda: CalibrationMode(method, opens[method], board, report, background)

    default = _DEFAULT[subject.mapping]
    modes = {f"{NAME}-{method}": made(method) for method in opens}
    modes[NAME] = made(default) if default in opens else _impossible
    return modes


def _clicking(
    cart: Callable[[], Cart], method: Method, positions: Sequence[Position] | None
) -> OpenCourse:
    return lambda snapshot: ClickCourse(cart(), method, snapshot, positions)


def _impossible() -> Mode:
    raise UsageError(
        "CAL-CAMERA",
        "this machine has no camera, and its mask is not fixed to the projector",
        'Correct the machine file: a [camera], or mapping = "fixed".',
    )
