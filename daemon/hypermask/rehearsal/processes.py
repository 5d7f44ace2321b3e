"""The worker processes of a real-time rehearsal: tracker, voice and show, each on its own."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.context import SpawnProcess
from multiprocessing.synchronize import Event as ProcessEvent
from pathlib import Path
from typing import Any

import cv2

from hypermask.errors import HypermaskError
from hypermask.machine.settings import MachineSettings, TrackingSettings
from hypermask.rehearsal.cart import SimulatedCart, camera_model
from hypermask.rehearsal.head import HeadLog
from hypermask.rehearsal.observer import TrackingObserver
from hypermask.rehearsal.show_parts import casting_of
from hypermask.rehearsal.visitors import SHELF, Visitors
from hypermask.services import pantilt, show, tracker, voice
from hypermask.services.dresser import DresserLoop
from hypermask.services.loop import Loop
from hypermask.voice.settings import VoiceSettings
from hypermask.workers.board import KEPT, Board
from hypermask.workers.cast import DOTS
from hypermask.workers.health import Health
from hypermask.workers.realtime import be_realtime, die_with_parent, freeze_garbage
from hypermask_drivers.clock import RealClock
from hypermask_drivers.device import Device
from hypermask_sim.devices.pantilt import SimPanTilt
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World

START_TIMEOUT_S = 60.0
POLL_S = 0.2
CREW = ("tracker", "voice", "show", "pantilt")
DRESSER = "dresser"
"""Makes characters during the show: heavy, and in nobody's way."""


def crew_of(scenario: Scenario) -> tuple[str, ...]:
    """The processes beside the stage; test dots need no dresser, a still head no neck, a screen
    that is fixed to its projector no tracker."""
    needed = {"tracker": scenario.mapping != "fixed", "pantilt": scenario.neck}
    crew = tuple(kind for kind in CREW if needed.get(kind, True))
    return crew if scenario.character == DOTS else (*crew, DRESSER)


@dataclass(frozen=True)
class Order:
    """What a worker process is given; everything in it can be pickled."""

    kind: str
    scenario: Scenario
    board: Path
    origin: Any  # a shared double: clock time of the scenario's 0, NaN until it is set
    ready: ProcessEvent
    stop: ProcessEvent
    results: Any  # a queue


@dataclass
class Crew:
    """The worker processes. Start, give the origin, stop; results come back by kind."""

    scenario: Scenario
    board: Path
    _orders: list[Order] = field(default_factory=list)
    _processes: list[SpawnProcess] = field(default_factory=list)

    def start(self) -> None:
        """Returns when every worker has loaded what it needs. Raises WRK-START."""
        context = multiprocessing.get_context("spawn")
        self._origin = context.Value("d", float("nan"))
        self._results = context.Queue()
        self._stop = context.Event()
        for kind in crew_of(self.scenario):
            order = Order(
                kind, self.scenario, self.board, self._origin, context.Event(), self._stop,
                self._results,
            )  # fmt: skip
            process = context.Process(target=run_worker, args=(order,), name=kind, daemon=True)
            process.start()
            self._orders.append(order)
            self._processes.append(process)
        for order, process in zip(self._orders, self._processes, strict=True):
            self._await(order, process)

    def _await(self, order: Order, process: SpawnProcess) -> None:
        deadline_s = time.monotonic() + START_TIMEOUT_S
        while not order.ready.wait(POLL_S):
            if not process.is_alive() or time.monotonic() > deadline_s:
                self.kill()
                raise HypermaskError(
                    "WRK-START", f"the {order.kind} process did not start", "Look at its messages."
                )

    def begin(self, origin_s: float) -> None:
        self._origin.value = origin_s

    def finish(self) -> dict[str, dict[str, Any]]:
        """Stop every worker; what each has to tell, by its kind. One that died tells nothing."""
        self._stop.set()
        owed = {order.kind: process for order, process in self._pairs()}
        results: dict[str, dict[str, Any]] = {}
        deadline_s = time.monotonic() + START_TIMEOUT_S
        while owed and time.monotonic() < deadline_s:
            alive = {kind for kind, process in owed.items() if process.is_alive()}
            try:
                kind, told = self._results.get(timeout=POLL_S)
            except queue.Empty:
                # Nothing came although it was dead before we looked: nothing will.
                owed = {kind: owed[kind] for kind in owed if kind in alive}
                continue
            results[kind] = told
            owed.pop(kind, None)
        for process in self._processes:
            process.join(0.5)
        self.kill()
        return results

    def _pairs(self) -> list[tuple[Order, SpawnProcess]]:
        return list(zip(self._orders, self._processes, strict=True))

    def kill(self) -> None:
        for process in self._processes:
            if process.is_alive():
                process.kill()


