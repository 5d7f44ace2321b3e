"""A stand-in for the module `alsaaudio` with sound cards that can be unplugged and renumbered.

A card counts frames by a quartz of its own and moves its counter in steps, as USB does; its stream
stops when its buffer runs over. What each read gives, it gives as pyalsaaudio 0.11 on a hw: device.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.clock import Clock

Frames = NDArray[np.float64]
Signal = Callable[[NDArray[np.int64]], Frames]

_BYTES = {"S16_LE": 2, "S24_3LE": 3, "S24_LE": 4, "S32_LE": 4, "FLOAT_LE": 4, "MU_LAW": 1}


class AlsaError(Exception):
    """`alsaaudio.ALSAAudioError`: nothing but a text."""


def _fail(number: int, device: str) -> AlsaError:
    return AlsaError(f"{os.strerror(number)} [{device}]")


class EmulatedCard:
    """signal: from frame numbers (n,) since the card was plugged to samples (n,) or (n, channels).

    drift_ppm: of its quartz; step_s: how far its counter moves at once; jitter_s: how late its
    time stamps are at most; formats: what it has, its first is what one gets who asks for others.
    """

    def __init__(
        self,
        clock: Clock,
        name: str = "hypermask_mic",
        rate_hz: int = 48000,
        channels: int = 1,
        formats: tuple[str, ...] = ("S16_LE",),
        signal: Signal | None = None,
        drift_ppm: float = 0.0,
        step_s: float = 0.0,
        jitter_s: float = 0.0,
        seed: int = 1,
    ) -> None:
        self.clock, self.name, self.number = clock, name, 0
        self.rate_hz, self.channels, self.formats = rate_hz, channels, formats
        self.signal = signal or (lambda frames: np.zeros(len(frames)))
        self.frames_hz = rate_hz * (1 + drift_ppm * 1e-6)
        self.step_s, self.jitter_s = step_s, jitter_s
        self.random = np.random.default_rng(seed)
        self.present = True
        self.busy = self.mute = self.forbidden = False
        self.stamps = True
        self.plugged = 1
        self.opened = 0

    def unplug(self) -> None:
        self.present = False
        self.plugged += 1

    def plug(self, number: int | None = None) -> None:
        """It comes back, under another number if given."""
        self.present = True
        self.number = self.number if number is None else number

    def frame_at(self, time_s: float) -> float:
        """Frames since clock time 0 by the card's own quartz."""
        return time_s * self.frames_hz

    def time_of(self, frame: float) -> float:
        """Clock time at which that frame sounded."""
        return frame / self.frames_hz


class EmulatedAlsa:
    """Has the names of the module `alsaaudio` that the driver uses."""

    PCM_CAPTURE, PCM_NONBLOCK = 1, 1
    PCM_TSTAMP_ENABLE, PCM_TSTAMP_TYPE_MONOTONIC = 1, 1
    PCM_STATE_RUNNING, PCM_STATE_XRUN, PCM_STATE_DISCONNECTED = 3, 4, 8
    PCM_FORMAT_S16_LE, PCM_FORMAT_S32_LE, PCM_FORMAT_S24_3LE = "S16_LE", "S32_LE", "S24_3LE"
    PCM_FORMAT_S24_LE, PCM_FORMAT_FLOAT_LE = "S24_LE", "FLOAT_LE"
    ALSAAudioError: ClassVar[type[Exception]] = AlsaError

    def __init__(self, cards: list[EmulatedCard]) -> None:
        self.cards = cards

    def PCM(self, kind: int, mode: int, *, device: str, **wanted: Any) -> EmulatedPcm:
        for card in self.cards:
            names = (f"hw:CARD={card.name}", card.name, f"hw:{card.number}")
            if device in names and card.present:
                if card.busy:
                    raise _fail(errno.EBUSY, device)
                if card.forbidden:
                    raise _fail(errno.EACCES, device)
                card.opened += 1
                return EmulatedPcm(card, device, **wanted)
        raise _fail(errno.ENODEV, device)


