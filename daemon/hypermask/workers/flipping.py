"""Flip after flip against the real clock: latch late, draw, show, and use what time is left."""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import moderngl

from hypermask.stage.pacing import Pacer
from hypermask.workers.retry import Kept
from hypermask_drivers.clock import Clock
from hypermask_drivers.projector import Projector


class Drawable(Protocol):
    """What one frame shows."""

    @property
    def items(self) -> Sized:
        """Empty for black."""
        ...


P = TypeVar("P", bound=Drawable)


class Drawing(Protocol[P]):
    """A stage as its flips see it; see `workers.stage.StageWorker`."""

    def load(self, light_s: float) -> int: ...

    def announce(self, flip_s: float, latch_lead_s: float) -> None: ...

    def latch(self, now_s: float, light_s: float) -> P: ...

    def draw(self, framebuffer: moderngl.Framebuffer, picture: P) -> None: ...


@dataclass(frozen=True)
class Shown(Generic[P]):
    """A flip that took place. planned_s: when it should have; next_s: when the next one may."""

    picture: P
    planned_s: float
    shown_s: float
    missed: int
    next_s: float | None


class Flipper(Generic[P]):
    """Plays a stage on a projector that comes and goes."""

    def __init__(
        self,
        projector: Kept[Projector],
        stage: Drawing[P],
        clock: Clock,
        pacer: Pacer,
        light_delay_s: float,
    ) -> None:
        self._projector, self._stage, self._clock = projector, stage, clock
        self.pacer, self._light_delay_s = pacer, light_delay_s

    def flip(self) -> Shown[P] | None:
        """One flip; None where the projector was not there for it."""
        clock, stage, projector = self._clock, self._stage, self._projector
        flip_s = projector.use(lambda device: device.next_flip_s())
        if flip_s is None:
            return None
        light_s = flip_s + self._light_delay_s
        load = stage.load(light_s)
        # When something else took too long, that is no cost of drawing: count from now.
        latch_s = max(self.pacer.latch_s(flip_s, load), clock.now())
        clock.sleep_until(latch_s)
        stage.announce(flip_s, flip_s - latch_s)
        picture = stage.latch(clock.now(), light_s)
        framebuffer = projector.use(lambda device: device.framebuffer)
        if framebuffer is None:
            return None
        stage.draw(framebuffer, picture)
        # Black is quick: it says nothing of what the faces will take that come back.
        self.pacer.drawn(latch_s, clock.now(), len(picture.items))
        shown_s = projector.use(lambda device: device.present())
        if shown_s is None:
            return None
        missed = self.pacer.flipped(flip_s, shown_s)
        next_s = projector.use(lambda device: device.next_flip_s())
        return Shown(picture, flip_s, shown_s, missed, next_s)

    def spare_s(self, next_flip_s: float) -> float:
        """Time until the next frame must be begun."""
        load = self._stage.load(next_flip_s + self._light_delay_s)
        return next_flip_s - self.pacer.budget_s(load) - self._clock.now()
