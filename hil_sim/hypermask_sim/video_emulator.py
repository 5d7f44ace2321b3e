"""A video device made of Python: answers the camera driver's system calls as a kernel driver does.

Frames are exposed on a grid of the clock; a frame that finds no queued buffer is lost. The sensor
has exposure, gain and blanking controls, or is a webcam with exposure in steps of 100 us.
"""

from __future__ import annotations

import errno
import math
import os
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hypermask_drivers.camera import v4l2_abi as abi
from hypermask_drivers.clock import Clock

_LINE_PIXELS = 1000


@dataclass
class ControlState:
    value: int
    minimum: int
    maximum: int


@dataclass
class EmulatedCamera:
    """What the emulated hardware is and does. Times in seconds; formats: name to rates in Hz.

    stamp: "start" | "end" of frame on CLOCK_MONOTONIC, or "unknown" clock. vblank: a raw sensor
    with blanking control, else a webcam. corrupt: sequence numbers marked as wrong by the driver.
    """

    sizes: tuple[tuple[int, int], ...] = ((640, 480),)
    formats: dict[str, tuple[float, ...]] = field(default_factory=lambda: {"GREY": (60.0, 120.0)})
    stamp: str = "end"
    vblank: bool = True
    exposure: bool = True
    readout_s: float = 8e-3
    delivery_s: float = 1e-3
    padding: int = 0
    phase_s: float = 0.0
    true_rate_hz: float | None = None
    corrupt: frozenset[int] = frozenset()
    frames: Callable[[int, int, int, str], bytes] | None = None


