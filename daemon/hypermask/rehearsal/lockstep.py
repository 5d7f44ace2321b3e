"""The show in lock-step: one process, a virtual clock, the same numbers on any machine."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask.calibration.fixed import Fixed
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.planar import Planar
from hypermask.face.action_units import COUNT
from hypermask.loudspeaker.settings import Loudspeaker
from hypermask.rehearsal.cart import SimulatedCart, camera_model
from hypermask.rehearsal.head import HeadLog
from hypermask.rehearsal.observer import TrackingObserver
from hypermask.rehearsal.show_parts import Casting
from hypermask.rehearsal.visitors import SHELF, Visitors
from hypermask.show.engine import ShowEngine
from hypermask.show.scene import describe
from hypermask.stage.renderer import DrawItem
from hypermask.stage.screen import ScreenMapping
from hypermask.stage.settings import StageSettings
from hypermask.tracking.motion import MotionFilter
from hypermask.tracking.motion_model import MotionParameters
from hypermask.tracking.tracker import Tracker, TrackerSettings, TrackResult
from hypermask.voice.settings import VoiceSettings
from hypermask.workers.alignment import AlignmentSettings, PhaseAligner
from hypermask.workers.board import Board
from hypermask.workers.calibration_watch import CalibrationWatch
from hypermask.workers.cast import DOTS, Cast
from hypermask.workers.dresser import Dresser
from hypermask.workers.modes import Modes
from hypermask.workers.pantilt import PERIOD_S as NECK_PERIOD_S
from hypermask.workers.pantilt import PanTiltWorker
from hypermask.workers.retry import Kept
from hypermask.workers.show import ShowWorker
from hypermask.workers.stage import (
    Picture,
    StageWorker,
    mapping_for,
    reader_for,
    renderer_for,
)
from hypermask.workers.tracker import TrackerWorker
from hypermask.workers.voice import VoiceWorker
from hypermask.workers.wings import Wings
from hypermask_drivers.camera import Frame

PROJECTOR_WAIT_S = 20.0

Image = NDArray[np.uint8]
OnFlip = Callable[["Flip"], None]


@dataclass(frozen=True)
class Flip:
    """One frame that was shown.

    shown: (h, w, 3) RGB, row 0 at the top, as projected; probe: the same frame with the test dots
    in the place of the face (the same picture when the dots are the character).
    """

    index: int
    flip_s: float
    picture: Picture
    shown: Image
    probe: Image


class LockStep:
    """Builds the workers on a simulated cart and plays them in turn, flip by flip."""

    def __init__(
        self,
        cart: SimulatedCart,
        calibration: ProCam | Planar | Fixed,
        casting: Casting,
        board: Board | None = None,
        models: MotionParameters | None = None,
        modes: Callable[[Board], Modes] | None = None,
    ) -> None:
        """models: of the performer's motion, instead of those that came with the program. modes:
        what the keypad may be lent to; a calibration that is stored then is taken over."""
        self.cart = cart
        self._models = models
        self._folder = tempfile.TemporaryDirectory(prefix="hypermask-") if board is None else None
        self.board = board or Board.local(Path(self._folder.name) if self._folder else None)
        world, clock, journal, scenario = cart.world, cart.clock, cart.journal, cart.scenario
        self._latency = scenario.latency
        self.observer = TrackingObserver(world)
        self.last_seen: tuple[Frame, TrackResult] | None = None
        # A screen that is fixed to its projector needs no camera.
        self.tracker = None if isinstance(calibration, Fixed) else self._tracker()
        self.head = (
            PanTiltWorker(cart.pantilt, self.board, clock, journal) if scenario.neck else None
        )
        self._head_s = world.origin_s
        self.head_log = HeadLog()
        self.voice = VoiceWorker(
            cart.sound, self.board, clock, journal, VoiceSettings(mode=scenario.voice.mode)
        )
        engine = ShowEngine(casting.show, clock.now())
        offered = modes(self.board) if modes is not None else None
        self.show = ShowWorker(cart.keypad, engine, self.board, clock, journal, modes=offered)
        # In real time the dresser is another process.
        self._guests = _guests(cart, self.board) if board is None else None
        self.projector = Kept(cart.projector, "projector", clock, journal)
        self._await_projector()
        self._build_stage(casting, calibration)
        self._watch = None if modes is None else CalibrationWatch(self._take_over, journal)
        self._shown: list[Image] = []

    def _take_over(self, calibration: ProCam | Planar | Fixed) -> bool:
        return self.stage.take_over(calibration, self.cart.world.mask)

    def _tracker(self) -> TrackerWorker:
        world, motion = self.cart.world, MotionFilter(models=self._models)
        return TrackerWorker(
            self.cart.camera,
            Tracker(world.mask.leds, camera_model(world), TrackerSettings(), motion),
            motion,
            self.board,
            self.cart.clock,
            self.cart.journal,
            aligner=PhaseAligner(AlignmentSettings()),
            charge_s=self._latency.tracking_ms * 1e-3,
            observer=self._observe,
        )

    def _build_stage(self, casting: Casting, calibration: ProCam | Planar | Fixed) -> None:
        world, projector = self.cart.world, self.cart.projector
        self._mode = projector.mode
        size = (self._mode.width, self._mode.height)
        settings = StageSettings(brightness_limit=world.scenario.stage.brightness_limit)
        renderer = renderer_for(calibration, projector.context, size, world.mask, settings)
        self.test_only = tuple(casting.sources.values()) == (DOTS,)
        sources = casting.sources if self.test_only else {**casting.sources, DOTS: DOTS}
        cast = Cast(sources, world.mask, renderer)
        reader = reader_for(
            calibration, self.board, world.scenario.tracking.prediction, self._models
        )
        mapping = mapping_for(calibration, world.mask, reader)
        period_s = 1 / self._mode.rate_hz
        loudspeaker = Loudspeaker.model_construct(delay_ms=world.scenario.loudspeaker.delay_ms)
        self.stage = StageWorker(
            renderer, cast, mapping, reader, self.board, period_s, settings, loudspeaker
        )
        self._renderer, self._cast = renderer, cast
        self.wings = Wings(cast, self.board, self.cart.journal)
        with projector.context:
            self._probe_buffer = projector.context.framebuffer(
                [projector.context.texture(size, 4)], projector.context.depth_renderbuffer(size)
            )

    def _observe(self, frame: Frame, result: TrackResult) -> None:
        self.observer(frame, result)
        self.last_seen = (frame, result)

    def _await_projector(self) -> None:
        """A display that is off at the start is waited for. Raises what opening it raises."""
        clock = self.cart.clock
        deadline_s = clock.now() + PROJECTOR_WAIT_S
        while not self.projector.ready():
            if clock.now() > deadline_s:
                self.cart.projector.open()
            clock.sleep_until(clock.now() + 0.1)

    @property
    def light_delay_s(self) -> float:
        """From a flip to its light."""
        return self._mode.light_delay_s

    def caption(self, time_s: float) -> str:
        """What the show has on the stage, in words."""
        scene = self.board.scene.latest()
        return "" if scene is None else describe(scene, time_s)

    @property
    def missed_flips(self) -> int:
        return self.cart.projector.missed_flips

    def close(self) -> None:
        """Free what was loaded, and the projector with its context."""
        self._renderer.release()
        self.cart.projector.close()
        if self._folder is not None:
            self._folder.cleanup()

    def warm_up(self) -> None:
        """Draw every character once, so that shaders are compiled and textures are in place before
        the first flip that counts."""
        items = self._everybody()
        for shown in [*([item] for item in items), items[:2], items]:
            for framebuffer in (self.cart.projector.framebuffer, self._probe_buffer):
                self.stage.draw(framebuffer, self._before_show(shown), counted=False)
                read_back(framebuffer)
        self.stage.draw(self.cart.projector.framebuffer, self._before_show([]), counted=False)

    def drawing_times(self, repeats: int = 20) -> dict[int, list[float]]:
        """Seconds to pose and draw one character and a cross-fade of two."""
        times = {load: [self._timed(load) for _ in range(repeats)] for load in (1, 2)}
        framebuffer = self.cart.projector.framebuffer
        self.stage.draw(framebuffer, self._before_show([]), counted=False)
        return times

    def before_show(self) -> Picture:
        """The first character on a mask straight ahead."""
        return self._before_show(self._everybody()[:1])

    def _timed(self, load: int) -> float:
        began = time.perf_counter()
        picture = self._before_show(self._everybody()[:load])
        self.stage.draw(self.cart.projector.framebuffer, picture, counted=False)
        return time.perf_counter() - began

    def _everybody(self) -> tuple[DrawItem, ...]:
        everybody = [(name, 1.0) for name in self._cast.names]
        return self._cast.items(everybody, np.zeros(COUNT), np.zeros(13), 0.0)

    def _before_show(self, items: Sequence[DrawItem]) -> Picture:
        """A picture of a mask straight ahead; black without items."""
        width, height = self._mode.width, self._mode.height
        matrix = np.array([[900.0, 0, 0, width / 2], [0, -900.0, 0, height / 2], [0, 0, 0, 1.0]])
        if self.tracker is None:
            matrix = ScreenMapping(self.cart.world.mask).at(0.0)
        return Picture(0.0, matrix if items else None, tuple(items), 0.5, None)

    def play(self, duration_s: float) -> Iterator[Flip | None]:
        """Play until `duration_s` after the cart's time 0; None for a flip without a projector."""
        clock, end_s = self.cart.clock, self.cart.world.origin_s + duration_s
        self.cart.projector.add_listener(
            lambda picture, flip_s, light_s: self._shown.append(picture)
        )
        index = 0
        while clock.now() < end_s - 0.5 / self._mode.rate_hz:
            yield self._flip(index)
            index += 1

    def _flip(self, index: int) -> Flip | None:
        clock, projector = self.cart.clock, self.projector
        flip_s = projector.use(lambda device: device.next_flip_s())
        if flip_s is None:
            self._until(clock.now() + 1 / self._mode.rate_hz)
            return None
        latch_s = flip_s - self._latency.latch_ms * 1e-3
        self.stage.announce(flip_s, flip_s - latch_s)
        self._until(latch_s)
        picture = self.stage.latch(clock.now(), flip_s + self._mode.light_delay_s)
        probe = None if self.test_only else read_back(self.draw_probe(picture))
        self.stage.draw(self.cart.projector.framebuffer, picture)
        self._shown.clear()
        shown_s = projector.use(lambda device: device.present())
        if shown_s is None or not self._shown:
            return None
        self._wait(shown_s)
        shown = self._shown[-1]
        return Flip(index, shown_s, picture, shown, shown if probe is None else probe)

    def _until(self, latch_s: float) -> None:
        """Let the tracker, the voice and the show do what they can before the latch."""
        clock = self.cart.clock
        last_s = latch_s - self._latency.tracking_ms * 1e-3
        if self.tracker is not None:
            self._track_until(self.tracker, last_s)
        self._wait(latch_s)
        while self.voice.step():
            pass
        if self._guests is not None:
            visitors, dresser = self._guests
            visitors.step(clock.now())
            dresser.step()
            self.wings.work(clock.now(), math.inf)
        while self.show.step():
            pass
        if self._watch is not None:
            self._watch.step(clock.now())

    def _track_until(self, tracker: TrackerWorker, last_s: float) -> None:
        camera = self.cart.camera
        while True:
            arrival_s = tracker.camera.use(lambda _: camera.next_arrival_s())
            if arrival_s is None or arrival_s > last_s + 1e-9:
                break
            self._wait(arrival_s)
            tracker.step()
        self._wait(last_s)
        tracker.step()

    def _wait(self, until_s: float) -> None:
        """Let the time pass; the neck takes its turns on the way."""
        clock, head = self.cart.clock, self.head
        while head is not None and self._head_s <= until_s:
            clock.sleep_until(self._head_s)
            if head.step():
                place = self.cart.pantilt.place_at(clock.now())
                self.head_log.take(clock.now(), self.board.neck.latest(), place, head.limits())
            self._head_s += NECK_PERIOD_S
        clock.sleep_until(until_s)

    def draw_probe(self, picture: Picture) -> moderngl.Framebuffer:
        """The same frame with dots, drawn by the same renderer with the same numbers."""
        items = (self._cast.dots(),) if picture.items else ()
        self.stage.draw(self._probe_buffer, replace(picture, items=items), counted=False)
        return self._probe_buffer


def _guests(cart: SimulatedCart, board: Board) -> tuple[Visitors, Dresser] | None:
    """Who makes characters during the show, when the scenario has visitors."""
    scenario, folder = cart.scenario, board.folder
    if not scenario.performer.photos or folder is None:
        return None
    charge_s = scenario.latency.character_ms * 1e-3
    dresser = Dresser(
        board, folder / SHELF, cart.world.mask, cart.clock, cart.journal, charge_s=charge_s
    )
    return Visitors(scenario, dresser.orders, cart.world.origin_s), dresser


def read_back(framebuffer: moderngl.Framebuffer) -> Image:
    """A framebuffer's picture (h, w, 3) RGB, row 0 at the top."""
    with framebuffer.ctx:
        width, height = framebuffer.size
        data = framebuffer.read(components=4)  # GLES promises RGBA only
    pixels = np.frombuffer(data, np.uint8).reshape(height, width, 4)[::-1]
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGBA2RGB), np.uint8)
