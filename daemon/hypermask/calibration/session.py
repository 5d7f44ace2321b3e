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
from hypermask.calibration.outcome import METHODS, Cart, Method, Outcome, conclude
from hypermask.calibration.placements import Placement
from hypermask.calibration.planar import CORNERS
from hypermask.calibration.positions import Position, plan, position_at
from hypermask.calibration.procam import fit
from hypermask.calibration.quality import working_volume
from hypermask.calibration.still import Sighting, Stillness, average
from hypermask.errors import DataError, HypermaskError
from hypermask.geometry import Array
from hypermask.mask import LED_NAMES

STEPS_PX = (32, 8, 1)
LEAST_FRAMES = 8
UNSEEN_S = 0.5
NUDGES = {
    "8": (0, -1), "2": (0, 1), "4": (-1, 0), "6": (1, 0),
    "7": (-1, -1), "9": (1, -1), "1": (-1, 1), "3": (1, 1),
}  # fmt: skip


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


def planned_positions(
    cart: Cart, method: Method, poses_per_distance: int = 2, distance_m: float | None = None
) -> list[Position]:
    """Click: the best spread positions at the cart's distances. Planar: one, facing, in the
    middle of the picture at `distance_m` (default: the middle working distance)."""
    if method == "click":
        volume = working_volume(cart.mask, cart.camera, cart.nominal).weight(cart.nominal)
        return plan(
            cart.mask.leds,
            cart.camera,
            cart.nominal,
            volume,
            cart.distances_m,
            poses_per_distance,
            cart.prior,
        )
    width, height = cart.nominal.projector.size
    distances = sorted(cart.distances_m)
    distance = distance_m if distance_m is not None else distances[len(distances) // 2]
    return [position_at(cart.nominal, (width / 2, height / 2), distance)]


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
        self._pixels = _no_clicks()
        self._order: list[int] = []  # LEDs clicked or skipped at this position, in order
        self._before: set[int] = set()  # LEDs clicked here before the mask moved
        self._cross_hair = (0, 0)
        self._step = 0
        self._note = ""
        self._undo_armed = False
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
            self._cross_hair if clicking else None,
            STEPS_PX[self._step],
            self._led if clicking else None,
            self.positions[len(self.ends)] if self.phase is Phase.PLACE else None,
            tuple(line for line in (self._note, *self._lines()) if line),
        )

    def snapshot(self) -> dict[str, Any]:
        """Everything clicked so far, as a table for `storage.save_progress`."""
        pending = [self._placement()] if self._pending else []
        return {
            "method": self.method,
            "positions": [records.position_table(p) for p in self.positions],
            "placements": [records.placement_table(p) for p in [*self.placements, *pending]],
            "ends": self.ends,
            "done_here": sorted(self._before | set(self._order)),
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
            session._before = {int(n) for n in snapshot["done_here"]}
            session.key_presses = int(snapshot["key_presses"])
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(
                "CAL-READ", f"the interrupted calibration is damaged ({error})", "Start it anew."
            ) from error
        if method_is_planar(session.method):
            session._before.clear()  # its four corners must share one pose
        if len(session.ends) >= len(positions):
            session._review()
        return session

    # ---- placing

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
        self._before.clear()
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
            self._before.clear()
            self.phase = Phase.PLACE

    # ---- clicking

    @property
    def _leds(self) -> range:
        return range(CORNERS if method_is_planar(self.method) else len(LED_NAMES))

    @property
    def _led(self) -> int | None:
        left = [led for led in self._leds if led not in self._before | set(self._order)]
        return left[0] if left else None

    @property
    def _pending(self) -> bool:
        return bool(np.isfinite(self._pixels).any())

    def _click_key(self, key: str) -> None:
        if key in NUDGES:
            self._nudge(*NUDGES[key])
        elif key == "5":
            self._step = (self._step + 1) % len(STEPS_PX)
        elif key == "enter":
            self._accept()
        elif key == "0":
            self._next_led(None)
        elif key == "backspace":
            self._undo_click()
        elif key == "star":
            self._keep()
            self._review()

    def _nudge(self, right: int, down: int) -> None:
        step = STEPS_PX[self._step]
        x, y = self._cross_hair
        self._cross_hair = self._inside(x + right * step, y + down * step)

    def _accept(self) -> None:
        if not self._seen():
            self._note = "The camera does not see the mask: not accepted."
        elif len(self._still.sightings) < LEAST_FRAMES:
            self._note = "Hold the mask still, then press enter again."
        else:
            self._next_led(self._cross_hair)

    def _next_led(self, pixel: tuple[int, int] | None) -> None:
        led = self._led
        if led is None:
            return
        if pixel is not None:
            self._pixels[led] = pixel
        self._order.append(led)
        if self._led is None:
            self._finish_position("")
        else:
            self._aim()

    def _undo_click(self) -> None:
        """Back to the LED before, its cross-hair where it was; then back to placing the mask."""
        if not self._order:
            self.phase = Phase.PLACE
            return
        led = self._order.pop()
        back, self._pixels[led] = self._pixels[led].copy(), np.nan
        self._aim()
        if np.isfinite(back).all():
            self._cross_hair = self._inside(*back)

    def _moved(self) -> None:
        """The mask moved while clicking: the clicks made stay with the pose they were made at."""
        if self.phase is Phase.CLICK:
            kept = len(self._order)
            self._note = f"The mask moved by {self._still.moved_m * 1e3:.0f} mm. " + (
                self._keep_what_moved() if kept else "Hold it still."
            )
        self._still.restart()
        if self.phase is Phase.CLICK:
            self._aim()

    def _keep_what_moved(self) -> str:
        if method_is_planar(self.method):
            self._pixels, self._order = _no_clicks(), []
            return "Hold it still and click the four corners again."
        self._keep()
        return "Your clicks are kept. Hold it still for the others."

    def _keep(self) -> None:
        """The clicks of the mask's present pose become a placement."""
        if self._pending:
            self.placements.append(self._placement())
        self._before |= set(self._order)
        self._pixels, self._order = _no_clicks(), []

    def _placement(self) -> Placement:
        still = average(self._still.sightings)
        return Placement(still.pose, still.covariance, still.points, self._pixels.copy())

    def _aim(self) -> None:
        """Put the cross-hair where the LED is expected after all clicks so far."""
        led = self._led
        if led is None or not self._still.sightings:
            return
        pose = average(self._still.sightings).pose
        made = [*self.placements, *([self._placement()] if self._pending else [])]
        cart = self.cart
        procam = cart.nominal
        if made:
            procam = fit(made, cart.mask.leds, procam, cart.prior, cart.sigma_px).procam
        self._step = _first_step(sum(len(p.clicked) for p in made))
        x, y = procam.project(pose.apply(cart.mask.leds[led]))
        self._cross_hair = self._inside(x, y)

    def _inside(self, x: float, y: float) -> tuple[int, int]:
        width, height = self.cart.nominal.projector.size
        return int(np.clip(round(x), 0, width - 1)), int(np.clip(round(y), 0, height - 1))

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
        elif self.method == "click":
            suggested = self._suggest_without_result() or suggested
        if suggested is None:
            self._note = "No further position fits into the picture."
            return
        del self.positions[len(self.ends) :]
        self.positions.append(suggested)
        self._before.clear()
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
            target = self.positions[number - 1]
            now = self._latest.pose.translation if self._latest and self._seen() else None
            return words.placing(number, len(self.positions), target, now)
        if self.phase is Phase.CLICK and self._led is not None:
            done = len(self._order) + len(self._before)
            step = STEPS_PX[self._step]
            return words.clicking(self._led, done, len(self._leds), step, self._seen())
        if self.phase is Phase.DONE:
            return ["Calibration done.", *(self.outcome.lines() if self.outcome else [])]
        return words.reviewing(self.outcome, self._problem)


def method_is_planar(method: Method) -> bool:
    return method != "click"


def _first_step(clicks: int) -> int:
    """Index of the step to start with: the more clicks, the nearer the cross-hair starts."""
    return 0 if clicks == 0 else (1 if clicks < len(LED_NAMES) + 1 else 2)


def _no_clicks() -> Array:
    return np.full((len(LED_NAMES), 2), np.nan)
