"""The simulated microphone in the mask."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.clock import Clock
from hypermask_drivers.sound import SoundBlock, SoundIn
from hypermask_sim.devices.base import SimDevice
from hypermask_sim.voice_source import resample
from hypermask_sim.world import World

_FAST_HZ = 192_000


class SimSoundIn(SimDevice, SoundIn):
    """Block k holds the samples from k * block_ms on; it can be read when its last one was heard
    and `latency.voice_ms` have passed.
    """

    kind, code, noun = "sound", "SND", "microphone"

    def __init__(self, world: World, clock: Clock) -> None:
        super().__init__(world, clock)
        settings = world.scenario.microphone
        self._settings = settings
        self._count = max(1, round(settings.rate_hz * settings.block_ms * 1e-3))
        self._block_s = self._count / settings.rate_hz
        self._delay_s = self._block_s + world.scenario.latency.voice_ms * 1e-3
        self._start = round(world.scenario.performer.voice_start_s * settings.rate_hz)
        self._noise = 10 ** (settings.noise_db / 20)
        self._voice = world.voice  # read and resampled now, not while the show runs
        # What is repeated goes on when the scenario's time is over.
        self._endless = world.scenario.performer.voice_pause_s is not None
        self._next = 0
        self._overruns = 0
        self._held: list[NDArray[np.float32]] = []  # blocks that a garbling microphone keeps back

    @property
    def rate_hz(self) -> float:
        return float(self._settings.rate_hz)

    def _opened(self, now_s: float) -> None:
        self._next = max(0, int(np.ceil(now_s / self._block_s - 1e-9)))
        self._overruns = 0
        self._held = []

    def next_block_s(self) -> float:
        """Clock time at which the next block can be read."""
        return self.world.origin_s + self._next * self._block_s + self._delay_s

    def read(self, timeout_s: float) -> SoundBlock | None:
        return self._wait_for(self._take, self.next_block_s, timeout_s)

    def _take(self, now_s: float) -> SoundBlock | None:
        arrived = int(np.floor((now_s - self._delay_s) / self._block_s + 1e-9))
        if arrived < self._next:
            return None
        # A reader that slept too long loses the oldest blocks, as ALSA's ring buffer does.
        oldest = arrived - self._settings.buffers + 1
        if oldest > self._next:
            self._overruns += oldest - self._next
            self._next = oldest
        index, self._next = self._next, self._next + 1
        time_s = self.world.origin_s + index * self._block_s
        troubles = self.world.faults.sound_troubles(index * self._block_s)
        return self._troubled(self._samples(index), index, time_s, troubles)

    def _troubled(
        self, samples: NDArray[np.float32], index: int, time_s: float, troubles: list[str]
    ) -> SoundBlock:
        """The block as a microphone in trouble sends it."""
        rate_hz = self.rate_hz
        if "sound_clipped" in troubles:
            samples = np.clip(100 * samples, -1, 1)
        if "sound_silent" in troubles:
            samples = np.zeros_like(samples)
        if "sound_stuck" in troubles:
            samples = np.ones_like(samples)
        if "sound_nan" in troubles:
            samples = np.full_like(samples, np.nan)
        if "sound_resampled" in troubles:
            samples, rate_hz = self._fast(index), float(_FAST_HZ)
        if "sound_garbled" in troubles or self._held:
            held = np.concatenate([*self._held, samples])
            time_s += (len(samples) - len(held)) / rate_hz
            samples = self._garbled(held, index, "sound_garbled" in troubles)
        return SoundBlock(samples, rate_hz, time_s, self._overruns)

    def _fast(self, index: int) -> NDArray[np.float32]:
        """The block at 192 kHz."""
        around = np.concatenate([self._samples(k) for k in (index - 1, index, index + 1)])
        return np.split(resample(around, round(self.rate_hz), _FAST_HZ), 3)[1]

    def _garbled(self, held: NDArray[np.float32], index: int, goes_on: bool) -> NDArray[np.float32]:
        """Empty blocks, single samples, and now and then all that was kept back at once."""
        size = (0, 1, len(held), 7, 0, 0, 0, len(held) - 1)[index % 8] if goes_on else len(held)
        self._held = [held[size:]] if size < len(held) else []
        return held[:size]

    def _samples(self, index: int) -> NDArray[np.float32]:
        first = index * self._count - self._start
        if self._endless and first >= 0:
            first %= max(len(self._voice.samples), 1)
        voice = self._voice.block(first, self._count)
        random = np.random.default_rng([self.world.scenario.seed, 7, max(index, 0)])
        noise = random.standard_normal(self._count, dtype=np.float32) * np.float32(self._noise)
        return np.clip(voice + noise, -1, 1)
