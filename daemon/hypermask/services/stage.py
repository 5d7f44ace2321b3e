"""The stage's process: it depends on nobody. Black at once, the first face as soon as it is
dressed, the rest of the cast in spare time."""

from __future__ import annotations

import contextlib
import os

# Software GL draws steadier without threads of its own where the other workers need the cores.
os.environ.setdefault("LP_NUM_THREADS", "0")

import moderngl

from hypermask.calibration import storage
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.planar import Planar
from hypermask.errors import DataError, HypermaskError
from hypermask.services.loop import Loop, Quiet
from hypermask.services.playbill import playable_show
from hypermask.services.rig import Rig, nominal_projector
from hypermask.stage.pacing import Pacer
from hypermask.stage.renderer import StageRenderer
from hypermask.workers.cast import Cast
from hypermask.workers.flipping import Flipper
from hypermask.workers.retry import Kept
from hypermask.workers.stage import StageWorker, TrackReader, mapping_for
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
        return True

    def _set_up(self) -> None:
        """Everything that lives in the projector's context."""
        rig, device = self._rig, self._device
        mode, settings = device.mode, rig.machine.stage
        size = (mode.width, mode.height)
        renderer = StageRenderer(device.context, size, rig.mask, settings)
        show = playable_show(rig.machine.show, rig.report, rig.clock.now())
        cast = Cast({name: name for name in show.characters}, rig.mask, renderer)
        reader = TrackReader(rig.board, rig.machine.tracking.prediction)
        mapping = mapping_for(self._calibration(), rig.mask, reader)
        stage = StageWorker(
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

    def _calibration(self) -> ProCam | Planar:
        """The stored one, or the machine's nominal optics, and CAL-NONE is said."""
        now_s = self._clock.now()
        try:
            stored, warning = storage.load_current()
        except DataError as error:
            self._rig.report(now_s, error.code, f"{error} The nominal optics are used.")
            return nominal_projector(self._rig.machine)
        if warning is not None:
            self._rig.report(now_s, warning.partition(":")[0], warning)
        return stored.calibration

    def status(self) -> str:
        ready = self._device.state is DeviceState.READY
        return "lights the mask" if ready else "waits for the projector"

    def stop(self) -> None:
        if self._device.state is DeviceState.READY:
            with contextlib.suppress(HypermaskError):
                self._black()
        self._device.close()
