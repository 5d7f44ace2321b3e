"""The show's process: keys in, the scene out."""

from __future__ import annotations

from hypermask.errors import HypermaskError
from hypermask.machine.files import keep_good, load
from hypermask.services.loop import Loop
from hypermask.services.modes import modes_of
from hypermask.services.playbill import checked_show, playable_show
from hypermask.services.rig import Rig
from hypermask.services.side_devices import side_devices
from hypermask.show.engine import ShowEngine
from hypermask.show.showfile import ShowFile
from hypermask.workers.control import ControlServer
from hypermask.workers.show import ShowWorker
from hypermask_drivers.device import DeviceState
from hypermask_drivers.keypad import Keypad

WAIT_S = 0.02


def build(rig: Rig, show: ShowFile | None = None) -> Loop:
    """show: instead of the machine's."""
    return ShowLoop(rig, show)


class ShowLoop:
    def __init__(self, rig: Rig, show: ShowFile | None) -> None:
        self._rig, self._clock, self._health = rig, rig.clock, rig.health
        self._given = show is not None
        self._show = show or playable_show(rig.machine.show, rig.report, rig.clock.now())
        keypad = rig.device("keypad")
        assert keypad is None or isinstance(keypad, Keypad)
        self._keypad = keypad
        self.worker: ShowWorker | None = None
        self._unkept_since_s: float | None = None

    def begin(self) -> None:
        rig = self._rig
        engine = ShowEngine(self._show, rig.clock.now())
        if self._given:
            self.worker = ShowWorker(self._keypad, engine, rig.board, rig.clock, rig.report)
            return
        self.worker = ShowWorker(
            self._keypad,
            engine,
            rig.board,
            rig.clock,
            rig.report,
            control=self._control(),
            modes=modes_of(rig),
            devices=side_devices(rig),
            reload=lambda: checked_show(load().machine.show),
        )
        self._unkept_since_s = rig.clock.now()

    def _control(self) -> ControlServer | None:
        """Without its socket the show can still be steered by the keypad."""
        try:
            return ControlServer()
        except HypermaskError as error:
            self._rig.report(self._clock.now(), error.code, str(error))
            return None

    def _keep_configuration(self, since_s: float) -> None:
        """The show has begun with these settings, a picture too: they are the last good ones."""
        pace = self._rig.board.pace.latest()
        if pace is None or float(pace["flip_s"]) < since_s:
            return
        self._unkept_since_s = None
        try:
            keep_good(self._rig.machine)
        except HypermaskError as error:
            self._rig.report(self._clock.now(), error.code, str(error))

    def turn(self) -> bool:
        assert self.worker is not None
        began_s = self._clock.now()
        if self._unkept_since_s is not None:
            self._keep_configuration(self._unkept_since_s)
        took = self.worker.step(WAIT_S)
        keypad = self._keypad
        self._health.device(keypad is not None and keypad.state is DeviceState.READY)
        self._health.worked(None, steps=int(took))
        if took and self.worker.latency_s:
            self._health.worked(self.worker.latency_s.pop(), steps=0)
        if not took:
            self._clock.sleep_until(began_s + WAIT_S)
        return True

    def status(self) -> str:
        return f"plays '{self._show.name}'"

    def stop(self) -> None:
        if self.worker is not None:
            self.worker.stop()
