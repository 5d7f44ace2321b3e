"""The operator's way through a calibration: pure logic of keys, tracked poses and time.

Keys: 8 2 4 6 (and 7 9 1 3 for the diagonals) nudge the cross-hair, 5 changes the step, enter
accepts, backspace undoes, 0 skips, plus adds the suggested position, star ends early. The session
says what to draw and what to tell the operator; it draws nothing and reads no device. Each click
is kept the moment it is made, and `snapshot` holds everything needed to go on another day.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from hypermask.calibration import records, words
from hypermask.calibration.clicking import NUDGES, STEPS_PX, Clicking
from hypermask.calibration.outcome import METHODS, Cart, Method, Outcome, conclude
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.placements import Placement
from hypermask.calibration.planar import CORNERS
from hypermask.calibration.planned import method_is_planar, planned_positions
from hypermask.calibration.positions import Position, fits, recentred
from hypermask.calibration.procam import fit
from hypermask.calibration.still import Sighting, Stillness, average
from hypermask.errors import DataError, HypermaskError
from hypermask.geometry import Pose
from hypermask.mask import LED_NAMES

__all__ = ["LEAST_FRAMES", "STEPS_PX", "Phase", "Session", "View", "planned_positions"]

LEAST_FRAMES = 8
UNSEEN_S = 0.5


class Phase(Enum):
    PLACE = "place"  # the mask is brought to the next position
    CLICK = "click"  # the cross-hair is laid on the LEDs
    REVIEW = "review"  # the result is shown, to be accepted
    DONE = "done"


@dataclass(frozen=True)
class View:
    """What to draw: cross_hair: projector pixel or None; led: index of the LED it belongs on;
    target: where to put the mask; lines: hints for the operator, the most important first."""

    phase: Phase
    cross_hair: tuple[int, int] | None
    step_px: int
    led: int | None
    target: Position | None
    lines: tuple[str, ...]


class Session:
    """Feed `sighting` and `key`; show `view()`; when `phase` is DONE read `outcome`."""

    def __init__(
        self, cart: Cart, method: Method = "click", positions: Sequence[Position] | None = None
    ) -> None:
        self.cart = cart
        self.method = method
        self.positions = list(
            positions if positions is not None else planned_positions(cart, method)
        )
        self.placements: list[Placement] = []
        self.ends: list[int] = []  # number of placements at the end of each finished position
        self.phase = Phase.PLACE if self.positions else Phase.REVIEW
        self.outcome: Outcome | None = None
        self.key_presses = 0
        self._still = Stillness(cart.mask.leds, cart.camera)
        self._latest: Sighting | None = None
        self._now = 0.0
        self._seen_at = 0.0
        count = CORNERS if method_is_planar(method) else len(LED_NAMES)
        self._clicks = Clicking(cart.nominal.projector.size, range(count))
        self._note = ""
        self._undo_armed = False
        self._asked: tuple[tuple[int, int], Position] | None = None
        self._problem: HypermaskError | None = None

    # ---- inputs

    def sighting(self, sighting: Sighting | None, time_s: float) -> None:
        """A tracked frame, or None for a frame in which the mask was not seen."""
        self._now = max(self._now, time_s)
        if sighting is None:
            return
        self._latest, self._seen_at = sighting, self._now
        if self.phase in (Phase.PLACE, Phase.CLICK) and self._still.add(sighting):
            self._moved()

    def key(self, key: str, time_s: float) -> None:
        """A key was pressed (names as in the keypad's interface); unknown keys do nothing."""
        self._now = max(self._now, time_s)
        self.key_presses += 1
        self._note = ""
        armed, self._undo_armed = self._undo_armed, False
        if self.phase is Phase.PLACE:
            self._place_key(key, armed)
        elif self.phase is Phase.CLICK:
            self._click_key(key)
        elif self.phase is Phase.REVIEW:
            self._review_key(key, armed)

    def settle(self) -> None:
        """Aim anew with all frames seen since the mask was placed."""
        if self.phase is Phase.CLICK:
            self._aim()

    # ---- output

    @property
    def now_s(self) -> float:
        """The latest time heard of."""
        return self._now

    @property
    def ready(self) -> bool:
        """Whether a click would be accepted now."""
        seen = len(self._still.sightings) >= LEAST_FRAMES
        return self.phase is Phase.CLICK and self._seen() and seen

    @property
    def problem(self) -> HypermaskError | None:
        """Why the clicks under review give no calibration."""
        return self._problem if self.phase is Phase.REVIEW else None

    def view(self) -> View:
        clicking = self.phase is Phase.CLICK
        return View(
            self.phase,
            self._clicks.cross_hair if clicking else None,
            self._clicks.step_px,
            self._clicks.led if clicking else None,
            self._target if self.phase is Phase.PLACE else None,
            tuple(line for line in (self._note, *self._lines()) if line),
        )

    def snapshot(self) -> dict[str, Any]:
        """Everything clicked so far, as a table for `storage.save_progress`."""
        pending = [self._placement()] if self._clicks.pending else []
        return {
            "method": self.method,
            "positions": [records.position_table(p) for p in self.positions],
            "placements": [records.placement_table(p) for p in [*self.placements, *pending]],
            "ends": self.ends,
            "done_here": sorted(self._clicks.before.union(self._clicks.order)),
            "key_presses": self.key_presses,
        }

    @classmethod
    def resume(cls, cart: Cart, snapshot: dict[str, Any]) -> Session:
        """Go on where `snapshot` was taken. The clicks of an unfinished position are kept; its
        other LEDs are clicked anew, for the mask has moved since.

        Raises `DataError` CAL-READ where the table is not a session's.
        """
        try:
            if snapshot["method"] not in METHODS:
                raise ValueError(f"unknown method {snapshot['method']!r}")
            positions = [records.position_from(table) for table in snapshot["positions"]]
            session = cls(cart, snapshot["method"], positions)
            session.placements = [records.placement_from(t) for t in snapshot["placements"]]
            session.ends = [int(n) for n in snapshot["ends"]]
            session._clicks.before = {int(n) for n in snapshot["done_here"]}
            session.key_presses = int(snapshot["key_presses"])
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(
                "CAL-READ", f"the interrupted calibration is damaged ({error})", "Start it anew."
            ) from error
        if method_is_planar(session.method):
            session._clicks.before.clear()  # its four corners must share one pose
        if len(session.ends) >= len(positions):
            session._review()
        return session

    # ---- placing

    @property
    def _target(self) -> Position:
        """The position asked for, moved to where the clicks so far say its pixels are."""
        planned = self.positions[len(self.ends)]
        if not self.placements or method_is_planar(self.method):
            return planned
        key = (len(self.ends), len(self.placements))
        if self._asked is None or self._asked[0] != key:
            better = recentred(planned, self.cart.nominal, self._fitted(self.placements))
            pose, cart = better.camera_from_mask(), self.cart
            seen = fits(pose, cart.mask.leds, (cart.camera, Pose.identity()))
            self._asked = (key, better if seen else planned)
        return self._asked[1]

    def _fitted(self, made: Sequence[Placement]) -> ProCam:
        cart = self.cart
        return fit(made, cart.mask.leds, cart.nominal, cart.prior, cart.sigma_px).procam

    def _place_key(self, key: str, armed: bool) -> None:
        if key == "enter":
            self._begin()
        elif key == "0":
            self._finish_position("Position skipped.")
        elif key == "star":
            self._review()
        elif key == "backspace":
            self._undo_position(armed)

    def _begin(self) -> None:
        if not self._seen():
            self._note = "The camera does not see the mask. Turn it to the cart, LEDs on."
            return
        self._still.restart()
        if self._latest is not None:
            self._still.add(self._latest)
        self.phase = Phase.CLICK
        self._aim()

    def _finish_position(self, note: str) -> None:
        self._keep()
        self.ends.append(len(self.placements))
        self._clicks.before.clear()
        self._note = note
        self._still.restart()
        if len(self.ends) >= len(self.positions):
            self._review()
        else:
            self.phase = Phase.PLACE

    def _undo_position(self, armed: bool) -> None:
        """Back to the position before; asks twice, for its clicks are lost."""
        if not self.ends:
            self._note = "There is nothing to undo."
        elif not armed:
            self._undo_armed = True
            self._note = f"Press backspace again to do position {len(self.ends)} anew."
        else:
            self.ends.pop()
            del self.placements[self.ends[-1] if self.ends else 0 :]
            self._clicks.before.clear()
            self.phase = Phase.PLACE

    # ---- clicking

    def _click_key(self, key: str) -> None:
        if key in NUDGES:
            self._clicks.nudge(*NUDGES[key])
        elif key == "5":
            self._clicks.next_step()
        elif key == "enter":
            self._accept()
        elif key == "0":
            self._next_led(False)
        elif key == "backspace":
            self._undo_click()
        elif key == "star":
            self._keep()
            self._review()

    def _accept(self) -> None:
        if not self._seen():
            self._note = "The camera does not see the mask: not accepted."
        elif len(self._still.sightings) < LEAST_FRAMES:
            self._note = "Hold the mask still, then press enter again."
        else:
            self._next_led(True)

    def _next_led(self, accepted: bool) -> None:
        self._clicks.take(accepted)
        if self._clicks.led is None:
            self._finish_position("")
        else:
            self._aim()

    def _undo_click(self) -> None:
        """Back to the LED before, its cross-hair where it was; then back to placing the mask."""
        if not self._clicks.order:
            self.phase = Phase.PLACE
            return
        back = self._clicks.take_back()
        self._aim()
        if back is not None:
            self._clicks.put(*back)

    def _moved(self) -> None:
        """The mask moved while clicking: the clicks made stay with the pose they were made at."""
        if self.phase is Phase.CLICK:
            kept = len(self._clicks.order)
            self._note = f"The mask moved by {self._still.moved_m * 1e3:.0f} mm. " + (
                self._keep_what_moved() if kept else "Hold it still."
            )
        self._still.restart()
        if self.phase is Phase.CLICK:
            self._aim()

    def _keep_what_moved(self) -> str:
        if method_is_planar(self.method):
            self._clicks.drop()
            return "Hold it still and click the four corners again."
        self._keep()
        return "Your clicks are kept. Hold it still for the others."

    def _keep(self) -> None:
        """The clicks of the mask's present pose become a placement."""
        if self._clicks.pending:
            self.placements.append(self._placement())
        self._clicks.close()

    def _placement(self) -> Placement:
        still = average(self._still.sightings)
        return Placement(still.pose, still.covariance, still.points, self._clicks.pixels.copy())

    def _aim(self) -> None:
        """Put the cross-hair where the LED is expected after all clicks so far."""
        led = self._clicks.led
        if led is None or not self._still.sightings:
            return
        pose = average(self._still.sightings).pose
        made = [*self.placements, *([self._placement()] if self._clicks.pending else [])]
        procam = self._fitted(made) if made else self.cart.nominal
        self._clicks.first_step(sum(len(p.clicked) for p in made))
        self._clicks.put(*procam.project(pose.apply(self.cart.mask.leds[led])))

    def _seen(self) -> bool:
        return self._latest is not None and self._now - self._seen_at <= UNSEEN_S

    # ---- reviewing

    def _review(self) -> None:
        self.phase = Phase.REVIEW
        self.outcome, self._problem = None, None
        try:
            self.outcome = conclude(self.method, self.placements, self.cart)
        except HypermaskError as error:
            self._problem = error

    def _review_key(self, key: str, armed: bool) -> None:
        if key == "enter" and self.outcome is not None:
            self.phase = Phase.DONE
        elif key in ("plus", "enter"):
            self._add_position()
        elif key == "backspace":
            if len(self.ends) < len(self.positions):
                self.phase = Phase.PLACE
            else:
                self._undo_position(armed)

    def _add_position(self) -> None:
        """One more position: the one that helps most, or the first one again."""
        suggested = self.positions[-1] if self.positions else None
        if self.outcome is not None and self.outcome.quality is not None:
            suggested = self.outcome.quality.add
            if suggested is not None:  # positions are kept as planned for the nominal projector
                fitted = self._fitted(self.placements)
                suggested = recentred(suggested, fitted, self.cart.nominal)
        elif self.method == "click":
            suggested = self._suggest_without_result() or suggested
        if suggested is None:
            self._note = "No further position fits into the picture."
            return
        del self.positions[len(self.ends) :]
        self.positions.append(suggested)
        self._clicks.before.clear()
        self.phase = Phase.PLACE

    def _suggest_without_result(self) -> Position | None:
        """A planned position at the distance farthest from those clicked."""
        depths = [float(p.pose.translation[2]) for p in self.placements]
        planned = planned_positions(self.cart, self.method, 1)
        return max(
            planned,
            key=lambda p: min((abs(np.log(p.distance_m / d)) for d in depths), default=0.0),
            default=None,
        )

    # ---- words

    def _lines(self) -> list[str]:
        if self.phase is Phase.PLACE:
            number = len(self.ends) + 1
            target = self._target
            now = self._latest.pose.translation if self._latest and self._seen() else None
            return words.placing(number, len(self.positions), target, now)
        led = self._clicks.led
        if self.phase is Phase.CLICK and led is not None:
            done, total = self._clicks.done, len(self._clicks.leds)
            return words.clicking(led, done, total, self._clicks.step_px, self._seen())
        if self.phase is Phase.DONE:
            return ["Calibration done.", *(self.outcome.lines() if self.outcome else [])]
        return words.reviewing(self.outcome, self._problem)
