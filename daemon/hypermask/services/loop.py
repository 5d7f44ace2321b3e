"""What every service does: turn after turn of its work, told to systemd and to the blackboard."""

from __future__ import annotations

from typing import Protocol


class Loop(Protocol):
    """One worker's work. A turn takes at most about a tenth of a second, so that a service ends
    soon after it was told to."""

    def begin(self) -> None:
        """Called once before the first turn: in a rehearsal, when the scenario's time begins."""
        ...

    def turn(self) -> bool:
        """True when work advanced: something was taken, shown or moved, or an absent device was
        asked for again. Only then the watchdog is told so."""
        ...

    def status(self) -> str:
        """A few words for `systemctl status`."""
        ...

    def stop(self) -> None:
        """Leave devices as they should be left: dark, halted, closed."""
        ...


class Quiet:
    """The work of a service whose device this machine does not have: it waits."""

    WAIT_S = 0.1

    def __init__(self, words: str) -> None:
        self._words = words

    def begin(self) -> None:
        """Nothing."""

    def turn(self) -> bool:
        import time

        time.sleep(self.WAIT_S)
        return True

    def status(self) -> str:
        return self._words

    def stop(self) -> None:
        """Nothing."""
