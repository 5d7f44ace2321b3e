"""The stage's process: it depends on nobody. Black at once, the first face as soon as it is
dressed, the rest of the cast in spare time."""

from __future__ import annotations

import contextlib
import os

# Software GL draws steadier without threads of its own where the other workers need the cores.
os.environ.setdefault("LP_NUM_THREADS", "0")

import moderngl

from hypermask.calibration import storage
from hypermask.errors import DataError, HypermaskError
from hypermask.services.loop import Loop, Quiet
from hypermask.services.playbill import playable_show
from hypermask.services.rig import Rig, nominal_projector, nominal_screen
from hypermask.stage.pacing import Pacer
from hypermask.workers.calibration_watch import Calibration, CalibrationWatch
from hypermask.workers.cast import Cast
from hypermask.workers.flipping import Flipper
from hypermask.workers.retry import Kept
from hypermask.workers.stage import StageWorker, is_fixed, mapping_for, reader_for, renderer_for
from hypermask.workers.wings import Wings
from hypermask_drivers.device import DeviceState
from hypermask_drivers.projector import Projector

IDLE_S = 0.02


def build(rig: Rig) -> Loop:
    projector = rig.device("projector")
    if projector is None:
        return Quiet("no projector in this machine")
    assert isinstance(projector, Projector)
    return StageLoop(rig, projector)


class StageLoop:
    def __init__(self, rig: Rig, projector: Projector) -> None:
        self._rig, self._clock, self._health = rig, rig.clock, rig.health
        self._device = projector
        self.projector = Kept(projector, "projector", rig.clock, rig.report)
        self._context: moderngl.Context | None = None
        self._flipper: Flipper | None = None
        self._wings: Wings | None = None
        self._watch: CalibrationWatch | None = None
        self._stage: StageWorker | None = None
        self._tries = 0

    def begin(self) -> None:
        """Black light at once, whatever else takes its time."""
        self._black()

    def _black(self) -> None:
        def dark(device: Projector) -> None:
            with device.context:
                device.framebuffer.clear(0.0, 0.0, 0.0, 1.0)
            device.present()

        self.projector.use(dark)

    def turn(self) -> bool:
        if not self.projector.ready():
            self._health.device(False)
            self._clock.sleep_until(self._clock.now() + IDLE_S)
            tried, self._tries = self.projector.tries != self._tries, self.projector.tries
            return tried
        self._health.device(True)
        if self._context is not self._device.context:
            self._set_up()
        assert self._flipper is not None and self._wings is not None
        shown = self._flipper.flip()
        if shown is None:
            return False
        self._health.worked(shown.shown_s - shown.planned_s, shown.missed)
        if shown.next_s is not None:
            self._wings.work(self._clock.now(), self._flipper.spare_s(shown.next_s))
        if self._watch is not None:
            self._watch.step(self._clock.now())
        return True

    def _set_up(self) -> None:
        """Everything that lives in the projector's context."""
        rig, device = self._rig, self._device
        mode, settings = device.mode, rig.machine.stage
        size = (mode.width, mode.height)
        # First the watch: what is stored from now on is taken over.
        self._watch = CalibrationWatch(self._take_over, rig.report)
        calibration = self._calibration(size)
        renderer = renderer_for(calibration, device.context, size, rig.mask, settings)
        show = playable_show(rig.machine.show, rig.report, rig.clock.now())
        cast = Cast({name: name for name in show.characters}, rig.mask, renderer)
        reader = reader_for(calibration, rig.board, rig.machine.tracking.prediction)
        mapping = mapping_for(calibration, rig.mask, reader)
        stage = self._stage = StageWorker(
            renderer,
            cast,
            mapping,
            reader,
            rig.board,
            1 / mode.rate_hz,
            settings,
            rig.machine.loudspeaker,
        )
        self._flipper = Flipper(
            self.projector, stage, rig.clock, Pacer(1 / mode.rate_hz), mode.light_delay_s
        )
        self._wings = Wings(cast, rig.board, rig.report)
        self._context = device.context

    def _take_over(self, calibration: Calibration) -> bool:
        return self._stage is not None and self._stage.take_over(calibration)

    def _nominal(self) -> Calibration:
        machine = self._rig.machine
        if machine.mapping != "fixed":
            return nominal_projector(machine)
        return nominal_screen(machine)

    def _calibration(self, size: tuple[int, int]) -> Calibration:
        """The stored one, or the machine's nominal optics, and CAL-NONE is said."""
        now_s = self._clock.now()
        try:
            stored, warning = storage.load_current()
        except DataError as error:
            self._rig.report(now_s, error.code, f"{error} The nominal optics are used.")
            return self._nominal()
        if warning is not None:
            self._rig.report(now_s, warning.partition(":")[0], warning)
        calibration = stored.calibration
        fixed = self._rig.machine.mapping == "fixed"
        sized = getattr(calibration, "size", size) == size
        if is_fixed(calibration) != fixed or not sized:
            text = f"CAL-CART: {stored.name} ({stored.method}) is of another kind of machine."
            self._rig.report(now_s, "CAL-CART", f"{text} The nominal optics are used.")
            return self._nominal()
        return calibration

    def status(self) -> str:
        ready = self._device.state is DeviceState.READY
        return "lights the mask" if ready else "waits for the projector"

    def stop(self) -> None:
        if self._device.state is DeviceState.READY:
            with contextlib.suppress(HypermaskError):
                self._black()
        self._device.close()
