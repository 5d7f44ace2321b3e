"""The rest of the cast: who is dressed after the first face is lit, in the stage's spare time."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence

from hypermask.errors import HypermaskError
from hypermask.mask import Mask
from hypermask.stage.costume import Costume
from hypermask.workers.cast import Cast
from hypermask.workers.costumes import Costumes
from hypermask.workers.retry import Report

_STEP_S = 0.0006
LOOK_S = 0.5
"""How often it is looked whether the dresser has made the next costume."""
PATIENCE_S = 20.0
"""After so long the stage makes it itself, though that costs flips: the dresser seems dead."""


class Entrances:
    """Brings characters on to the stage one by one; whoever cannot come is left out, and said."""

    def __init__(
        self,
        cast: Cast,
        names: Sequence[str],
        store: Costumes,
        mask: Mask,
        report: Report,
        now_s: float,
    ) -> None:
        self._cast, self._store, self._mask, self._report = cast, store, mask, report
        self._waiting = list(names)
        self._since_s = now_s
        self._next_look_s = now_s
        self._steps: Generator[None, None, None] | None = None
        self._reserved = False

    @property
    def over(self) -> bool:
        return not self._waiting and self._steps is None and self._reserved

    def abandon(self) -> None:
        """Whoever is being dressed stays away; before the context goes."""
        self._waiting.clear()
        if self._steps is not None:
            self._steps.close()
            self._steps = None

    def work(self, now_s: float, spare_s: float) -> None:
        """At least one small step, and as many as `spare_s` allows."""
        end_s = time.perf_counter() + spare_s
        while self._step(now_s) and time.perf_counter() + _STEP_S < end_s:
            pass

    def _step(self, now_s: float) -> bool:
        """False when there is nothing to do just now."""
        if self._steps is None:
            return self._begin(now_s)
        try:
            next(self._steps)
        except StopIteration:
            self._steps = None
        except HypermaskError as error:
            self._report(now_s, error.code, str(error))
            self._steps = None
        return True

    def _begin(self, now_s: float) -> bool:
        if not self._waiting:
            if not self._reserved:
                self._cast.reserve()
                self._reserved = True
            return False
        if now_s < self._next_look_s:
            return False
        name = self._waiting[0]
        try:
            costume = self._costume(name, now_s)
        except HypermaskError as error:
            self._report(now_s, error.code, f"{error} The show goes on without '{name}'.")
            self._waiting.pop(0)
            return True
        if costume is None:
            self._next_look_s = now_s + LOOK_S
            self._waiting.append(self._waiting.pop(0))
            return False
        self._waiting.pop(0)
        self._since_s = now_s
        self._steps = self._cast.join(name, costume)
        return True

    def _costume(self, name: str, now_s: float) -> Costume | None:
        found = self._store.find(name)
        if found is None and now_s - self._since_s > PATIENCE_S:
            return self._store.make(name, self._mask)
        return found
