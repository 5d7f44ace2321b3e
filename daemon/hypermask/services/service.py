"""A service from its start to its end: settings, blackboard, devices, real time, watchdog."""

from __future__ import annotations

import contextlib
import signal
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import FrameType

from hypermask.errors import ConfigError, HypermaskError
from hypermask.services.messages import ERROR, Messages
from hypermask.services.notify import Notifier

NAMES = ("tracker", "voice", "stage", "pantilt", "show", "dresser", "safe")
STOPPED, FAILED, UNUSABLE = 0, 1, 78
"""Exit codes; 78 is EX_CONFIG of sysexits.h: starting again would change nothing."""
_NOTIFY_S = 0.5
_STATUS_S = 1.0
_BOARD_S = 1.0
_END_S = 0.9
"""A service that has not ended so long after SIGTERM is ended by the kernel."""


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
    from hypermask.machine.files import load_machine
    from hypermask.services.board import board_folder, number_of, open_board
    from hypermask.services.rig import MachineRig
    from hypermask.workers.health import Health
    from hypermask.workers.realtime import be_realtime, freeze_garbage
    from hypermask_drivers.clock import RealClock

    machine = load_machine(messages.tell)
    board = open_board()
    number = number_of(board_folder())
    health = Health(board.folder, name, RealClock())
    health.publish(now=True)
    rig = MachineRig(machine, board, messages, health)
    loop = import_module(f"hypermask.services.{name}").build(rig)
    worker = getattr(machine.workers, name, machine.workers.dresser)
    granted = be_realtime(worker.priority, worker.affinity, worker.lock_memory, worker.nice)
    health.record["granted"] = ", ".join(granted).encode()[:64]
    if worker.priority and not any("SCHED_FIFO" in word for word in granted):
        messages.tell("SVC-RIGHTS", "SVC-RIGHTS: no right to real-time priority; timing may suffer")
    loop.begin()
    freeze_garbage()
    stop = _Stop()
    notifier.send("READY=1", f"STATUS={loop.status()}")
    health.say("working")
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
            if now_s - looked_s >= _BOARD_S:
                looked_s = now_s
                if number_of(board_folder()) != number:
                    raise HypermaskError(
                        "BOARD-NEW",
                        "the blackboard was made anew by another service",
                        "This one starts again by itself.",
                    )
    finally:
        notifier.send("STOPPING=1")
        health.say("stopped")
        with contextlib.suppress(HypermaskError):
            loop.stop()
        health.publish(now=True)
    return STOPPED


class _Stop:
    """Set by SIGTERM and SIGINT."""

    def __init__(self) -> None:
        self.asked = False
        signal.signal(signal.SIGTERM, self._ask)
        signal.signal(signal.SIGINT, self._ask)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        signal.setitimer(signal.ITIMER_REAL, _END_S)


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
