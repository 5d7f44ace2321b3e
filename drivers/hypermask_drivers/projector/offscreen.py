"""A projector without a display: the same GLES path, flips on a regular grid of the clock."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import moderngl
import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.clock import Clock, RealClock, VirtualClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.errors import DeviceError
from hypermask_drivers.projector import Projector, ProjectorMode
from hypermask_drivers.projector.gles import create_context

if TYPE_CHECKING:
    from hypermask_drivers.projector.offscreen_settings import OffscreenSettings

Picture = NDArray[np.uint8]


class OffscreenProjector(Projector):
    """Draws off screen; flip k happens at `phase_s + k / rate`.

    `present` waits for its flip, except on a `VirtualClock`, which only its owner moves. Each
    flip shows one frame: flip times strictly rise. Subclasses take the picture in `_shown`.
    """

    def __init__(self, mode: ProjectorMode, clock: Clock, phase_s: float = 0.0) -> None:
        super().__init__()
        self._mode = mode
        self._clock = clock
        self._phase_s = phase_s
        self._last_flip: int | None = None
        self._missed = 0
        self._context: moderngl.Context | None = None
        self._framebuffer: moderngl.Framebuffer | None = None

    def open(self) -> None:
        """Raises `DeviceAbsent` GPU-* when there is no OpenGL ES 3."""
        if self._state is DeviceState.READY:
            return
        self._state = DeviceState.OPENING
        try:
            self._context = create_context()
        except DeviceError:
            self._state = DeviceState.ABSENT
            raise
        size = (self._mode.width, self._mode.height)
        with self._context:
            self._framebuffer = self._context.framebuffer(
                [self._context.texture(size, 4)], self._context.depth_renderbuffer(size)
            )
            self._framebuffer.clear()
        self._last_flip = None
        self._missed = 0
        self._state = DeviceState.READY

    def forget_flips(self) -> None:
        """The display was away: the time without it is no missed flip. The context stays."""
        self._last_flip = None

    def close(self) -> None:
        if self._context is not None:
            self._context.release()
        self._context = None
        self._framebuffer = None
        self._state = DeviceState.ABSENT

    @property
    def mode(self) -> ProjectorMode:
        return self._mode

    @property
    def context(self) -> moderngl.Context:
        if self._context is None:
            raise _closed()
        return self._context

    @property
    def framebuffer(self) -> moderngl.Framebuffer:
        if self._framebuffer is None:
            raise _closed()
        return self._framebuffer

    @property
    def missed_flips(self) -> int:
        """Flips since the first one that came without a new picture."""
        return self._missed

    def next_flip_s(self) -> float:
        return self._flip_time(self._next_flip())

    def present(self) -> float:
        with self.context:
            self.context.finish()
        flip = self._next_flip()
        if self._last_flip is not None:
            self._missed += flip - self._last_flip - 1
        self._last_flip = flip
        flip_s = self._flip_time(flip)
        if not isinstance(self._clock, VirtualClock):
            self._clock.sleep_until(flip_s)
        self._shown(flip_s)
        return flip_s

    def read_picture(self) -> Picture:
        """What is in the framebuffer: (height, width, 3) RGB, row 0 the TOP row."""
        import cv2

        with self.context:
            data = self.framebuffer.read(components=4)  # GLES promises RGBA only
        rows = np.frombuffer(data, np.uint8).reshape(self._mode.height, self._mode.width, 4)
        return np.asarray(cv2.flip(cv2.cvtColor(rows, cv2.COLOR_RGBA2RGB), 0), np.uint8)

    def _shown(self, flip_s: float) -> None:
        """Called after each flip with the time at which it happened."""

    def _next_flip(self) -> int:
        elapsed = (self._clock.now() - self._phase_s) * self._mode.rate_hz
        upcoming = math.floor(elapsed) + 1
        return upcoming if self._last_flip is None else max(upcoming, self._last_flip + 1)

    def _flip_time(self, flip: int) -> float:
        return self._phase_s + flip / self._mode.rate_hz


class Offscreen(OffscreenProjector):
    """The driver "offscreen": for a machine without a display, and for measurements."""

    def __init__(
        self, settings: OffscreenSettings | None = None, clock: Clock | None = None
    ) -> None:
        if settings is None:
            from hypermask_drivers.projector.offscreen_settings import OffscreenSettings

            settings = OffscreenSettings()
        light_s = settings.lag_ms * 1e-3 + 0.5 / settings.rate_hz
        mode = ProjectorMode(settings.width, settings.height, settings.rate_hz, light_s)
        super().__init__(mode, clock or RealClock())


def _closed() -> DeviceError:
    return DeviceError("PRJ-CLOSED", "the projector is not open", "Open it before drawing.")