def run_worker(order: Order) -> None:
    """Entry point of a worker process: the same parts as a service has, on a simulated cart."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    die_with_parent()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    cv2.setNumThreads(1)
    rig = ScenarioRig(order.scenario, order.board, order.kind)
    part = _PARTS[order.kind](rig)
    freeze_garbage()
    worker = getattr(rig.machine.workers, order.kind)
    granted = be_realtime(worker.priority, worker.affinity, worker.lock_memory, worker.nice)
    clock = rig.clock
    order.ready.set()
    while order.origin.value != order.origin.value and not order.stop.is_set():
        clock.sleep_until(clock.now() + 0.005)
    rig.world.origin_s = order.origin.value
    part.loop.begin()
    while not order.stop.is_set():
        part.loop.turn()
        rig.health.publish()
    told = part.result() | {"events": rig.cart.journal.events, "granted": granted}
    order.results.put((order.kind, told))


class ScenarioRig:
    """A `services.rig.Rig` of a simulated cart."""

    def __init__(self, scenario: Scenario, board: Path, kind: str) -> None:
        self.clock = RealClock()
        self.world = World(scenario)
        self.cart = SimulatedCart(self.world, self.clock)
        self.machine = MachineSettings(
            version=1,
            name=scenario.name,
            mapping=scenario.mapping,
            tracking=TrackingSettings(prediction=scenario.tracking.prediction),
            voice=VoiceSettings(mode=scenario.voice.mode),
        )
        self.board, self.report = Board.shared(board), self.cart.journal
        self.health = Health(board, kind, self.clock)
        self.mask, self.camera_model = self.world.mask, camera_model(self.world)
        if scenario.neck and kind != "pantilt":
            self.world.neck = lambda time_s: head_place(self.board)

    def device(self, kind: str) -> Device | None:
        device: Device = getattr(self.cart, kind)
        return device


def head_place(board: Board) -> tuple[float, float]:
    """Where another process has the head just now: pan and tilt in radians."""
    head = board.head.latest()
    return (0.0, 0.0) if head is None else (float(head["pan_rad"]), float(head["tilt_rad"]))


@dataclass(frozen=True)
class Part:
    """A worker's loop, and what it has to tell at the end."""

    loop: Loop
    result: Callable[[], dict[str, Any]] = dict


def _tracker(rig: ScenarioRig) -> Part:
    observer = TrackingObserver(rig.world)
    loop = tracker.TrackerLoop(rig, rig.cart.camera, observer)
    worker, arrives_s = loop.worker, rig.cart.scenario.camera.available_ms * 1e-3

    def result() -> dict[str, Any]:
        return {
            "tracking": observer.summary(),
            "compute_s": worker.compute_s,
            "latency_s": worker.latency_s,
            "arrival_s": [latency_s - arrives_s for latency_s in worker.latency_s],
        }

    return Part(loop, result)


def _voice(rig: ScenarioRig) -> Part:
    _ = rig.world.voice  # read the recording before the show, not in it
    loop = voice.VoiceLoop(rig, rig.cart.sound, calibrated=False, kept=KEPT)
    worker = loop.worker
    return Part(loop, lambda: {"history": worker.history, "compute_s": worker.compute_s})


def _show(rig: ScenarioRig) -> Part:
    return Part(show.build(rig, casting_of(rig.cart.scenario).show))


def _pantilt(rig: ScenarioRig) -> Part:
    loop = LoggedPanTilt(rig, rig.cart.pantilt)

    def result() -> dict[str, Any]:
        return {
            "compute_s": loop.worker.compute_s,
            "head": loop.log.report(rig.world.origin_s),
        }

    return Part(loop, result)


def _dresser(rig: ScenarioRig) -> Part:
    assert rig.board.folder is not None
    loop = VisitedDresser(rig, rig.board.folder / SHELF)
    loop.warm_up()
    return Part(loop, lambda: {"compute_s": list(loop.dresser.compute_s)})


class LoggedPanTilt(pantilt.PanTiltLoop):
    """One whose head's way is written down."""

    def __init__(self, rig: ScenarioRig, head: SimPanTilt) -> None:
        super().__init__(rig, head)
        self._rig, self._head = rig, head
        self.log = HeadLog()

    def turn(self) -> bool:
        worked = super().turn()
        if self.worker.head.is_ready:
            now_s = self._rig.clock.now()
            place, limits = self._head.place_at(now_s), self.worker.limits()
            self.log.take(now_s, self._rig.board.neck.latest(), place, limits)
        return worked


class VisitedDresser(DresserLoop):
    """A dresser to whom the scenario's visitors come."""

    def __init__(self, rig: ScenarioRig, shelf: Path) -> None:
        super().__init__(rig, shelf)
        self._rig = rig
        self._visitors: Visitors | None = None

    def begin(self) -> None:
        scenario, origin_s = self._rig.cart.scenario, self._rig.world.origin_s
        self._visitors = Visitors(scenario, self.dresser.orders, origin_s)

    def turn(self) -> bool:
        assert self._visitors is not None
        self._visitors.step(self._rig.clock.now())
        return super().turn()


_PARTS: dict[str, Callable[[ScenarioRig], Part]] = {
    "tracker": _tracker,
    "voice": _voice,
    "show": _show,
    "pantilt": _pantilt,
    DRESSER: _dresser,
}
