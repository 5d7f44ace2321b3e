"""A service from its start to its end: settings, blackboard, devices, real time, watchdog."""

from __future__ import annotations

import contextlib
import gc
import signal
import sys
import time
from collections.abc import Callable, Generator
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from hypermask.errors import ConfigError, HypermaskError
from hypermask.services.messages import ERROR, Messages
from hypermask.services.notify import Notifier

if TYPE_CHECKING:
    from hypermask.services.loop import Loop
    from hypermask.services.overture import Overture
    from hypermask.workers.health import Health

NAMES = ("tracker", "voice", "stage", "pantilt", "show", "dresser", "safe")
STOPPED, FAILED, UNUSABLE = 0, 1, 78
"""Exit codes; 78 is EX_CONFIG of sysexits.h: starting again would change nothing."""
_NOTIFY_S = 0.5
_STATUS_S = 1.0
_BOARD_S = 1.0
_SAFE_PATIENCE_S = 20.0
_END_S = 0.9
"""A service that has not ended so long after SIGTERM is ended by the kernel."""
_STAGE_MODULES = (
    "typing_extensions",
    "pydantic_core",
    "pydantic",
    "hypermask.config",
    "cv2",
    "hypermask.mask",
    "hypermask.geometry",
    "hypermask.show.showfile",
    "hypermask.face.features",
    "hypermask.face.action_units",
    "hypermask.face.interior",
    "hypermask.face.face",
    "hypermask.face.expressions",
    "hypermask.show.scene",
    "hypermask.show.engine",
    "hypermask.tracking.motion",
    "hypermask.tracking.paper",
    "hypermask.loudspeaker.offset",
    "hypermask.stage.settings",
    "hypermask.workers.board",
    "hypermask.workers.stage",
    "hypermask.workers.cast",
    "hypermask.workers.wings",
    "hypermask.voice.lips",
    "hypermask.voice.recurrent",
    "hypermask.voice.follower",
    "hypermask.workers.pantilt",
    "hypermask.stream.settings",
    "hypermask.machine.settings",
    "hypermask.machine.files",
    "hypermask.calibration.storage",
    "hypermask.services.rig",
    "hypermask.services.stage",
)
"""What the stage loads during its overture, in bites."""


def run(name: str) -> int:
    """The whole life of a service; returns its exit code."""
    messages, notifier = Messages(name), Notifier()
    signal.signal(signal.SIGTERM, _leave)
    signal.signal(signal.SIGINT, _leave)
    try:
        return _run(name, messages, notifier)
    except ConfigError as error:
        messages.tell(error.code, str(error), priority=ERROR)
        return UNUSABLE
    except HypermaskError as error:
        messages.tell(error.code, str(error), priority=ERROR)
        return FAILED
    except SystemExit as wish:
        return int(wish.code or 0)
    except Exception as error:
        messages.tell(
            "SVC-FAULT",
            f"SVC-FAULT: the {name} service failed: {type(error).__name__}: {error} "
            f"({_where(error)}). It starts again by itself; report it if it comes again.",
            priority=ERROR,
        )
        return FAILED


def _run(name: str, messages: Messages, notifier: Notifier) -> int:
    overture = None
    if name == "stage":
        from hypermask.services import overture as overtures

        overture = overtures.begin(messages)
    steps = _set_up(name, messages, overture)
    service = _exhaust(steps) if overture is None else overture.play(steps)
    return service.serve(notifier, messages)


def _exhaust(steps: Generator[None, None, Service]) -> Service:
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: Service = end.value
            return found


def _set_up(
    name: str, messages: Messages, overture: Overture | None
) -> Generator[None, None, Service]:
    """In steps, between which an overture goes on."""
    if overture is not None:
        for module in _STAGE_MODULES:
            import_module(module)
            yield
    from hypermask.machine.files import load_machine
    from hypermask.services.board import open_board
    from hypermask.services.rig import MachineRig
    from hypermask.workers.health import Health
    from hypermask.workers.realtime import be_realtime, freeze_garbage
    from hypermask_drivers.clock import RealClock

    if name == "safe":
        return _safe(messages)
    machine = load_machine(messages.tell)
    yield
    board = open_board()
    health = Health(board.folder, name, RealClock()) if overture is None else overture.health
    health.publish(now=True)
    rig = MachineRig(machine, board, messages, health)
    builder: Any = import_module(f"hypermask.services.{name}")
    yield
    loop: Loop = (
        (yield from builder.build(rig, overture)) if name == "stage" else builder.build(rig)
    )
    worker = getattr(machine.workers, name, machine.workers.dresser)
    granted = be_realtime(worker.priority, worker.affinity, worker.lock_memory, worker.nice)
    health.record["granted"] = ", ".join(granted).encode()[:64]
    if worker.priority and not any("SCHED_FIFO" in word for word in granted):
        messages.tell("SVC-RIGHTS", "no right to real-time priority; timing may suffer")
    loop.begin()
    yield
    gc.enable()
    freeze_garbage()
    return Service(loop, health, worker.watchdog_s, at_once=name == "dresser")