class EmulatedPcm:
    """One capture stream, from its opening to its card's end."""

    def __init__(
        self,
        card: EmulatedCard,
        device: str,
        rate: int,
        channels: int,
        format: str,
        periodsize: int,
        periods: int,
    ) -> None:
        self._card, self._device, self._plugged = card, device, card.plugged
        self._format = format if format in card.formats else card.formats[0]
        self._period = max(1, round(periodsize * card.rate_hz / rate))
        self._size = self._period * periods
        self._first: float | None = None  # the frame at which the stream began
        self._taken, self._overran, self._closed = 0, False, False

    def info(self) -> dict[str, Any]:
        return {
            "format_name": self._format, "rate": self._card.rate_hz,
            "channels": self._card.channels, "period_size": self._period,
            "buffer_size": self._size,
        }  # fmt: skip

    def set_tstamp_mode(self, mode: int) -> None:
        return

    def set_tstamp_type(self, kind: int) -> None:
        return

    def polldescriptors(self) -> list[tuple[int, int]]:
        return []

    def close(self) -> None:
        self._closed = True

    def avail(self) -> int:
        """Since version 0.11; Debian 13 has 0.10."""
        return self._waiting()

    def _waiting(self) -> int:
        if self._gone():
            return -errno.ENODEV
        waiting, _ = self._counted()
        return -errno.EPIPE if self._overran else waiting

    def state(self) -> int:
        states = {-errno.ENODEV: "DISCONNECTED", -errno.EPIPE: "XRUN"}
        return int(getattr(EmulatedAlsa, f"PCM_STATE_{states.get(self._waiting(), 'RUNNING')}"))

    def htimestamp(self) -> tuple[int, int, int]:
        if self._gone():
            raise _fail(errno.ENODEV, self._device)
        if not self._card.stamps:
            return 0, 0, self._waiting()
        waiting, time_s = self._counted()
        late_s = self._card.jitter_s * self._card.random.random()
        stamp_s = min(time_s + late_s, self._card.clock.now())
        return int(stamp_s), int((stamp_s % 1) * 1e9), waiting

    def read(self) -> tuple[int, bytes]:
        if self._gone():
            raise _fail(errno.ENODEV, self._device)
        waiting, _ = self._counted()
        if self._overran:
            self._overran, self._first, self._taken = False, None, 0
            return -errno.EPIPE, b""
        if self._first is None:
            self._first = float(np.ceil(self._card.frame_at(self._card.clock.now())))
            return 0, b""
        count = min(waiting, self._period)
        start = int(self._first) + self._taken
        self._taken += count
        return count, self._bytes(np.arange(start, start + count))

    def _gone(self) -> bool:
        return self._closed or self._card.plugged != self._plugged

    def _counted(self) -> tuple[int, float]:
        """Frames that wait, and the time at which the counter stood there."""
        card = self._card
        now_s = card.clock.now()
        if self._first is None or card.mute:
            return 0, now_s
        if card.step_s:
            now_s = np.floor(now_s / card.step_s) * card.step_s
        # A frame is in the buffer when it is over.
        done = np.floor(card.frame_at(now_s) - self._first + 1e-6)
        waiting = max(int(done) - self._taken, 0)
        self._overran = self._overran or waiting > self._size
        return waiting, card.time_of(self._first + self._taken + waiting) if waiting else now_s

    def _bytes(self, frames: NDArray[np.int64]) -> bytes:
        values = np.asarray(self._card.signal(frames), float)
        if values.ndim == 1:
            values = np.repeat(values[:, None], self._card.channels, axis=1)
        return encode(values, self._format)


def encode(values: Frames, form: str) -> bytes:
    """Samples (n, channels), full scale 1.0, as a card delivers them."""
    if form == "FLOAT_LE":
        return values.astype("<f4").tobytes()
    bits = {"S16_LE": 16, "S24_3LE": 24, "S24_LE": 24}.get(form, 32)
    full = 2.0 ** (bits - 1)
    whole = np.clip(np.round(values * full), -full, full - 1).astype("<i8")
    if form == "S16_LE":
        return whole.astype("<i2").tobytes()
    raw = whole.astype("<i4")
    if form == "S24_3LE":
        return raw.view(np.uint8).reshape(-1, 4)[:, :3].tobytes()
    if form == "S24_LE":
        return (raw & 0xFFFFFF).astype("<i4").tobytes()  # the upper byte means nothing
    if form == "S32_LE":
        return raw.tobytes()
    return bytes(values.size * _BYTES[form])
