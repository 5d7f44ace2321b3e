"""The simulated human of a calibration: places the mask and lays cross-hairs on its LEDs by keys.

He is imprecise in aim, not only in steps of a pixel: for every LED he takes a point beside it for
the LED, `error_px` an axis (one sigma), and nudges until the cross-hair's light covers that.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask_sim.surface import Surface

Array = NDArray[np.float64]
Look = Callable[[tuple[float, float], int], ArrayLike]
"""(cross-hair's projector pixel, LED index) -> (2,) how far right and down of the cross-hair's
light the LED lies, seen in the world, in units of the projector's pixels."""

TOO_MANY_PRESSES = 500


def true_look(
    projector_matrix: ArrayLike,
    projector_from_camera: tuple[ArrayLike, ArrayLike],
    leds: ArrayLike,
    camera_from_mask: Callable[[], tuple[ArrayLike, ArrayLike]],
) -> Look:
    """What an eye sees: the true projector's light beside the true LED at this moment.

    projector_matrix: (3, 3). projector_from_camera: R (3, 3), t (3,). leds: (5, 3) mask metres.
    camera_from_mask: returns R, t of the mask now. The light leaves along the cross-hair's ray and
    is seen on the mask at the LED's depth; the gap is measured there and divided by the size of a
    pixel at that depth.
    """
    matrix = np.asarray(projector_matrix, float)
    rotation, shift = (np.asarray(part, float) for part in projector_from_camera)
    points = np.asarray(leds, float)

    def look(cross_hair: tuple[float, float], led: int) -> Array:
        turn, place = (np.asarray(part, float) for part in camera_from_mask())
        there = rotation @ (turn @ points[led] + place) + shift
        ray = np.linalg.solve(matrix, [*cross_hair, 1.0])
        gap = there[:2] - ray[:2] / ray[2] * there[2]
        return np.asarray(gap * np.diag(matrix)[:2] / there[2], float)

    return look


def screen_look(world: Any, points: ArrayLike, error_mm: float = 0.5, seed: int = 0) -> Look:
    """What an eye sees on a screen that is fixed to its projector: the light of the cross-hair
    beside a mark on the screen's front.

    world: `World` of a Mask-bot; points: (N, 3) marks, mask metres; error_mm: how far beside a
    mark he takes the light to be on it, one sigma an axis.
    """
    rotation, translation = world.mounted
    lens, surface = world.projector.lens, Surface(world.mask)
    marks = np.array(points, float)
    aims = np.random.default_rng([seed, 0xA2]).normal(0, error_mm * 1e-3, (len(marks), 2))
    marks[:, :2] += aims
    marks[:, 2] = surface.height(marks[:, 0], marks[:, 1])
    wanted = lens.image(marks @ rotation.T + translation)
    origin = -rotation.T @ translation

    def look(cross_hair: tuple[float, float], number: int) -> Array:
        here = np.array(cross_hair, float)
        pixels = here + np.array([[0, 0], [1, 0], [0, 1]])
        lit = surface.meet(origin, lens.rays(pixels) @ rotation)
        # Pixels may run leftwards or upwards on the screen that he sees.
        right, down = np.sign(lit[1, 0] - lit[0, 0]), -np.sign(lit[2, 1] - lit[0, 1])
        return np.asarray((wanted[number] - here) * [right, down])

    return look


class Operator:
    """Call `key` with what is lit; press what it returns.

    look: see `Look`; error_px: sigma of his aim an axis; seed: of his hand; steps_px: of the
    cross-hair in the order key 5 brings them, as the handbook says. Which of them is on he learns
    by seeing how far a press moves the light. presses: keys pressed so far.
    """

    def __init__(
        self,
        look: Look,
        error_px: float = 1.0,
        seed: int = 0,
        steps_px: tuple[float, ...] = (32, 8, 1),
    ) -> None:
        self._look = look
        self._error_px = error_px
        self._steps = steps_px
        self._random = np.random.default_rng([seed, 0xA1])
        self._led: int | None = None
        self._aim: Array = np.zeros(2)
        self._step: int | None = None
        self._before: Array | None = None  # the gap before his last nudge
        self._here = 0
        self.presses = 0

    def place(
        self, position_m: ArrayLike, attitude: ArrayLike = (0.0, 0.0, 0.0)
    ) -> tuple[Array, Array]:
        """Where he really puts the mask: (3,) metres and (roll, pitch, yaw) radians, to about
        2 cm across, 4 cm in distance and 3 degrees of what he was asked."""
        position = np.asarray(position_m, float) + self._random.normal(0, (0.02, 0.02, 0.04))
        turned = np.asarray(attitude, float) + self._random.normal(0, np.radians(3), 3)
        return position, turned

    def key(self, cross_hair: tuple[float, float], led: int) -> str:
        """The next key: an arrow (8, 2, 4, 6), 5 for another step, enter when the light covers
        the LED, 0 where it cannot be reached."""
        if led != self._led:
            self._begin(led)
        gap = np.asarray(self._look(cross_hair, led), float) + self._aim
        self.presses += 1
        self._here += 1
        stuck = self._learn_step(gap) or self._here > TOO_MANY_PRESSES
        key = "0" if stuck else self._choose(gap)
        if key in ("0", "enter"):
            self._led = None
        return key

    def _begin(self, led: int) -> None:
        self._led = led
        self._aim = self._random.normal(0, self._error_px, 2)
        self._step, self._before, self._here = None, None, 0

    def _learn_step(self, gap: Array) -> bool:
        """How far did the last nudge move the light? True where it did not move at all."""
        if self._before is None:
            return False
        moved = float(np.linalg.norm(gap - self._before))
        self._before = None
        self._step = int(np.argmin([abs(step - moved) for step in self._steps]))
        return moved < 0.3 * min(self._steps)

    def _choose(self, gap: Array) -> str:
        axis = int(np.argmax(np.abs(gap)))
        distance = float(abs(gap[axis]))
        if distance <= min(self._steps) / 2:
            return "enter"
        if self._step is not None and self._step != self._wanted(distance):
            self._step = (self._step + 1) % len(self._steps)
            return "5"
        self._before = gap
        if axis == 0:
            return "6" if gap[0] > 0 else "4"
        return "2" if gap[1] > 0 else "8"

    def _wanted(self, distance: float) -> int:
        """The largest step that brings him nearer, or the finest."""
        helpful = [i for i, step in enumerate(self._steps) if step < 1.5 * distance]
        finest = int(np.argmin(self._steps))
        return max(helpful, key=lambda i: self._steps[i], default=finest)
