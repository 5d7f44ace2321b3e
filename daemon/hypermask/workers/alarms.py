"""One message when a fault begins, one when it is over; collected in the background."""

from __future__ import annotations

from collections import deque

from hypermask.errors import HypermaskError
from hypermask.workers.retry import Report


class Alarms:
    """`tell` may be called from another thread; `flush`, from the worker's, hands on."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._told: deque[tuple[float, str, str]] = deque(maxlen=64)
        self._on: dict[str, str] = {}

    def tell(self, time_s: float, code: str, text: str) -> None:
        self._told.append((time_s, code, text))

    def flush(self) -> None:
        while self._told:
            self._report(*self._told.popleft())

    def is_on(self, what: str) -> bool:
        return bool(self._on.get(what))

    def watch(
        self, what: str, fault: str, error: HypermaskError, over: tuple[str, str], now_s: float
    ) -> None:
        """fault: empty when all is well, else what makes it another fault than the one before;
        over: code and text of the end."""
        if fault == self._on.get(what, ""):
            return
        self._on[what] = fault
        if fault:
            self.tell(now_s, error.code, str(error))
        else:
            self.tell(now_s, *over)

    def once(self, what: str, error: HypermaskError, now_s: float) -> None:
        """Said again only after `forget`, or when it is another error."""
        if self._on.get(what) != error.code:
            self._on[what] = error.code
            self.tell(now_s, error.code, str(error))

    def forget(self, what: str) -> None:
        self._on.pop(what, None)
