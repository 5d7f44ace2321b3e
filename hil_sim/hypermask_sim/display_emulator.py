"""A display card made of Python: answers the projector driver as the kernel's card does.

Flips end on a grid of the clock; on a virtual clock the wait for one moves the time.
"""

from __future__ import annotations

import errno
import math
import os
from dataclasses import dataclass

import moderngl

from hypermask_drivers.clock import Clock
from hypermask_drivers.errors import DeviceAbsent
from hypermask_drivers.projector import drm_abi as abi
from hypermask_drivers.projector.drm_card import Connector, Flip, Property
from hypermask_drivers.projector.drm_modes import modeline, rate_hz
from hypermask_drivers.projector.gbm import Front
from hypermask_drivers.projector.gles import create_context

_CRTC, _CONNECTOR, _PLANE, _ENCODER = 40, 50, 60, 70
_NAMES = (
    "type", "FB_ID", "CRTC_ID", "CRTC_X", "CRTC_Y", "CRTC_W", "CRTC_H", "SRC_X", "SRC_Y", "SRC_W",
    "SRC_H", "MODE_ID", "ACTIVE", "link-status",
)  # fmt: skip


@dataclass
class EmulatedDisplay:
    """The hardware: faults are made by setting its fields. generation: another card was plugged.

    events: how often the kernel told of the connector; vblank: whether the card tells of vertical
    blankings; master: whether it is free to be driven; blobs: how many the card keeps; full: it
    has no memory for more pictures.
    """

    clock: Clock
    modeline: str = "25.2 640 656 752 800 480 490 492 525 -hsync -vsync"
    plugged: bool = True
    connected: bool = True
    generation: int = 0
    events: int = 0
    master: bool = True
    vblank: bool = True
    hung: bool = False
    lit: bool = False
    shown: int = 0
    switched_on: int = 0
    blobs: int = 0
    full: bool = False

    def open(self, path: str) -> EmulatedCard:
        if not self.plugged:
            raise DeviceAbsent("PRJ-CARD", f"there is no display card {path}", "Plug it.")
        card = EmulatedCard(self)
        card.take_master()
        return card

    @property
    def period_s(self) -> float:
        return 1 / rate_hz(modeline(self.modeline))


class EmulatedCard:
    """As `drm_card.Card`."""

    path = "/dev/dri/card0"
    descriptor = -1

    def __init__(self, display: EmulatedDisplay) -> None:
        self._display = display
        self._generation = display.generation
        self._pending = False
        self._frames = 0

    def _check(self) -> None:
        display = self._display
        if not display.plugged or self._generation != display.generation:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    def close(self) -> None:
        self._display.blobs = 0
        if self._generation == self._display.generation:
            self._display.lit = False

    def take_master(self) -> None:
        if not self._display.plugged or self._generation != self._display.generation:
            raise DeviceAbsent("PRJ-CARD", f"{self.path} vanished", "Plug it.")
        if not self._display.master:
            raise DeviceAbsent("PRJ-MASTER", "another program drives the display", "Stop it.")

    def drop_master(self) -> None: ...

    def watch(self, connector: Connector) -> EmulatedWatch:
        return EmulatedWatch(self._display)

    def resources(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        self._check()
        return (_CRTC,), (_CONNECTOR,)

    def connector(self, number: int) -> Connector:
        self._check()
        modes = (modeline(self._display.modeline),) if self._display.connected else ()
        there = self._display.connected
        return Connector(number, "HDMI-A-1", there, modes, (_ENCODER,), _ENCODER)

    def encoder(self, number: int) -> abi.GetEncoder:
        return abi.GetEncoder(encoder_id=number, crtc_id=_CRTC, possible_crtcs=1)

    def planes(self) -> tuple[abi.GetPlane, ...]:
        return (abi.GetPlane(plane_id=_PLANE, crtc_id=_CRTC, possible_crtcs=1),)

    def properties(self, number: int, kind: int) -> dict[str, Property]:
        value = {"type": 1, "CRTC_ID": _CRTC}
        return {
            name: Property(100 + index, value.get(name, 0), {"Primary": 1})
            for index, name in enumerate(_NAMES)
        }

    def blob(self, data: object) -> int:
        self._display.blobs += 1
        return 900

    def drop_blob(self, number: int) -> None:
        self._display.blobs -= 1

    def add_framebuffer(self, size: tuple[int, int], handle: int, pitch: int) -> int:
        self._check()
        if self._display.full:
            raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))
        self._frames += 1
        return self._frames

    def remove_framebuffer(self, number: int) -> None: ...

    def commit(self, changes: dict[int, dict[int, int]], flags: int) -> None:
        self._check()
        if not self._display.master:
            raise OSError(errno.EACCES, os.strerror(errno.EACCES))
        active = changes.get(_CRTC, {}).get(100 + _NAMES.index("ACTIVE"))
        if active is not None:
            self._display.switched_on += active and not self._display.lit
            self._display.lit = bool(active)
        if flags & abi.PAGE_FLIP_EVENT:
            if not self._display.lit:
                raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
            self._pending = True
        self._display.shown = changes.get(_PLANE, {}).get(100 + _NAMES.index("FB_ID"), 0)

    def wait_flip(self, timeout_s: float) -> Flip | None:
        clock = self._display.clock
        if not self._pending or self._display.hung:
            clock.sleep_until(clock.now() + timeout_s)
            return None
        self._pending = False
        if not self._display.vblank:
            return Flip(clock.now(), 0)
        flip = self._vblank(1)
        clock.sleep_until(flip.time_s)
        return flip

    def latest_vblank(self, crtc: int) -> Flip | None:
        return self._vblank(0) if self._display.vblank else None

    def _vblank(self, ahead: int) -> Flip:
        count = math.floor(self._display.clock.now() / self._display.period_s + 1e-6) + ahead
        return Flip(count * self._display.period_s, count)


class EmulatedWatch:
    """As `HotplugWatch`: tells each change of `connected` or `events` once."""

    def __init__(self, display: EmulatedDisplay) -> None:
        self._display = display
        self._last = (display.connected, display.events)

    def changed(self, now_s: float) -> bool:
        last, self._last = self._last, (self._display.connected, self._display.events)
        return last != self._last

    def close(self) -> None: ...


class OffscreenBuffers:
    """As `gbm.Screen`, drawn off screen; at most `COUNT` pictures may be locked at a time."""

    COUNT = 3

    def __init__(self, descriptor: int, size: tuple[int, int]) -> None:
        self.size = size
        self.context: moderngl.Context = create_context()
        with self.context:
            self.framebuffer = self.context.framebuffer(
                [self.context.texture(size, 4)], self.context.depth_renderbuffer(size)
            )
        self._free = list(range(1, self.COUNT + 1))

    def swap(self) -> Front:
        return Front(self._free.pop(0), 1, self.size[0] * 4)

    def give_back(self, front: Front) -> None:
        assert front.buffer not in self._free
        self._free.append(front.buffer)

    def release(self) -> None:
        self.context.release()
