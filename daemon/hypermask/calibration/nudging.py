"""The operator's way through the calibration of a fixed screen: control points and keys.

One point after another is lit as a cross-hair; the operator brings its light on to the mark on the
screen. Keys as in a session of clicks: 8 2 4 6 (and 7 9 1 3) move the light up, down, left and
right as he sees the screen from the front, 5 changes the step, enter accepts, backspace undoes,
0 skips, star ends early. Pure logic: it draws nothing and reads no device.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hypermask.calibration.clicking import NUDGES, STEPS_PX
from hypermask.calibration.fixed import LEAST_POINTS, Fixed, control_points, fit, solve
from hypermask.calibration.outcome import Outcome
from hypermask.calibration.session import Phase, View
from hypermask.errors import DataError, HypermaskError
from hypermask.geometry import Array
from hypermask.mask import Mask

METHOD = "fixed"
_SIGMA_PX = 1.5
_NEAR_M = 0.012


class Nudging:
    """Feed `key`; show `view()`; when `phase` is DONE read `outcome`.

    nominal: what the builder knows of lens and place.
    """

    def __init__(self, nominal: Fixed, mask: Mask, points: Array | None = None) -> None:
        self.nominal, self.mask = nominal, mask
        self.points = control_points(mask) if points is None else points
        self.pixels = np.full((len(self.points), 2), np.nan)
        self.order: list[int] = []  # points accepted or skipped
        self.phase = Phase.CLICK
        self.outcome: Outcome | None = None
        self.key_presses = 0
        self._step = 0
        self._cross = (0, 0)
        self._note = ""
        self._problem: HypermaskError | None = None
        self._fitted = nominal
        self._signs = _signs(nominal, self.points[0])
        self._aim()

    # ---- inputs

    def key(self, key: str, time_s: float) -> None:
        """A key was pressed (names as in the keypad's interface); unknown keys do nothing."""
        self.key_presses += 1
        self._note = ""
        if self.phase is Phase.CLICK:
            self._click_key(key)
        elif self.phase is Phase.REVIEW:
            self._review_key(key)

    # ---- output

    @property
    def point(self) -> int | None:
        """The next point, None when all are done."""
        return next((i for i in range(len(self.points)) if i not in self.order), None)

    @property
    def problem(self) -> HypermaskError | None:
        """Why the points under review give no calibration."""
        return self._problem if self.phase is Phase.REVIEW else None

    def view(self) -> View:
        clicking = self.phase is Phase.CLICK
        lines = tuple(line for line in (self._note, *self._lines()) if line)
        cross = self._cross if clicking else None
        step = STEPS_PX[self._step]
        return View(self.phase, cross, step, self.point if clicking else None, None, lines)

    def marks(self) -> Array:
        """(n, 2) pixels of the points that are lit faintly: those done, in the review all where
        the result puts them."""
        if self.phase is Phase.REVIEW and self.outcome is not None:
            assert isinstance(self.outcome.calibration, Fixed)
            return self.outcome.calibration.project(self.points)
        return np.asarray(self.pixels[np.isfinite(self.pixels).all(axis=1)])

    def snapshot(self) -> dict[str, Any]:
        """Everything done so far, as a table for `storage.save_progress`."""
        pixels = [None if not np.isfinite(p).all() else [float(v) for v in p] for p in self.pixels]
        points = [[float(v) for v in point] for point in self.points]
        presses = self.key_presses
        return {
            "method": METHOD,
            "points_m": points,
            "pixels_px": pixels,
            "order": self.order,
            "key_presses": presses,
        }

    @classmethod
    def resume(cls, nominal: Fixed, mask: Mask, snapshot: dict[str, Any]) -> Nudging:
        """Go on where `snapshot` was taken. Raises `DataError` CAL-READ."""
        try:
            if snapshot["method"] != METHOD:
                raise ValueError(f"the method is {snapshot['method']!r}")
            points = np.array(snapshot["points_m"], float).reshape(-1, 3)
            session = cls(nominal, mask, points)
            for index, pixel in enumerate(snapshot["pixels_px"]):
                if pixel is not None:
                    session.pixels[index] = [float(pixel[0]), float(pixel[1])]
            session.order = [int(n) for n in snapshot["order"]]
            session.key_presses = int(snapshot["key_presses"])
            if not all(0 <= n < len(points) for n in session.order):
                raise ValueError("it names points that are not there")
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise DataError(
                "CAL-READ", f"the interrupted calibration is damaged ({error})", "Start it anew."
            ) from error
        session._refit()
        session._next()
        return session

    # ---- one point

    def _click_key(self, key: str) -> None:
        if key in NUDGES:
            right, down = NUDGES[key]
            step = STEPS_PX[self._step]
            self._put(
                self._cross[0] + right * step * self._signs[0],
                self._cross[1] + down * step * self._signs[1],
            )
        elif key == "5":
            self._step = (self._step + 1) % len(STEPS_PX)
        elif key in ("enter", "0"):
            self._take(key == "enter")
        elif key == "backspace":
            self._undo()
        elif key == "star":
            self._review()

    def _put(self, x: float, y: float) -> None:
        width, height = self.nominal.lens.size
        self._cross = (
            int(np.clip(round(x), 0, width - 1)),
            int(np.clip(round(y), 0, height - 1)),
        )

    def _take(self, accepted: bool) -> None:
        point = self.point
        assert point is not None
        self.order.append(point)
        if accepted:
            self.pixels[point] = self._cross
            self._refit()
        self._next()

    def _next(self) -> None:
        if self.point is None:
            self._review()
        else:
            self.phase = Phase.CLICK
            self._aim()

    def _undo(self) -> None:
        """Back to the point before, its light where it was."""
        if not self.order:
            self._note = "There is nothing to undo."
            return
        back = self.order.pop()
        before = self.pixels[back].copy()
        self.pixels[back] = np.nan
        self.phase = Phase.CLICK
        self._refit()
        self._aim()
        if np.isfinite(before).all():
            self._put(float(before[0]), float(before[1]))

    def _refit(self) -> None:
        done = np.isfinite(self.pixels).all(axis=1)
        self._fitted = (
            fit(self.points[done], self.pixels[done], self.nominal, _SIGMA_PX)
            if done.any()
            else self.nominal
        )

    def _aim(self) -> None:
        """Light the point where it is expected after all so far, with a step that fits."""
        point = self.point
        if point is None:
            return
        self._put(*(float(v) for v in self._fitted.project(self.points[point][None])[0]))
        done = int(np.isfinite(self.pixels).all(axis=1).sum())
        self._step = 0 if done == 0 else (1 if done <= 4 else 2)

    # ---- review

    def _review(self) -> None:
        self.phase = Phase.REVIEW
        self.outcome, self._problem = None, None
        done = np.isfinite(self.pixels).all(axis=1)
        numbers = np.flatnonzero(done)
        try:
            found = solve(self.points[done], self.pixels[done], self.nominal, self.mask, _SIGMA_PX)
        except HypermaskError as error:
            self._problem = error
            return
        notes = tuple(f"left out: point {numbers[index] + 1}" for index in found.left_out)
        self.outcome = Outcome(found.fixed, None, (), notes)

    def _review_key(self, key: str) -> None:
        if key == "enter" and self.outcome is not None:
            self.phase = Phase.DONE
        elif key in ("backspace", "enter"):
            if self.point is not None:
                self._next()
            else:
                self._undo()

    # ---- words

    def _lines(self) -> list[str]:
        if self.phase is Phase.REVIEW:
            if self._problem is not None:
                return [str(self._problem), "backspace: go on"]
            assert self.outcome is not None
            return [*self.outcome.lines(), "enter: accept   backspace: back"]
        if self.phase is not Phase.CLICK or self.point is None:
            return []
        return [
            f"Bring the cross on to mark {self.point + 1} of {len(self.points)}, "
            f"{_place(self.points[self.point])}",
            f"8 2 4 6: move   5: step ({STEPS_PX[self._step]})   enter: accept   "
            "backspace: undo   0: skip   star: end",
        ]


def _signs(nominal: Fixed, point: Array) -> tuple[int, int]:
    """Which way pixels run when the light moves right and down on the screen."""
    ahead, here = nominal.project(np.stack([point + np.array([1e-3, -1e-3, 0]), point]))
    return (1 if ahead[0] >= here[0] else -1), (1 if ahead[1] >= here[1] else -1)


def _place(point: Array) -> str:
    x, y = (float(v) for v in point[:2])
    if max(abs(x), abs(y)) < _NEAR_M:
        return "in the middle"
    words = []
    if abs(x) >= _NEAR_M:
        words.append(f"{abs(x) * 100:.0f} cm {'right' if x > 0 else 'left'}")
    if abs(y) >= _NEAR_M:
        words.append(f"{abs(y) * 100:.0f} cm {'up' if y > 0 else 'down'}")
    return ", ".join(words) + " of the middle"


__all__ = ["LEAST_POINTS", "METHOD", "Nudging"]
