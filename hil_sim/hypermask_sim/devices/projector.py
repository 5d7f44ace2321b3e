"""The simulated projector: an off-screen GLES context whose pictures are read back."""

from __future__ import annotations

from collections.abc import Callable

import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.clock import Clock, VirtualClock
from hypermask_drivers.projector import Projector, ProjectorMode
from hypermask_drivers.projector.offscreen import OffscreenProjector
from hypermask_sim.devices.base import SimDevice
from hypermask_sim.world import World

Picture = NDArray[np.uint8]
OnFrame = Callable[[Picture, float, float], None]
"""on_frame(picture (height, width, 3) uint8 RGB, row 0 at the top, flip_s, light_s)."""


class SimProjector(SimDevice, Projector):
    """Flips happen at phase + k / rate. Listeners get each picture that was shown.

    On a virtual clock `present` does not move the time. In real time it waits for the flip, a late
    one takes the next, and only every `readback_every`-th picture is read back, as that takes
    milliseconds. The context lives from `open` to `close` or to the loss of the projector.
    """

    kind, code, noun = "projector", "PRJ", "projector"

    def __init__(self, world: World, clock: Clock) -> None:
        super().__init__(world, clock)
        settings = world.scenario.projector
        width, height = world.projector.size
        rate_hz = settings.rate_hz * (1 + settings.rate_error_ppm * 1e-6)
        self._mode = ProjectorMode(width, height, settings.rate_hz, world.light_delay_s)
        self._screen = OffscreenProjector(
            ProjectorMode(width, height, rate_hz, world.light_delay_s),
            clock,
            world.origin_s + settings.phase_ms * 1e-3,
        )
        self._readback_every = 1 if isinstance(clock, VirtualClock) else settings.readback_every
        self._listeners: list[OnFrame] = []
        self._presented = 0

    def _opened(self, now_s: float) -> None:
        # A display that was away comes back; what was loaded into the GPU is still there.
        self._screen.open()
        self._screen.forget_flips()

    def close(self) -> None:
        self._screen.close()
        super().close()

    @property
    def mode(self) -> ProjectorMode:
        self._check()
        return self._mode

    @property
    def context(self) -> moderngl.Context:
        self._check()
        return self._screen.context

    @property
    def framebuffer(self) -> moderngl.Framebuffer:
        self._check()
        return self._screen.framebuffer

    @property
    def missed_flips(self) -> int:
        """Flips since the first one that came without a new picture."""
        return self._screen.missed_flips

    @property
    def presented(self) -> int:
        """Pictures shown since `open`."""
        return self._presented

    def add_listener(self, on_frame: OnFrame) -> None:
        """Give `on_frame` every picture that is read back."""
        self._listeners.append(on_frame)

    def next_flip_s(self) -> float:
        self._check()
        return self._screen.next_flip_s()

    def present(self) -> float:
        self._check()
        flip_s = self._screen.present()
        if self._listeners and self._presented % self._readback_every == 0:
            picture = self._screen.read_picture()
            for on_frame in self._listeners:
                on_frame(picture, flip_s, self.world.light_time(flip_s))
        self._presented += 1
        return flip_s
