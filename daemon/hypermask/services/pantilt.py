"""The pan-tilt unit's process: it follows the show's orders and halts without them."""

from __future__ import annotations

from hypermask.services.loop import Loop, Quiet
from hypermask.services.rig import Rig
from hypermask.workers.pantilt import PERIOD_S, PanTiltWorker
from hypermask_drivers.device import DeviceState
from hypermask_drivers.pantilt import PanTilt


def build(rig: Rig) -> Loop:
    head = rig.device("pantilt")
    if head is None:
        return Quiet("no pan-tilt unit in this machine")
    assert isinstance(head, PanTilt)
    return PanTiltLoop(rig, head)


class PanTiltLoop:
    """One step every 50 ms; a step that came too late is not made up for."""

    def __init__(self, rig: Rig, head: PanTilt) -> None:
        self._clock, self._health = rig.clock, rig.health
        self.worker = PanTiltWorker(head, rig.board, rig.clock, rig.report, rig.machine.neck)
        self._next_s = -float("inf")
        self._tries = 0

    def begin(self) -> None:
        """Nothing."""

    def turn(self) -> bool:
        self._clock.sleep_until(self._next_s)
        now_s = self._clock.now()
        self._next_s = max(self._next_s + PERIOD_S, now_s)
        moved = self.worker.step()
        ready = self.worker.head.device.state is DeviceState.READY
        self._health.device(ready)
        if moved:
            self._health.worked(self.worker.compute_s[-1])
            return True
        tried, self._tries = self.worker.head.tries != self._tries, self.worker.head.tries
        return tried

    def status(self) -> str:
        return self.worker.words()

    def stop(self) -> None:
        self.worker.stop()
