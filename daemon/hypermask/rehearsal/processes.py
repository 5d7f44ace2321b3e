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
from hypermask.rehearsal.cart import SimulatedCart, camera_model
from hypermask.rehearsal.head import HeadLog
from hypermask.rehearsal.observer import TrackingObserver
from hypermask.rehearsal.show_parts import casting_of
from hypermask.rehearsal.visitors import SHELF, Visitors
from hypermask.show.engine import ShowEngine
from hypermask.tracking.motion import MotionFilter
from hypermask.tracking.tracker import Tracker, TrackerSettings
from hypermask.voice.follower import VoiceSettings
from hypermask.workers.board import Board
from hypermask.workers.cast import DOTS
from hypermask.workers.dresser import Dresser
from hypermask.workers.pantilt import PERIOD_S as NECK_PERIOD_S
from hypermask.workers.pantilt import PanTiltWorker
from hypermask.workers.realtime import be_realtime, die_with_parent, freeze_garbage
from hypermask.workers.show import ShowWorker
from hypermask.workers.tracker import TrackerWorker
from hypermask.workers.voice import VoiceWorker
from hypermask_drivers.clock import RealClock
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World

WAIT_S = 0.1
IDLE_S = 0.002
ORDERS_EVERY_S = 0.02
START_TIMEOUT_S = 60.0
POLL_S = 0.2
PRIORITIES = {"tracker": 50, "voice": 30, "pantilt": 20, "show": 10}
DRESSER, DRESSER_NICE = "dresser", 10
"""Makes characters during the show: heavy, and in nobody's way."""


def crew_of(scenario: Scenario) -> tuple[str, ...]:
    """The processes beside the stage; test dots need no dresser, a fixed screen no tracker."""
    needed = {"tracker": scenario.mapping != "fixed", "pantilt": scenario.neck}
    crew = tuple(kind for kind in PRIORITIES if needed.get(kind, True))
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
    """Entry point of a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    die_with_parent()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    cv2.setNumThreads(1)
    clock = RealClock()
    world = World(order.scenario)
    cart = SimulatedCart(world, clock)
    build = {
        "tracker": _tracker,
        "voice": _voice,
        "pantilt": _pantilt,
        "show": _show,
        DRESSER: _dresser,
    }[order.kind]
    prepare, step, result = build(cart, Board.shared(order.board))
    freeze_garbage()
    granted = _granted(order.kind)
    order.ready.set()
    while order.origin.value != order.origin.value and not order.stop.is_set():
        clock.sleep_until(clock.now() + 0.005)
    world.origin_s = order.origin.value
    prepare()
    while not order.stop.is_set():
        if not step(WAIT_S):
            clock.sleep_until(clock.now() + IDLE_S)  # an absent device must not eat the CPU
    told = result() | {"events": cart.journal.events, "granted": granted}
    order.results.put((order.kind, told))


Parts = tuple[Callable[[], None], Callable[[float], bool], Callable[[], dict[str, Any]]]


def _tracker(cart: SimulatedCart, board: Board) -> Parts:
    world, motion = cart.world, MotionFilter()
    observer = TrackingObserver(world)
    tracker = Tracker(world.mask.leds, camera_model(world), TrackerSettings(), motion)
    worker = TrackerWorker(
        cart.camera, tracker, motion, board, cart.clock, cart.journal, observer=observer
    )

    def result() -> dict[str, Any]:
        return {
            "tracking": observer.summary(),
            "compute_s": worker.compute_s,
            "latency_s": worker.latency_s,
        }

    return _nothing, worker.step, result


def _voice(cart: SimulatedCart, board: Board) -> Parts:
    worker = VoiceWorker(
        cart.sound,
        board,
        cart.clock,
        cart.journal,
        VoiceSettings(mode=cart.scenario.voice.mode),
    )
    _ = cart.world.voice  # read the recording before the show, not in it
    return (
        _nothing,
        worker.step,
        lambda: {"history": worker.history, "compute_s": worker.compute_s},
    )


def _show(cart: SimulatedCart, board: Board) -> Parts:
    show = casting_of(cart.scenario).show
    worker: list[ShowWorker] = []

    def prepare() -> None:
        engine = ShowEngine(show, cart.world.origin_s)
        worker.append(ShowWorker(cart.keypad, engine, board, cart.clock, cart.journal))

    return prepare, lambda timeout_s: worker[0].step(timeout_s), dict


def _pantilt(cart: SimulatedCart, board: Board) -> Parts:
    worker = PanTiltWorker(cart.pantilt, board, cart.clock, cart.journal)
    log = HeadLog()
    due_s: list[float] = []

    def step(timeout_s: float) -> bool:
        clock = cart.clock
        clock.sleep_until(due_s[0])
        now_s = clock.now()
        due_s[0] = max(due_s[0] + NECK_PERIOD_S, now_s)
        if worker.step():
            log.take(now_s, board.neck.latest(), cart.pantilt.place_at(now_s), worker.limits())
        return True

    def prepare() -> None:
        due_s.append(cart.world.origin_s)

    return prepare, step, lambda: {"head": log.report(cart.world.origin_s)}


def _dresser(cart: SimulatedCart, board: Board) -> Parts:
    assert board.folder is not None
    dresser = Dresser(board, board.folder / SHELF, cart.world.mask, cart.clock, cart.journal)
    dresser.prepare()
    visitors: list[Visitors] = []

    def prepare() -> None:
        visitors.append(Visitors(cart.scenario, dresser.orders, cart.world.origin_s))

    def step(timeout_s: float) -> bool:
        visitors[0].step(cart.clock.now())
        if not dresser.step():
            cart.clock.sleep_until(cart.clock.now() + ORDERS_EVERY_S)
        return True

    return prepare, step, lambda: {"compute_s": list(dresser.compute_s)}


def _granted(kind: str) -> list[str]:
    """Real time for those who must not be late; the dresser gives way."""
    if kind in PRIORITIES:
        return be_realtime(PRIORITIES[kind])
    return [f"nice {os.nice(DRESSER_NICE)}"]


def _nothing() -> None:
    """This worker has nothing to do at the origin."""
