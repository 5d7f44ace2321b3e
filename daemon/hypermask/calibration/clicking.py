"""The clicks at the mask's present place: cross-hair, step, next LED, what was accepted."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hypermask.geometry import Array
from hypermask.mask import LED_NAMES

STEPS_PX = (32, 8, 1)
NUDGES = {
    "8": (0, -1), "2": (0, 1), "4": (-1, 0), "6": (1, 0),
    "7": (-1, -1), "9": (1, -1), "1": (-1, 1), "3": (1, 1),
}  # fmt: skip


@dataclass
class Clicking:
    """size: of the projector's picture; leds: indices to click, in order.

    pixels: (5, 2) accepted at the present pose, NaN elsewhere; order: LEDs clicked or skipped at
    the present pose; before: those done at this position before the mask moved.
    """

    size: tuple[int, int]
    leds: range
    pixels: Array = field(default_factory=lambda: np.full((len(LED_NAMES), 2), np.nan))
    order: list[int] = field(default_factory=list)
    before: set[int] = field(default_factory=set)
    cross_hair: tuple[int, int] = (0, 0)
    step: int = 0

    @property
    def led(self) -> int | None:
        """The next LED, None when all are done."""
        return next((led for led in self.leds if led not in self.before.union(self.order)), None)

    @property
    def pending(self) -> bool:
        """Whether clicks wait to become a placement."""
        return bool(np.isfinite(self.pixels).any())

    @property
    def step_px(self) -> int:
        return STEPS_PX[self.step]

    @property
    def done(self) -> int:
        """How many LEDs of this position are clicked or skipped."""
        return len(self.before) + len(self.order)

    def nudge(self, right: int, down: int) -> None:
        x, y = self.cross_hair
        self.put(x + right * self.step_px, y + down * self.step_px)

    def put(self, x: float, y: float) -> None:
        """Move the cross-hair, kept inside the picture."""
        width, height = self.size
        self.cross_hair = (
            int(np.clip(round(x), 0, width - 1)),
            int(np.clip(round(y), 0, height - 1)),
        )

    def next_step(self) -> None:
        self.step = (self.step + 1) % len(STEPS_PX)

    def first_step(self, clicks: int) -> None:
        """The more clicks were made, the nearer the cross-hair starts, and the finer the step."""
        self.step = 0 if clicks == 0 else (1 if clicks <= len(LED_NAMES) else 2)

    def take(self, accepted: bool) -> None:
        """Accept the cross-hair for the next LED, or skip that LED."""
        led = self.led
        if led is not None:
            if accepted:
                self.pixels[led] = self.cross_hair
            self.order.append(led)

    def take_back(self) -> tuple[float, float] | None:
        """Undo the last LED: where its cross-hair was, None where it was skipped."""
        led = self.order.pop()
        x, y = (float(value) for value in self.pixels[led])
        self.pixels[led] = np.nan
        return (x, y) if np.isfinite(x) else None

    def drop(self) -> None:
        """Forget the clicks at the present pose."""
        self.pixels[:] = np.nan
        self.order.clear()

    def close(self) -> None:
        """The present pose's clicks were kept elsewhere; its LEDs stay done."""
        self.before.update(self.order)
        self.drop()
