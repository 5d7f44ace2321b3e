"""The emulated pan-tilt unit on a real pseudo-terminal, at the end of a stable name.

`python -m hypermask_sim.emulators.ptu_line /run/ptu` stands in for a unit; without a name for the
line it answers on standard input and output, for a virtual machine's serial port.
"""

from __future__ import annotations

import argparse
import array
import contextlib
import fcntl
import os
import select
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from hypermask_drivers.clock import Clock, RealClock, VirtualClock
from hypermask_drivers.pantilt.serial_line import SerialLine
from hypermask_sim.emulators.ptu import PtuData, PtuUnit

T = TypeVar("T")

_TICK_S = 0.05


class CountedLine(SerialLine):
    """Counts the bytes that were sent, so that nobody overtakes them."""

    def __init__(self, path: str, baud: int) -> None:
        super().__init__(path, baud)
        self.sent = 0

    def write(self, data: bytes) -> None:
        self.sent += len(data)
        super().write(data)


class PtuLine:
    """plug: the line appears under `link`; unplug: it hangs up, as a pulled USB cable does.

    On a `VirtualClock` the unit answers at once and goes on when `settle` is called; `catch_up`
    comes before the clock is moved.
    """

    def __init__(self, unit: PtuUnit, clock: Clock, link: Path) -> None:
        self.unit, self.link = unit, link
        self._clock = clock
        self._lock = threading.Lock()
        self._master = self._slave = -1
        self._wake = os.pipe()
        self._thread: threading.Thread | None = None
        self._received = 0
        self._connected: CountedLine | None = None

    def connect(self, path: str, baud: int) -> SerialLine:
        """For a driver that `catch_up` shall wait for."""
        self._connected = CountedLine(path, baud)
        self._received = 0
        return self._connected

    def catch_up(self) -> None:
        """Wait until all that was sent has been heard."""
        while self.plugged and self._connected and self._received < self._connected.sent:
            time.sleep(0)

    @property
    def plugged(self) -> bool:
        return self._thread is not None

    def plug(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(self._slave))
        self._thread = threading.Thread(target=self._serve, args=(self._master,), daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        if self._thread is None:
            return
        self.link.unlink(missing_ok=True)
        thread, self._thread = self._thread, None
        os.write(self._wake[1], b"x")
        thread.join()
        self._connected = None
        os.read(self._wake[0], 1)
        os.close(self._slave)
        os.close(self._master)

    def close(self) -> None:
        self.unplug()
        for end in self._wake:
            with contextlib.suppress(OSError):
                os.close(end)

    def settle(self) -> None:
        """Let the unit do all that is due by now, and wait until it has arrived."""
        with self._lock:
            data = self.unit.transmit(self._clock.now())
            if data and self.plugged:
                before = self._waiting()
                os.write(self._master, data)
                while self._waiting() < before + len(data):
                    pass

    def do(self, action: Callable[[PtuUnit, float], T]) -> T:
        """Look at the unit or make it fail while it is served: `action(unit, clock time)`."""
        with self._lock:
            return action(self.unit, self._clock.now())

    def _waiting(self) -> int:
        """Bytes that the reader has not taken yet."""
        count = array.array("i", [0])
        fcntl.ioctl(self._slave, termios.FIONREAD, count)
        return count[0]

    def _serve(self, master: int) -> None:
        stop = self._wake[0]
        while True:
            ready, _, _ = select.select([master, stop], [], [], self._wait_s())
            if stop in ready:
                return
            with self._lock, contextlib.suppress(OSError):
                if master in ready:
                    data = os.read(master, 4096)
                    self.unit.receive(data, self._clock.now())
                    self._received += len(data)
                os.write(master, self.unit.transmit(self._clock.now()))

    def _wait_s(self) -> float | None:
        if isinstance(self._clock, VirtualClock):
            return None
        with self._lock:
            return min(_TICK_S, max(0.0, self.unit.next_s() - self._clock.now()))


def serve(unit: PtuUnit, receive: int, send: int, clock: Clock) -> None:
    """Play the unit on two file descriptors until the other side hangs up."""
    while True:
        wait_s = min(_TICK_S, max(0.0, unit.next_s() - clock.now()))
        ready, _, _ = select.select([receive], [], [], wait_s)
        if ready:
            data = os.read(receive, 4096)
            if not data:
                return
            unit.receive(data, clock.now())
        os.write(send, unit.transmit(clock.now()))


def main() -> None:
    parser = argparse.ArgumentParser(description="Stand in for a pan-tilt unit.")
    parser.add_argument("link", nargs="?", type=Path, help="name of the line that appears")
    parser.add_argument("--homing", type=float, default=PtuData().homing_s, help="seconds")
    parser.add_argument("--baud", type=int, default=9600)
    arguments = parser.parse_args()
    unit = PtuUnit(PtuData(homing_s=arguments.homing, baud=arguments.baud))
    clock = RealClock()
    unit.power_cycle(clock.now())
    if arguments.link is None:
        serve(unit, sys.stdin.fileno(), sys.stdout.fileno(), clock)
        return
    line = PtuLine(unit, clock, arguments.link)
    line.plug()
    with contextlib.suppress(KeyboardInterrupt):
        threading.Event().wait()
    line.close()


if __name__ == "__main__":
    main()
