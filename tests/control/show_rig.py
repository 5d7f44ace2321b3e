"""A show worker on a virtual clock: simulated keypad, shared blackboard, a control socket."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypermask.show.engine import ShowEngine
from hypermask.show.showfile import ShowFile, load_show
from hypermask.workers.board import Board
from hypermask.workers.control import ControlServer
from hypermask.workers.devices import SideDevices
from hypermask.workers.modes import Modes
from hypermask.workers.show import ShowWorker
from hypermask_drivers.clock import VirtualClock
from hypermask_sim.devices.keypad import SimKeypad
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World

DEFAULT = Path(__file__).parents[2] / "configs" / "shows" / "default.toml"
STEP_S = 0.01


class Rig:
    """`run` lets time pass, a step of the worker every 10 ms."""

    def __init__(
        self,
        folder: Path,
        modes: Modes | None = None,
        devices: Callable[[Board, VirtualClock, Any], SideDevices] | None = None,
        show: ShowFile | None = None,
        reload: Callable[[], ShowFile] | None = None,
        start_s: float = 1000.0,
        faults: tuple[dict[str, Any], ...] = (),
    ) -> None:
        self.folder = folder
        self.clock = VirtualClock(start_s)
        self.board = Board.shared(folder / "board")
        self.told: list[tuple[str, str]] = []
        scenario = Scenario.model_validate({"faults": list(faults)})
        self.keypad = SimKeypad(World(scenario, start_s), self.clock)
        self.server = ControlServer(folder / "control.sock")
        self.worker = ShowWorker(
            self.keypad,
            ShowEngine(show or load_show(DEFAULT), self.clock.now()),
            self.board,
            self.clock,
            self.report,
            control=self.server,
            modes=modes,
            devices=devices(self.board, self.clock, self.report) if devices else None,
            reload=reload,
        )

    def report(self, time_s: float, code: str, text: str) -> None:
        self.told.append((code, text))

    @property
    def codes(self) -> list[str]:
        return [code for code, _ in self.told]

    def run(self, seconds: float) -> None:
        end_s = self.clock.now() + seconds
        while self.clock.now() < end_s - 1e-9:
            self.clock.sleep_until(self.clock.now() + STEP_S)
            while self.worker.step():
                pass

    def press(self, key: str) -> None:
        """Pressed for 80 ms, as a finger does."""
        self.keypad.press(key)
        self.run(0.1)

    def hold(self, key: str, seconds: float) -> None:
        """Press, and let go after so long."""
        now_s = self.keypad.now()
        self.keypad._events.append((now_s, -1, key, True))
        self.keypad._events.append((now_s + seconds, 10**6, key, False))
        self.keypad._events.sort()
        self.run(seconds + 0.05)

    def client(self) -> socket.socket:
        client = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        client.settimeout(0.0)
        client.connect(str(self.server.path))
        return client

    def ask(self, **request: Any) -> dict[str, Any]:
        """The answer to a request, by a client of its own."""
        with self.client() as client:
            client.send(json.dumps(request).encode())
            self.run(0.02)
            return read(client)

    def code(self, **request: Any) -> str:
        """Code of the refusal."""
        answer = self.ask(**request)
        assert answer["ok"] is False
        return str(answer["error"]["code"])

    def close(self) -> None:
        self.worker.stop()


def read(client: socket.socket) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(client.recv(1 << 17))
    return answer
