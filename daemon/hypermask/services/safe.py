"""The safe state, when a service failed for good: dark, parked, and the reason on record."""

from __future__ import annotations

from hypermask.services.loop import Loop
from hypermask.services.rig import Rig
from hypermask.workers.board import Board
from hypermask.workers.pantilt import PERIOD_S, PanTiltWorker
from hypermask.workers.retry import Kept
from hypermask_drivers.pantilt import PanTilt
from hypermask_drivers.projector import Projector

DARK_EVERY_S = 1.0


def build(rig: Rig) -> Loop:
    return SafeLoop(rig)


class SafeLoop:
    """Owns what it can get of projector and pan-tilt unit. The head is parked because nobody
    orders it: its worker sees an empty blackboard of its own, and first finds the zero where the
    unit does not know it."""

    def __init__(self, rig: Rig) -> None:
        self._clock = rig.clock
        projector, head = rig.device("projector"), rig.device("pantilt")
        assert projector is None or isinstance(projector, Projector)
        assert head is None or isinstance(head, PanTilt)
        self._projector = (
            None if projector is None else Kept(projector, "projector", rig.clock, rig.report)
        )
        self._head = (
            None
            if head is None
            else PanTiltWorker(
                head, Board.local(), rig.clock, rig.report, rig.machine.neck, alone=True
            )
        )
        self._dark_s = -float("inf")

    def begin(self) -> None:
        """Nothing."""

    def turn(self) -> bool:
        now_s = self._clock.now()
        if self._projector is not None and now_s - self._dark_s >= DARK_EVERY_S:
            self._dark_s = now_s
            self._projector.use(_dark)
        if self._head is not None:
            self._head.step()
        self._clock.sleep_until(now_s + PERIOD_S)
        return True

    def status(self) -> str:
        head = "no head" if self._head is None else self._head.words()
        return f"dark; {head}"

    def stop(self) -> None:
        if self._projector is not None:
            self._projector.use(_dark)
            self._projector.device.close()
        if self._head is not None:
            self._head.stop()


def _dark(device: Projector) -> None:
    with device.context:
        device.framebuffer.clear(0.0, 0.0, 0.0, 1.0)
    device.present()
