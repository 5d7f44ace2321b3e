"""From a buffer's time stamp to the time of mid-exposure, and the frame rate really delivered."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from hypermask_drivers.camera import v4l2_abi as abi

_PLAUSIBLE_S = 5.0  # a stamp farther from the time of arrival is of another clock


@dataclass(frozen=True)
class Stamp:
    """trusted: whether it comes from the driver's own stamp on CLOCK_MONOTONIC."""

    time_s: float
    trusted: bool


def mid_exposure(
    buffer: abi.Buffer, now_s: float, exposure_s: float, readout_s: float, rolling: bool
) -> Stamp:
    """Mid-exposure of the picture's middle, clock seconds; `now_s` is when it was fetched.

    A rolling shutter exposes its middle line half a readout after its first. Without a stamp that
    can be used the frame is taken to have ended when it was fetched.
    """
    stamp_s = buffer.timestamp.seconds + buffer.timestamp.microseconds * 1e-6
    clock = buffer.flags & abi.BUF_FLAG_TIMESTAMP_MASK
    trusted = clock == abi.BUF_FLAG_TIMESTAMP_MONOTONIC and -1e-3 < now_s - stamp_s < _PLAUSIBLE_S
    source = buffer.flags & abi.BUF_FLAG_TSTAMP_SRC_MASK
    middle = readout_s / 2 if rolling else 0.0
    if trusted and source == abi.BUF_FLAG_TSTAMP_SRC_SOE:
        return Stamp(stamp_s + exposure_s / 2 + middle, True)
    end_s = stamp_s if trusted else now_s
    return Stamp(end_s - readout_s - exposure_s / 2 + middle, trusted)


class RateMeter:
    """The rate at which frames are exposed, over the last `count` frames."""

    def __init__(self, count: int = 64) -> None:
        self._seen: deque[tuple[float, int]] = deque(maxlen=count)
        self.rate_hz: float | None = None

    def add(self, time_s: float, sequence: int) -> bool:
        """True when the rate is known anew."""
        self._seen.append((time_s, sequence))
        if len(self._seen) < (self._seen.maxlen or 0):
            return False
        (first_s, first), (last_s, last) = self._seen[0], self._seen[-1]
        if last_s <= first_s:
            return False
        self.rate_hz = (last - first) / (last_s - first_s)
        return True
