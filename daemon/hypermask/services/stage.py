"""The stage's process: it depends on nobody. Black at once, the first face as soon as it is
dressed, the rest of the cast in spare time."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Generator

# Software GL draws steadier without threads of its own where the other workers need the cores.
os.environ.setdefault("LP_NUM_THREADS", "0")

import moderngl

from hypermask.blackboard import Record
from hypermask.calibration import storage
from hypermask.errors import DataError, HypermaskError
from hypermask.face.character import find_character, load_character
from hypermask.face.face import Face
from hypermask.services.entrances import Entrances
from hypermask.services.loop import Loop, Quiet
from hypermask.services.overture import Overture, dark
from hypermask.services.playbill import LAST_RESORT, playable_show
from hypermask.services.rig import Rig, nominal_projector, nominal_screen
from hypermask.show.engine import ShowEngine
from hypermask.show.showfile import ShowFile
from hypermask.stage.pacing import Pacer
from hypermask.workers.calibration_watch import Calibration, CalibrationWatch
from hypermask.workers.cast import Cast
from hypermask.workers.costumes import Costumes
from hypermask.workers.flipping import Flipper
from hypermask.workers.retry import Kept
from hypermask.workers.stage import (
    Picture,
    StageWorker,
    is_fixed,
    mapping_for,
    reader_for,
    renderer_for,
)
from hypermask.workers.wings import Wings
from hypermask_drivers.projector import Projector

IDLE_S = 0.02
_OVER = object()
ALONE_S = 2.0
"""Without a word from any show for so long, the first character plays as the show file has it."""


def build(rig: Rig, overture: Overture | None = None) -> Generator[None, None, Loop]:
    """In steps, so that an overture goes on meanwhile."""
    projector = overture.device if overture is not None else rig.device("projector")
    if projector is None:
        return Quiet("no projector in this machine")
    assert isinstance(projector, Projector)
    loop = StageLoop(rig, projector, overture)
    if overture is not None:
        yield from loop.set_up()
    return loop


class StageLoop:
    """Owns the projector and everything that lives in its context."""

    def __init__(self, rig: Rig, projector: Projector, overture: Overture | None = None) -> None:
        self._rig, self._clock, self._health = rig, rig.clock, rig.health
        self._device = projector
        self.projector = Kept(projector, "projector", rig.clock, rig.report)
        self._overture = overture
        self._context: moderngl.Context | None = None
        self._steps: tuple[moderngl.Context, Generator[None, None, None]] | None = None
        self._flipper: Flipper[Picture] | None = None
        self._tries = 0
        # Before the calibration is read: what is stored from now on is taken over.
        self._watch = CalibrationWatch(self._take_over, rig.report)

    @property
    def cast(self) -> tuple[str, ...]:
        """Who can be drawn by now."""
        return self._cast.names

    def begin(self) -> None:
        """Black at once, whatever else takes its time; after an overture it is light already."""
        if self._overture is None:
            self.projector.use(dark)

    def turn(self) -> bool:
        if not self.projector.ready():
            self._health.device(False)
            self._clock.sleep_until(self._clock.now() + IDLE_S)
            tried, self._tries = self.projector.tries != self._tries, self.projector.tries
            return tried
        self._health.device(True)
        if self._context is not self._device.context:
            return self._set_up_further()
        assert self._flipper is not None
        shown = self._flipper.flip()
        if shown is None:
            return False
        late_s = shown.shown_s - shown.planned_s
        self._health.worked(late_s, shown.missed, first=bool(shown.picture.items))
        if shown.next_s is not None:
            self._use(self._flipper.spare_s(shown.next_s))
        return True

    def _set_up_further(self) -> bool:
        """A step of the set-up a turn, for each is work that the watchdog has to hear of."""
        context = self._device.context
        if self._steps is None or self._steps[0] is not context:
            self._steps = context, self.set_up()
        if next(self._steps[1], _OVER) is _OVER:
            self._steps = None
        return True

    def _use(self, spare_s: float) -> None:
        """What is left of a frame's time."""
        now_s = self._clock.now()
        if not self._entrances.over:
            self._entrances.work(now_s, spare_s)
        else:
            self._wings.work(now_s, spare_s)
        self._watch.step(now_s)

    def _take_over(self, calibration: Calibration) -> bool:
        return self._worker.take_over(calibration, self._rig.mask)

    def set_up(self) -> Generator[None, None, None]:
        """Everything for this projector's context, in steps of some ten milliseconds."""
        rig, device, clock = self._rig, self._device, self._clock
        overture, self._overture = self._overture, None
        settings, mode = rig.machine.stage, device.mode
        show = playable_show(rig.machine.show, rig.report, clock.now())
        yield
        mask = rig.mask
        yield
        size = (mode.width, mode.height)
        calibration = self._calibration(size)
        renderer = (
            overture.renderer
            if overture is not None
            else renderer_for(calibration, device.context, size, mask, settings)
        )
        renderer.complete(mask)
        yield
        cast, store = Cast({}, mask, renderer), Costumes(settings.projector_gamma)
        first, face = self._first_face(show)
        yield
        yield from self._open_cast(cast, store, first, face, overture)
        self._reader = reader_for(calibration, rig.board, rig.machine.tracking.prediction)
        mapping = mapping_for(calibration, mask, self._reader)
        self._worker = StageWorker(
            renderer,
            cast,
            mapping,
            self._reader,
            rig.board,
            1 / mode.rate_hz,
            settings,
            rig.machine.loudspeaker,
            None if overture is None else overture.fade,
        )
        self._worker.play_alone(self._scene_of(show, first), clock.now() + ALONE_S)
        pacer = Pacer(1 / mode.rate_hz) if overture is None else overture.pacer
        self._flipper = Flipper(self.projector, self._worker, clock, pacer, mode.light_delay_s)
        others = [name for name in show.characters if name not in cast.names]
        self._cast = cast
        self._entrances = Entrances(cast, others, store, mask, rig.report, clock.now())
        self._wings = Wings(cast, rig.board, rig.report)
        self._context = device.context

    def _open_cast(
        self, cast: Cast, store: Costumes, first: str, face: Face, overture: Overture | None
    ) -> Generator[None, None, None]:
        """Whoever plays first, by a costume from the store or one made now."""
        if overture is not None:
            cast.lend(face)
            cast.adopt(overture.dressed)
            return
        cast.lend(face, store.of_model(face))
        yield
        costume = store.find(first) or store.of_face(face)
        yield
        yield from cast.join(first, costume)

    def _first_face(self, show: ShowFile) -> tuple[str, Face]:
        """The first character that can be used. Raises `DataError` CHAR-*."""
        problem: HypermaskError | None = None
        for name in (*show.characters, LAST_RESORT):
            try:
                return name, Face(load_character(find_character(name)), self._rig.mask)
            except HypermaskError as error:
                self._rig.report(self._clock.now(), error.code, str(error))
                problem = error
        assert problem is not None
        raise problem

    def _scene_of(self, show: ShowFile, first: str) -> Record:
        scene = ShowEngine(show, self._clock.now()).scene
        scene["characters"][0] = first.encode()
        return scene

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
        return "lights the mask" if self.projector.is_ready else "waits for the projector"

    def stop(self) -> None:
        if self._flipper is not None:
            self._entrances.abandon()
            self._wings.abandon()
        if self.projector.is_ready:
            with contextlib.suppress(HypermaskError):
                self.projector.use(dark)
        self._device.close()
