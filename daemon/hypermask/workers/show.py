"""The show worker: keys in, the scene out."""

from __future__ import annotations

from hypermask.show.engine import ShowEngine
from hypermask.workers.board import Board
from hypermask.workers.retry import Kept, Report
from hypermask_drivers.clock import Clock
from hypermask_drivers.keypad import Keypad


class ShowWorker:
    """Owns the keypad; writes `Board.scene` when it starts and after every cue."""

    def __init__(
        self, keypad: Keypad, engine: ShowEngine, board: Board, clock: Clock, report: Report
    ) -> None:
        self._keypad = Kept(keypad, "keypad", clock, report)
        self._engine, self._board, self._report = engine, board, report
        board.scene.publish(engine.scene)

    def step(self, timeout_s: float = 0.0) -> bool:
        """Take one key event if there is one; False when there was none."""
        event = self._keypad.use(lambda keypad: keypad.read(timeout_s))
        if event is None:
            return False
        called = self._engine.press(event.key, event.time_s) if event.pressed else None
        if called is not None:
            self._report(called.time_s, "CUE", f"Key {event.key}: {called.cue}")
            self._board.scene.publish(self._engine.scene)
        return True
