"""The dresser's process: characters made while the show runs, in nobody's way."""

from __future__ import annotations

from pathlib import Path

from hypermask import paths
from hypermask.services.loop import Loop
from hypermask.services.preparing import Preparing
from hypermask.services.rig import Rig
from hypermask.workers.dresser import Dresser

EVERY_S = 0.05


def build(rig: Rig) -> Loop:
    return DresserLoop(rig, paths.home() / "characters", Preparing(rig))


class DresserLoop:
    """shelf: where new characters are saved; preparing: of the stage's next start, if at all."""

    def __init__(self, rig: Rig, shelf: Path, preparing: Preparing | None = None) -> None:
        self._clock, self._health = rig.clock, rig.health
        self._preparing = preparing
        self._warm = False
        self.dresser = Dresser(rig.board, shelf, rig.mask, rig.clock, rig.report, rig.machine.stage)

    def begin(self) -> None:
        """Nothing: costumes that are missing come first, what an order needs is loaded later."""

    def turn(self) -> bool:
        if self.dresser.step():
            made_s = self.dresser.compute_s
            self._health.worked(made_s[-1] if made_s else None)
        elif self._preparing is not None and self._preparing.step():
            self._health.worked(None)
        elif not self._warm:
            self.warm_up()
        else:
            self._clock.sleep_until(self._clock.now() + EVERY_S)
        return True

    def warm_up(self) -> None:
        """Load what an order needs, so that the first one is as quick as the others."""
        self._warm = True
        self.dresser.prepare()

    def status(self) -> str:
        made = len(self.dresser.compute_s)
        return f"has made {made} characters" if made else "waits for orders"

    def stop(self) -> None:
        """Nothing: an order that is not finished is taken again."""
