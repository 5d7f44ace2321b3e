"""What was heard before is not heard again: doubled, too late or replayed datagrams."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

from hypermask.errors import HypermaskError
from hypermask.storage import write_atomically

_WINDOW = 64
_NOTE_EVERY = 750


def next_session(memory: Path | None) -> int:
    """A number for a sender's start, larger than all before it, even where clocks boot in 1970.

    memory: a file that keeps the last one.
    """
    session = max(int(time.time()), _noted(memory)[0] + 1) % 2**32
    _note(memory, session, 0)
    return session


class Guard:
    """Tells which datagrams are new.

    trusted: they are authenticated, so that a new session is the sender's word; what was heard is
    then kept in the file `memory` over restarts. Otherwise a session that plays is not cut off by
    another address.
    """

    def __init__(self, trusted: bool, memory: Path | None = None) -> None:
        self._trusted, self._memory = trusted, memory
        self._session, self._highest = _noted(memory) if trusted else (-1, -1)
        self._seen = (1 << _WINDOW) - 1 if self._session >= 0 else 0
        self._address = ""

    def begins(self, session: int, address: str, lost: bool) -> bool:
        """Whether a datagram of that session may be heard at all; lost: none is playing."""
        if session == self._session:
            return self._trusted or not self._address or address == self._address or lost
        if self._trusted:
            return session > self._session
        return lost or (address == self._address and session > self._session)

    def is_new(self, session: int, number: int, address: str) -> bool:
        """Takes note of a datagram that may be heard; False for one that was heard or is old."""
        if session != self._session:
            self._session, self._highest, self._seen = session, number, 1
            self._address = address
            self._keep()
            return True
        self._address = address
        if number > self._highest:
            self._seen = (self._seen << min(number - self._highest, _WINDOW)) | 1
            self._seen &= (1 << _WINDOW) - 1
            if number // _NOTE_EVERY != self._highest // _NOTE_EVERY:
                self._highest = number
                self._keep()
            self._highest = number
            return True
        back = self._highest - number
        if back >= _WINDOW or self._seen >> back & 1:
            return False
        self._seen |= 1 << back
        return True

    def _keep(self) -> None:
        if self._trusted:
            _note(self._memory, self._session, self._highest)


def _noted(memory: Path | None) -> tuple[int, int]:
    try:
        session, number = memory.read_text("ascii").split() if memory else ("-1", "-1")
        return int(session), int(number)
    except (OSError, ValueError):
        return -1, -1


def _note(memory: Path | None, session: int, number: int) -> None:
    """A full disk stops no show."""
    if memory is not None:
        with contextlib.suppress(HypermaskError):
            write_atomically(memory, f"{session} {number}\n".encode())
