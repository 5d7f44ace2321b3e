"""Projector interface: a GLES context to draw in, and page flips with their times."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import moderngl

from hypermask_drivers.device import Device


@dataclass(frozen=True)
class ProjectorMode:
    """width, height in pixels; rate in Hz; light_delay_s from the page flip to the light.

    `light_delay_s` is the projector's own lag plus half a scan: the mean time at which the light
    of a frame leaves after its flip.
    """

    width: int
    height: int
    rate_hz: float
    light_delay_s: float


class Projector(Device):
    @property
    @abstractmethod
    def mode(self) -> ProjectorMode: ...

    @property
    @abstractmethod
    def context(self) -> moderngl.Context:
        """The display's OpenGL ES (3.0 or later) context. Raises `DeviceError` before `open`."""

    @property
    @abstractmethod
    def framebuffer(self) -> moderngl.Framebuffer:
        """What to draw into for the coming flip: (width, height), RGBA8 and depth.

        Row 0 of a read-back is the BOTTOM row of the picture, as OpenGL has it.
        """

    @abstractmethod
    def next_flip_s(self) -> float:
        """Clock time of the earliest flip that a `present` now would make."""

    @abstractmethod
    def present(self) -> float:
        """Show the framebuffer at the next flip; returns the clock time of that flip.

        Waits for the flip on real hardware. Raises `DeviceLost` when the display vanished.
        """