def _safe(messages: Messages) -> Service:
    """The safe state needs no blackboard, and without a configuration it darkens what it finds."""
    from hypermask.machine.files import load_machine
    from hypermask.machine.settings import DeviceTable, MachineSettings
    from hypermask.services import safe
    from hypermask.services.rig import MachineRig
    from hypermask.workers.board import Board
    from hypermask.workers.health import Health
    from hypermask_drivers.clock import RealClock

    try:
        machine = load_machine(messages.tell)
    except ConfigError as error:
        messages.tell(error.code, f"{error} Every display that is found is darkened.")
        machine = MachineSettings(version=1, name="safe", projector=DeviceTable(driver="kms"))
    health = Health(None, "safe", RealClock())
    loop = safe.build(MachineRig(machine, Board.local(), messages, health))
    loop.begin()
    gc.enable()
    return Service(loop, health, _SAFE_PATIENCE_S)


class Service:
    """A worker that is ready to work. patience_s: without work for so long it counts as hung, 0 for
    never. at_once: it may be ended in the middle of a turn."""

    def __init__(
        self, loop: Loop, health: Health, patience_s: float, at_once: bool = False
    ) -> None:
        from hypermask.services.board import board_folder, number_of

        self._loop, self._health, self.at_once = loop, health, at_once
        self._patience_s = patience_s
        self._number: Callable[[], int | None] = lambda: number_of(board_folder())
        self._board = self._number()

    def serve(self, notifier: Notifier, messages: Messages) -> int:
        """Turn after turn until SIGTERM; returns the exit code. Raises BOARD-NEW."""
        loop, health = self._loop, self._health
        stop = _Stop(self.at_once)
        notifier.watch(self._patience_s)
        notifier.send("READY=1", f"STATUS={loop.status()}")
        health.say("working")
        health.publish(now=True)
        told_s = said_s = looked_s = time.monotonic()
        every_s = min(_NOTIFY_S, (notifier.watchdog_s or 2.0) / 4)
        try:
            while not stop.asked:
                advanced = loop.turn()
                now_s = time.monotonic()
                if advanced and now_s - told_s >= every_s:
                    notifier.send("WATCHDOG=1")
                    told_s = now_s
                if now_s - said_s >= _STATUS_S:
                    notifier.send(f"STATUS={loop.status()}")
                    said_s = now_s
                if messages.last_fault:
                    health.fault(messages.last_fault)
                health.publish()
                if health.kept and now_s - looked_s >= _BOARD_S:
                    looked_s = now_s
                    self._check_board()
        finally:
            notifier.send("STOPPING=1")
            health.say("stopped")
            with contextlib.suppress(HypermaskError):
                loop.stop()
            health.publish(now=True)
        return STOPPED

    def _check_board(self) -> None:
        if self._number() != self._board:
            raise HypermaskError(
                "BOARD-NEW",
                "the blackboard was made anew by another service",
                "This one starts again by itself.",
            )


class _Stop:
    """Set by SIGTERM and SIGINT."""

    def __init__(self, at_once: bool) -> None:
        self.asked, self._at_once = False, at_once
        signal.signal(signal.SIGTERM, self._ask)
        signal.signal(signal.SIGINT, self._ask)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        signal.setitimer(signal.ITIMER_REAL, _END_S)
        if self._at_once:
            raise SystemExit(STOPPED)


def _leave(number: int, frame: FrameType | None) -> None:
    """Before anything is open there is nothing to put in order."""
    raise SystemExit(STOPPED)


def _where(error: BaseException) -> str:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None:
        return "?"
    return f"{Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno}"


def main(arguments: list[str], run_it: Callable[[str], int] = run) -> int:
    """`python3 -m hypermask.services NAME`."""
    if len(arguments) != 1 or arguments[0] not in NAMES:
        print(f"usage: python3 -m hypermask.services {'|'.join(NAMES)}", file=sys.stderr)
        return 2
    return run_it(arguments[0])