class EmulatedVideoSystem:
    """`VideoSystem` with one camera at `path`. `unplug`, `plug` and `hang` are its faults."""

    def __init__(
        self, clock: Clock, camera: EmulatedCamera | None = None, path: str = "/dev/video0"
    ) -> None:
        self.clock = clock
        self.camera = camera or EmulatedCamera()
        self.path = path
        self.plugged = True
        self.hung = False
        self.open_error = 0
        self.calls: list[int] = []
        self._generation = 0
        self._descriptors: dict[int, int] = {}
        self._next_descriptor = 100
        self._reset()

    def _reset(self) -> None:
        camera = self.camera
        self.size = camera.sizes[0]
        self.format = next(iter(camera.formats))
        self.rate_hz = camera.formats[self.format][0]
        self.memories: list[bytearray] = []
        self._queued: deque[int] = deque()
        self._full: deque[tuple[int, int, float]] = deque()  # buffer, sequence, mid-exposure
        self._streaming = False
        self._sequence = 0
        self._middle_s = 0.0
        self.controls: dict[int, ControlState] = {}
        self._fit_controls()

    def _fit_controls(self) -> None:
        height = self.size[1]
        lines = round(self.pixel_rate / self.rate_hz / _LINE_PIXELS)
        if self.camera.vblank:
            self.controls[abi.CID_VBLANK] = ControlState(lines - height, 10, 4 * lines)
            self.controls[abi.CID_HBLANK] = ControlState(_LINE_PIXELS - self.size[0], 0, 10000)
            self.controls[abi.CID_ANALOGUE_GAIN] = ControlState(16, 16, 240)
        else:
            self.controls[abi.CID_GAIN] = ControlState(0, 0, 100)
        if self.camera.exposure:
            kind = abi.CID_EXPOSURE if self.camera.vblank else abi.CID_EXPOSURE_ABSOLUTE
            self.controls[kind] = ControlState(20, 2, 10000)

    @property
    def pixel_rate(self) -> int:
        return 72_000_000

    @property
    def period_s(self) -> float:
        if self.camera.true_rate_hz is not None:
            return 1 / self.camera.true_rate_hz
        if self.camera.vblank:
            blanking = self.controls[abi.CID_VBLANK].value
            return (self.size[1] + blanking) * _LINE_PIXELS / self.pixel_rate
        return 1 / self.rate_hz

    @property
    def exposure_s(self) -> float:
        if not self.camera.exposure:
            return 2e-3
        if self.camera.vblank:
            return self.controls[abi.CID_EXPOSURE].value * _LINE_PIXELS / self.pixel_rate
        return self.controls[abi.CID_EXPOSURE_ABSOLUTE].value * 1e-4

    # Faults

    def unplug(self) -> None:
        self.plugged = False
        self._generation += 1

    def plug(self) -> None:
        """Another instance of the device: what was opened before stays dead."""
        self._generation += 1
        self.plugged = True
        self._reset()

    # System calls

    def open(self, path: str) -> int:
        if self.open_error:
            raise OSError(self.open_error, os.strerror(self.open_error))
        if path != self.path or not self.plugged:
            raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))
        self._next_descriptor += 1
        self._descriptors[self._next_descriptor] = self._generation
        return self._next_descriptor

    def close(self, descriptor: int) -> None:
        if self._descriptors.pop(descriptor, None) == self._generation:
            self._stop()

    def mmap(self, descriptor: int, length: int, offset: int) -> Any:
        self._check(descriptor)
        return self.memories[offset // 4096]

    def release(self, memory: Any) -> None:
        """Nothing to free."""

    def wait(self, descriptor: int, timeout_s: float) -> bool:
        """On a virtual clock the time passes here."""
        if self._descriptors.get(descriptor) != self._generation:
            return True
        deadline = self.clock.now() + timeout_s
        while self.clock.now() < deadline:
            self._advance()
            if self._full:
                return True
            self.clock.sleep_until(min(deadline, self.clock.now() + 0.5e-3))
        return False

    def ioctl(self, descriptor: int, request: int, argument: Any) -> None:
        self._check(descriptor)
        self.calls.append(request)
        handler = self._HANDLERS.get(request)
        if handler is None:
            raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
        number = handler(self, argument)
        if number:
            raise OSError(number, os.strerror(number))

    def _check(self, descriptor: int) -> None:
        if self._descriptors.get(descriptor) != self._generation or not self.plugged:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    def _capability(self, argument: abi.Capability) -> int:
        argument.card = b"Emulated camera"
        argument.capabilities = abi.CAP_DEVICE_CAPS
        argument.device_caps = abi.CAP_VIDEO_CAPTURE | abi.CAP_STREAMING
        return 0

    def _enum_format(self, argument: abi.FormatDescription) -> int:
        names = list(self.camera.formats)
        if argument.index >= len(names):
            return errno.EINVAL
        argument.pixelformat = abi.fourcc(names[argument.index])
        return 0

    def _set_format(self, argument: abi.Format) -> int:
        pix = argument.fmt.pix
        name = abi.fourcc_name(pix.pixelformat)
        self.format = name if name in self.camera.formats else next(iter(self.camera.formats))
        self.size = min(
            self.camera.sizes, key=lambda s: abs(s[0] - pix.width) + abs(s[1] - pix.height)
        )
        self.rate_hz = self.camera.formats[self.format][0]
        pix.width, pix.height = self.size
        pix.pixelformat = abi.fourcc(self.format)
        pix.bytesperline = self.stride
        pix.sizeimage = self.stride * self.size[1]
        self._fit_controls()
        return 0

    @property
    def stride(self) -> int:
        wide = {"GREY": 1, "YUYV": 2, "Y10 ": 2, "Y16 ": 2, "MJPG": 2}[self.format]
        return 0 if self.format == "MJPG" else self.size[0] * wide + self.camera.padding

    def _set_parameters(self, argument: abi.StreamParameters) -> int:
        period = argument.parm.capture.timeperframe
        asked = period.denominator / period.numerator
        rates = self.camera.formats[self.format]
        self.rate_hz = min(rates, key=lambda rate: abs(rate - asked))
        self._fit_controls()
        return self._get_parameters(argument)

    def _get_parameters(self, argument: abi.StreamParameters) -> int:
        argument.parm.capture.capability = abi.CAP_TIMEPERFRAME
        argument.parm.capture.timeperframe = abi.Fraction(1000, round(1000 * self.rate_hz))
        return 0

    def _request(self, argument: abi.RequestBuffers) -> int:
        self._stop()
        length = max(self.stride, self.size[0] * 2) * self.size[1]
        self.memories = [bytearray(length) for _ in range(argument.count)]
        return 0

    def _query_buffer(self, argument: abi.Buffer) -> int:
        argument.length = len(self.memories[argument.index])
        argument.m.offset = 4096 * argument.index
        return 0

    def _queue(self, argument: abi.Buffer) -> int:
        self._advance()
        self._queued.append(argument.index)
        return 0

    def _dequeue(self, argument: abi.Buffer) -> int:
        self._advance()
        if not self._full:
            return errno.EAGAIN
        index, sequence, middle_s = self._full.popleft()
        data = self._picture(sequence)
        self.memories[index][: len(data)] = data
        argument.index, argument.sequence, argument.bytesused = index, sequence % 2**32, len(data)
        stamp_s = middle_s - self.exposure_s / 2
        argument.flags = abi.BUF_FLAG_ERROR if sequence in self.camera.corrupt else 0
        if self.camera.stamp == "start":
            argument.flags |= abi.BUF_FLAG_TIMESTAMP_MONOTONIC | abi.BUF_FLAG_TSTAMP_SRC_SOE
        else:
            stamp_s += self.exposure_s + self.camera.readout_s
            if self.camera.stamp == "end":
                argument.flags |= abi.BUF_FLAG_TIMESTAMP_MONOTONIC
        whole = math.floor(stamp_s)
        micro = round((stamp_s - whole) * 1e6)
        argument.timestamp = abi.TimeValue(whole + micro // 10**6, micro % 10**6)
        return 0

    def _picture(self, sequence: int) -> bytes:
        width, height = self.size
        if self.camera.frames is not None:
            return self.camera.frames(sequence, width, height, self.format)
        row = np.arange(self.stride or 1, dtype=np.uint8) + sequence % 256
        return np.tile(row, (height, 1)).tobytes()

    def _on(self, argument: Any) -> int:
        self._streaming = True
        self._sequence = 0
        elapsed = (self.clock.now() - self.camera.phase_s) / self.period_s
        self._middle_s = self.camera.phase_s + (math.floor(elapsed) + 1) * self.period_s
        return 0

    def _off(self, argument: Any) -> int:
        self._stop()
        return 0

    def _stop(self) -> None:
        self._streaming = False
        self._queued.clear()
        self._full.clear()

    def _advance(self) -> None:
        """Expose every frame that has been delivered by now."""
        while self._streaming and not self.hung:
            late = self.exposure_s / 2 + self.camera.readout_s + self.camera.delivery_s
            if self._middle_s + late > self.clock.now() + 1e-9:
                return
            if self._queued:
                self._full.append((self._queued.popleft(), self._sequence, self._middle_s))
            self._sequence += 1
            self._middle_s += self.period_s

    def _query_control(self, argument: abi.QueryControl) -> int:
        control = self.controls.get(argument.id)
        if control is None:
            return errno.EINVAL
        argument.minimum, argument.maximum, argument.step = control.minimum, control.maximum, 1
        if argument.id == abi.CID_HBLANK:
            argument.flags = abi.CTRL_FLAG_READ_ONLY
        return 0

    def _get_control(self, argument: abi.Control) -> int:
        control = self.controls.get(argument.id)
        if control is None:
            return errno.EINVAL
        argument.value = control.value
        return 0

    def _set_control(self, argument: abi.Control) -> int:
        control = self.controls.get(argument.id)
        if control is None:
            return errno.EINVAL
        if not control.minimum <= argument.value <= control.maximum:
            return errno.ERANGE
        self._advance()
        control.value = argument.value
        return 0

    def _get_extended(self, argument: abi.ExtendedControls) -> int:
        item = abi.ExtendedControl.from_address(argument.controls)
        if item.id != abi.CID_PIXEL_RATE or not self.camera.vblank:
            return errno.EINVAL
        item.value64 = self.pixel_rate
        return 0

    _HANDLERS: dict[int, Callable[[EmulatedVideoSystem, Any], int]] = {  # noqa: RUF012
        abi.QUERYCAP: _capability,
        abi.ENUM_FMT: _enum_format,
        abi.S_FMT: _set_format,
        abi.S_PARM: _set_parameters,
        abi.G_PARM: _get_parameters,
        abi.REQBUFS: _request,
        abi.QUERYBUF: _query_buffer,
        abi.QBUF: _queue,
        abi.DQBUF: _dequeue,
        abi.STREAMON: _on,
        abi.STREAMOFF: _off,
        abi.QUERYCTRL: _query_control,
        abi.G_CTRL: _get_control,
        abi.S_CTRL: _set_control,
        abi.G_EXT_CTRLS: _get_extended,
    }
