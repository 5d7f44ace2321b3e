"""The show worker: keys in, the scene out."""

from __future__ import annotations

from hypermask.show.engine import ShowEngine
from hypermask.workers.board import Board
from hypermask.workers.retry import Kept, Report
from hypermask_drivers.clock import Clock
from hypermask_drivers.keypad import Keypad


class ShowWorker:
    """Owns the keypad, if there is one; writes `Board.scene` when it starts, after every cue and
    every arrival."""

    def __init__(
        self, keypad: Keypad | None, engine: ShowEngine, board: Board, clock: Clock, report: Report
    ) -> None:
        self._keypad = None if keypad is None else Kept(keypad, "keypad", clock, report)
        self._engine, self._board, self._report = engine, board, report
        self._clock = clock
        self._arrived = 0
        board.scene.publish(engine.scene)

    def step(self, timeout_s: float = 0.0) -> bool:
        """Take one key event if there is one; False when there was none."""
        self._welcome()
        keypad = self._keypad
        event = None if keypad is None else keypad.use(lambda device: device.read(timeout_s))
        if event is None:
            return False
        called = self._engine.press(event.key, event.time_s) if event.pressed else None
        if called is not None:
            self._report(called.time_s, "CUE", f"Key {event.key}: {called.cue}")
            self._board.scene.publish(self._engine.scene)
        return True

    def _welcome(self) -> None:
        """Characters that the stage has got ready join the show."""
        curtain, wardrobe = self._board.curtain.latest(), self._board.wardrobe.latest()
        if curtain is None or wardrobe is None or int(curtain["dressed"]) <= self._arrived:
            return
        now_s, dressed = self._clock.now(), int(curtain["dressed"])
        new = [
            entry for entry in wardrobe["costumes"] if self._arrived < entry["version"] <= dressed
        ]
        for entry in sorted(new, key=lambda entry: int(entry["version"])):
            name = entry["name"].decode()
            if self._engine.arrive(name, bool(entry["appear"]), now_s):
                self._report(now_s, "CHAR-JOINS", f"The character '{name}' joins the show.")
        self._arrived = dressed
        self._board.scene.publish(self._engine.scene)
