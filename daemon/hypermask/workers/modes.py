"""Modes of the show worker: for a while the keypad belongs to something else than the show.

A mode is begun by the control socket or by holding a key (`HELD`); every key then goes to it.
Holding the key again leaves it, as does the control socket.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from hypermask.errors import HypermaskError, UsageError
from hypermask.workers.board import WORDS, Board
from hypermask.workers.retry import Report

HELD = {"numlock": "calibrate", "slash": "lesson"}
"""Key -> the mode that is begun, or left, by holding it."""
HOLD_S = 3.0
_JOURNAL_S = 1.0
"""Words that change faster are not all written down."""


class Mode(Protocol):
    """What the keypad can be lent to. All times are clock times.

    A mode may have a method `end(now_s)`: it is called once however the mode ends, also when it is
    left before it is over. What it publishes (an overlay, a lesson) it takes back there.
    """

    @property
    def name(self) -> str: ...

    def begin(self, now_s: float) -> None:
        """Raises `HypermaskError` when it cannot begin; it is then not entered."""
        ...

    def press(self, key: str, now_s: float) -> None:
        """A key of `show.showfile.KEY_NAMES` was pressed."""
        ...

    def step(self, now_s: float) -> bool:
        """Some milliseconds of work; False when the mode is over."""
        ...

    def words(self) -> str:
        """One or two lines for the operator, 160 characters at the most."""
        ...


Modes = Mapping[str, Callable[[], Mode]]


class ModeKeeper:
    """At most one mode at a time; its words are on `Board.words` and in the journal.

    A mode that fails is left with one message: the show goes on.
    """

    def __init__(self, modes: Modes, board: Board, report: Report) -> None:
        self._modes, self._board, self._report = modes, board, report
        self._mode: Mode | None = None
        self._said = ""
        self._written = ""
        self._written_s = -np.inf

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self._modes)

    @property
    def active(self) -> str:
        """Name of the mode that has the keypad, empty without one."""
        return "" if self._mode is None else self._mode.name

    @property
    def words(self) -> str:
        return self._said

    def begin(self, name: str, now_s: float) -> None:
        """Raises `UsageError` MODE-NAME, MODE-BUSY, and what the mode raises."""
        if name not in self._modes:
            known = ", ".join(self._modes) or "none"
            raise UsageError("MODE-NAME", f"this show has no mode '{name}'", f"Known: {known}.")
        if self._mode is not None:
            raise UsageError(
                "MODE-BUSY", f"the mode '{self.active}' is on", "Leave it first, or let it end."
            )
        mode = self._modes[name]()
        mode.begin(now_s)
        self._mode = mode
        self._report(now_s, "MODE-ON", f"The keypad belongs to the mode '{mode.name}'.")
        self._guard(now_s, lambda: self._say(mode, now_s))

    def cancel(self, now_s: float) -> None:
        """Raises `UsageError` MODE-NONE without a mode."""
        if self._mode is None:
            raise UsageError("MODE-NONE", "no mode is on", "Begin one first.")
        self._leave(now_s, "was left")

    def toggle(self, name: str, now_s: float) -> None:
        """What holding a key does: leave whatever is on, or begin. Never raises."""
        if self._mode is not None:
            self._leave(now_s, "was left")
            return
        try:
            self.begin(name, now_s)
        except HypermaskError as error:
            self._report(now_s, error.code, str(error))

    def press(self, key: str, now_s: float) -> None:
        """To be called while a mode is on."""
        mode = self._mode
        if mode is not None:
            self._guard(now_s, lambda: mode.press(key, now_s))

    def step(self, now_s: float) -> None:
        mode = self._mode
        if mode is not None:
            self._guard(now_s, lambda: self._go_on(mode, now_s))

    def close(self, now_s: float) -> None:
        if self._mode is not None:
            self._leave(now_s, "ends with the show")

    def _go_on(self, mode: Mode, now_s: float) -> None:
        going_on = mode.step(now_s)
        self._say(mode, now_s)
        if not going_on:
            self._leave(now_s, "is over")

    def _guard(self, now_s: float, action: Callable[[], None]) -> None:
        try:
            action()
        except HypermaskError as error:
            self._report(now_s, error.code, str(error))
            self._leave(now_s, "was left because of a fault")
        except Exception as error:  # a fault in a mode must not end the show
            self._report(now_s, "MODE-FAILED", str(_failed(error)))
            self._leave(now_s, "was left because of a fault")

    def _leave(self, now_s: float, why: str) -> None:
        mode, self._mode = self._mode, None
        if mode is None:
            return
        end = getattr(mode, "end", None)
        try:
            if end is not None:
                end(now_s)
        except Exception as error:  # as above
            self._report(now_s, "MODE-FAILED", str(_failed(error)))
        if self._said != self._written:
            self._write(now_s)
        self._report(now_s, "MODE-OFF", f"The mode '{mode.name}' {why}; the keys call cues again.")
        self._said = self._written = ""
        self._publish("", now_s)

    def _say(self, mode: Mode, now_s: float) -> None:
        words = mode.words()
        if words != self._said:
            self._said = words
            self._publish(mode.name, now_s)
        if words != self._written and now_s - self._written_s >= _JOURNAL_S:
            self._write(now_s)

    def _write(self, now_s: float) -> None:
        if self._said:
            self._report(now_s, "MODE-WORDS", " ".join(self._said.split()))
        self._written, self._written_s = self._said, now_s

    def _publish(self, name: str, now_s: float) -> None:
        record = np.zeros((), WORDS)
        record["time_s"] = now_s
        record["mode"] = _fitting(name, 24)
        record["words"] = _fitting(self._said, 160)
        self._board.words.publish(record)


class Hold:
    """Tells a key that is held from one that is pressed. A key of `keys` acts when it is let go
    before `HOLD_S`, so that holding it does nothing else; every other key acts at once."""

    def __init__(self, keys: Mapping[str, str]) -> None:
        self._keys = keys
        self._since: dict[str, float] = {}

    def event(self, key: str, pressed: bool, time_s: float) -> tuple[str, str] | None:
        """("press", key) or ("hold", mode) where something is to be done, else None."""
        if key not in self._keys:
            return ("press", key) if pressed else None
        if pressed:
            self._since.setdefault(key, time_s)
            return None
        since_s = self._since.pop(key, None)
        if since_s is None:  # it was held long enough before, and that was acted on
            return None
        return ("hold", self._keys[key]) if time_s - since_s >= HOLD_S else ("press", key)

    def due(self, now_s: float) -> str | None:
        """The mode whose key has just been held long enough. To be called when no event waits."""
        for key, since_s in self._since.items():
            if now_s - since_s >= HOLD_S:
                del self._since[key]
                return self._keys[key]
        return None

    def forget(self) -> None:
        """The keypad vanished: nobody holds anything."""
        self._since.clear()


def _failed(error: Exception) -> HypermaskError:
    return HypermaskError(
        "MODE-FAILED",
        f"the mode has a fault ({type(error).__name__}: {' '.join(str(error).split())})",
        "Begin it again; send us the bundle (hypermask bundle).",
    )


def _fitting(text: str, size: int) -> bytes:
    """UTF-8 of at most `size` bytes, no character cut in two."""
    return text.encode()[:size].decode(errors="ignore").encode()
