"""A microphone by ALSA: whole periods as mono blocks, with the times at which they sounded.

Of the traps of the interface: cards are renumbered, so they are named; a stream that overran stops
and begins anew; some cards vanish with an error and some just fall silent; plugins leave time
stamps out. `DeviceAbsent` and `DeviceLost` ask for another `open`.
"""

from __future__ import annotations

import errno
import re
import select
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import Field, field_validator

from hypermask_drivers.clock import Clock, RealClock, VirtualClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost
from hypermask_drivers.settings import Settings
from hypermask_drivers.sound import SoundBlock, SoundIn
from hypermask_drivers.sound import alsa_library as library
from hypermask_drivers.sound.alsa_samples import FORMATS, mono, sample_bytes
from hypermask_drivers.sound.alsa_time import SampleClock

_NUMBERED = re.compile(r"^(plug|sys)?(hw|default|front|dsnoop):(CARD=)?\d")

_FIRST_SOUND_S = 2.0
"""Cards and sound servers may take their time before the first sample."""


class AlsaSettings(Settings):
    """device: a PCM's name as in `arecord -L`; cards by name, as their numbers change.

    channels: how many to ask for, at best; channel: which one counts, from 0. latency_ms: from
    the sound at the microphone to the sample in the card's hands (converter, USB), a constant.
    silent_after_s: a card that gives nothing for so long is taken for lost.
    """

    device: str = Field("hypermask_mic", min_length=1, max_length=120)
    rate_hz: int = Field(48000, ge=4000, le=768000)
    channels: int = Field(1, ge=1, le=64)
    channel: int | Literal["mix"] = "mix"
    period_ms: float = Field(4.0, ge=1, le=100)
    periods: int = Field(64, ge=3, le=1024)
    format: Literal["any", "S16_LE", "S32_LE", "S24_3LE", "S24_LE", "FLOAT_LE"] = "any"
    latency_ms: float = Field(0.0, ge=0, le=100)
    silent_after_s: float = Field(0.5, ge=0.1, le=10)

    @field_validator("device")
    @classmethod
    def _named(cls, device: str) -> str:
        if _NUMBERED.match(device):
            raise ValueError(
                "cards are numbered anew at each start; name it, such as hw:CARD=hypermask_mic"
            )
        return device

    @field_validator("channel")
    @classmethod
    def _a_channel(cls, channel: int | str) -> int | str:
        if isinstance(channel, int) and not 0 <= channel < 64:
            raise ValueError("channels count from 0 to 63, or 'mix'")
        return channel


@dataclass(frozen=True)
class SoundStatus:
    """What the card really does. overruns: times that sound was lost; repaired: float samples that
    were not finite; drift_ppm: its quartz against CLOCK_MONOTONIC; jitter_ms: of its time stamps.
    """

    device: str
    rate_hz: float
    channels: int
    format: str
    overruns: int
    repaired: int
    drift_ppm: float
    jitter_ms: float


