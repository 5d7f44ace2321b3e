"""Takes over a calibration that was stored while the stage runs."""

from __future__ import annotations

from collections.abc import Callable

from hypermask.calibration import storage
from hypermask.calibration.fixed import Fixed
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.planar import Planar
from hypermask.errors import HypermaskError
from hypermask.workers.retry import Report

EVERY_S = 0.5

Calibration = ProCam | Planar | Fixed
Take = Callable[[Calibration], bool]
"""The stage takes it over from the next frame on; False where it cannot draw through it."""


class CalibrationWatch:
    """Call `step` in the time that is left after a flip; it looks at one file now and then."""

    def __init__(self, take: Take, report: Report) -> None:
        self._take, self._report = take, report
        self._known = _mark()
        self._next_s = -float("inf")

    def step(self, now_s: float) -> bool:
        """True when a new calibration is in use."""
        if now_s < self._next_s:
            return False
        self._next_s = now_s + EVERY_S
        mark = _mark()
        if mark == self._known:
            return False
        self._known = mark
        try:
            stored, warning = storage.load_current()
        except HypermaskError as error:
            self._report(now_s, error.code, f"{error} The one in use stays.")
            return False
        if warning is not None:
            self._report(now_s, warning.partition(":")[0], warning)
        if not self._take(stored.calibration):
            text = f"CAL-CART: {stored.name} ({stored.method}) is of another kind of machine."
            self._report(now_s, "CAL-CART", f"{text} The one in use stays; calibrate this one.")
            return False
        self._report(now_s, "CAL-TAKEN", f"{stored.name} is in use.")
        return True


def _mark() -> tuple[int, int, int] | None:
    """Changes whenever another calibration is made the current one."""
    try:
        found = (storage.folder() / storage.CURRENT).stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_ino, found.st_size