class AlsaSoundIn(SoundIn):
    """See the module's head. alsa: stands in for the module `alsaaudio`."""

    def __init__(
        self,
        settings: AlsaSettings | None = None,
        clock: Clock | None = None,
        alsa: Any = None,
    ) -> None:
        super().__init__()
        self.settings = settings or AlsaSettings()
        self._clock = clock or RealClock()
        self._given = alsa
        self._alsa: Any = None
        self._pcm: library.Pcm | None = None
        self._rate_hz = float(self.settings.rate_hz)
        self._form, self._channels, self._period = "S16_LE", 1, 1
        self._times = SampleClock(self._rate_hz)
        self._read_frames = 0
        self._next_s: float | None = None  # when the next block should begin
        self._starved_s: float | None = None
        self._starved_with = 0
        self._lost_blocks = self._overruns = self._repaired = 0

    @property
    def rate_hz(self) -> float:
        return self._rate_hz

    @property
    def status(self) -> SoundStatus:
        times = self._times
        return SoundStatus(
            self.settings.device, self._rate_hz, self._channels, self._form, self._overruns,
            self._repaired, times.drift_ppm, times.jitter_s * 1e3,
        )  # fmt: skip

    def open(self) -> None:
        """Raises `DeviceAbsent` SND-ABSENT, SND-BUSY; `DeviceError` SND-RIGHTS, SND-FORMAT,
        SND-MODULE.
        """
        self.close()
        self._alsa = self._given or library.load()
        self._state = DeviceState.OPENING
        try:
            self._pcm = self._connect()
        except DeviceError:
            self._state = DeviceState.ABSENT
            raise
        self._begin()
        self._state = DeviceState.READY

    def close(self) -> None:
        self._drop()
        self._state = DeviceState.ABSENT

    def read(self, timeout_s: float) -> SoundBlock | None:
        if self._state is DeviceState.ABSENT:
            raise DeviceError("SND-CLOSED", "the microphone is not open", "Open it first.")
        deadline = self._clock.now() + timeout_s
        while True:
            block = self._take()
            if block is not None or isinstance(self._clock, VirtualClock):
                return block
            remaining = deadline - self._clock.now()
            if remaining <= 0:
                return None
            self._wait(remaining)

    def _connect(self) -> library.Pcm:
        """A stream in the first format that the card has and that can be read."""
        wanted = FORMATS if self.settings.format == "any" else (self.settings.format,)
        offered = ""
        for form in wanted:
            pcm = self._stream(form)
            info = pcm.info()
            offered = str(info["format_name"])
            if offered in wanted and int(info["rate"]) > 0:
                self._accept(info)
                return pcm
            pcm.close()
        raise DeviceError(
            "SND-FORMAT",
            f"the microphone '{self.settings.device}' gives {offered}, which cannot be read",
            "Put 'plug:' before its name, so that ALSA converts it.",
        )

    def _stream(self, form: str) -> library.Pcm:
        alsa, settings = self._alsa, self.settings
        period = max(16, round(settings.rate_hz * settings.period_ms * 1e-3))
        try:
            pcm: library.Pcm = alsa.PCM(
                alsa.PCM_CAPTURE, alsa.PCM_NONBLOCK, device=settings.device, rate=settings.rate_hz,
                channels=settings.channels, format=getattr(alsa, f"PCM_FORMAT_{form}"),
                periodsize=period, periods=settings.periods,
            )  # fmt: skip
        except alsa.ALSAAudioError as error:
            raise _refusal(settings.device, error) from None
        return pcm

    def _accept(self, info: dict[str, Any]) -> None:
        self._rate_hz, self._channels = float(info["rate"]), int(info["channels"])
        self._form, self._period = str(info["format_name"]), max(int(info["period_size"]), 1)

    def _begin(self) -> None:
        assert self._pcm is not None
        for name, value in (
            ("set_tstamp_mode", "PCM_TSTAMP_ENABLE"),
            ("set_tstamp_type", "PCM_TSTAMP_TYPE_MONOTONIC"),
        ):
            self._set(name, value)
        self._times = SampleClock(self._rate_hz)
        self._read_frames = 0
        self._next_s = self._starved_s = None
        self._lost_blocks = self._overruns = self._repaired = 0
        raw = self._pull()  # the first read starts the stream
        self._read_frames += len(raw) // (sample_bytes(self._form) * self._channels)

    def _set(self, name: str, value: str) -> None:
        """Plugins may refuse; then readings of the clock do."""
        try:
            getattr(self._pcm, name)(getattr(self._alsa, value))
        except (AttributeError, RuntimeError, self._alsa.ALSAAudioError):
            return

    def _take(self) -> SoundBlock | None:
        """A whole period, if one is there."""
        if self._state is DeviceState.LOST or self._pcm is None:
            raise self._lost("vanished")
        available, time_s = self._reading()
        if available == -errno.EPIPE:
            self._overran()
            return None
        if available < 0:
            raise self._lost("vanished")
        if available < self._period:
            self._watch(available)
            return None
        missing_s = self._times.update(self._read_frames + available, time_s)
        raw = self._pull()
        return self._block(raw, missing_s) if raw else None

    def _reading(self) -> tuple[int, float]:
        """Frames that wait in the card's buffer (or minus an errno), and when they were counted."""
        assert self._pcm is not None
        available = library.waiting(self._pcm, self._alsa)  # the card stamps its answer
        now_s = self._clock.now()
        if available <= 0:
            return available, now_s
        try:
            seconds, nanoseconds, counted = self._pcm.htimestamp()
        except (AttributeError, self._alsa.ALSAAudioError):
            return available, now_s
        stamp_s = seconds + nanoseconds * 1e-9
        plausible = now_s - 0.5 < stamp_s <= self._clock.now() + 1e-4
        if not plausible or not available <= counted <= available + self._period:
            return available, now_s
        return int(counted), stamp_s

    def _pull(self) -> bytes:
        """What one read gives. Raises `DeviceLost`."""
        assert self._pcm is not None
        try:
            count, raw = self._pcm.read()
        except self._alsa.ALSAAudioError as error:
            if library.number_of(error) == errno.ESTRPIPE:  # the machine slept
                raise self._lost("slept") from None
            raise self._lost("vanished") from None
        if count == -errno.EPIPE:
            self._overran(prepared=True)
            return b""
        if count < 0:
            raise self._lost("vanished")
        return raw

    def _block(self, raw: bytes, missing_s: float) -> SoundBlock:
        samples, broken = mono(raw, self._form, self._channels, self.settings.channel)
        self._starved_s = None
        self._repaired += broken
        time_s = self._times.time_of(self._read_frames) - self.settings.latency_ms * 1e-3
        self._count_lost(time_s, missing_s)
        self._read_frames += len(samples)
        self._next_s = time_s + len(samples) / self._rate_hz
        return SoundBlock(samples, self._rate_hz, time_s, self._lost_blocks, broken)

    def _count_lost(self, time_s: float, missing_s: float) -> None:
        """After an overrun, or where sound is missing without one: how many blocks went."""
        if missing_s:
            self._overruns += 1
        if self._next_s is not None and (missing_s or self._read_frames == 0):
            block_s = self._period / self._rate_hz
            self._lost_blocks += max(round((time_s - self._next_s) / block_s), int(missing_s > 0))

    def _overran(self, prepared: bool = False) -> None:
        """Nobody read for longer than the buffer lasts. The stream stopped; it begins anew."""
        self._overruns += 1
        self._starved_s = None
        self._read_frames = 0
        self._times.restart()
        for _ in range(1 if prepared else 2):  # the first read clears the overrun
            try:
                assert self._pcm is not None
                self._pcm.read()
            except self._alsa.ALSAAudioError:
                raise self._lost("vanished") from None

    def _watch(self, available: int) -> None:
        """A card that is there and gives nothing is of no more use than one that vanished."""
        now_s = self._clock.now()
        if self._starved_s is None or available != self._starved_with:
            self._starved_s, self._starved_with = now_s, available
            return
        patience_s = self.settings.silent_after_s
        if self._next_s is None:
            patience_s = max(patience_s, _FIRST_SOUND_S)
        if now_s - self._starved_s > patience_s:
            raise self._lost("gives no sound any more")

    def _wait(self, seconds: float) -> None:
        """Until the card has something, `seconds` at most."""
        assert self._pcm is not None
        poll = select.poll()
        try:
            descriptors = self._pcm.polldescriptors()
        except self._alsa.ALSAAudioError:
            raise self._lost("vanished") from None
        for descriptor, events in descriptors:
            poll.register(descriptor, events)
        # A card that fell silent wakes nobody, and its silence must be seen.
        fired = poll.poll(min(seconds, 0.1) * 1e3)
        if not fired:
            return
        if hasattr(self._pcm, "polldescriptors_revents"):
            try:
                self._pcm.polldescriptors_revents([*fired])  # plugins clear their timers by it
            except self._alsa.ALSAAudioError:
                return
        if library.waiting(self._pcm, self._alsa) in range(self._period):
            # Woken for less than a period: it is not worth spinning for the rest.
            self._clock.sleep_until(self._clock.now() + min(seconds, 0.0005))

    def _lost(self, how: str) -> DeviceLost:
        self._drop()
        self._state = DeviceState.LOST
        return DeviceLost(
            "SND-LOST",
            f"the microphone '{self.settings.device}' {how}",
            "Check the cable; it is retried every second.",
        )

    def _drop(self) -> None:
        pcm, self._pcm = self._pcm, None
        if pcm is not None:
            try:
                pcm.close()
            except Exception:  # it is gone anyway
                return


def _refusal(device: str, error: Exception) -> DeviceError:
    """Why the card could not be opened."""
    number, reason = library.number_of(error), library.reason_of(error)
    if number == errno.EBUSY:
        return DeviceAbsent(
            "SND-BUSY",
            f"the microphone '{device}' is used by another program",
            "Share it by the shipped ALSA configuration (hypermask_mic), or end that program.",
        )
    if number in (errno.EACCES, errno.EPERM):
        return DeviceError(
            "SND-RIGHTS",
            f"the microphone '{device}' may not be used by this user",
            "Put the user into the group audio.",
        )
    if number == errno.EINVAL:
        return DeviceError(
            "SND-FORMAT",
            f"the microphone '{device}' refuses every format, or its configuration is wrong",
            "Put 'plug:' before its name; look at 'arecord -L' and the ALSA configuration.",
        )
    return DeviceAbsent(
        "SND-ABSENT",
        f"there is no microphone '{device}' ({reason})",
        "Check the cable and the name ('arecord -L'); it is retried every second.",
    )
