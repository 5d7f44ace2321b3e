"""A camera's pixel format, frame rate and ring of buffers."""

from __future__ import annotations

import errno
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hypermask_drivers.camera import v4l2_abi as abi
from hypermask_drivers.camera.v4l2_node import VideoNode
from hypermask_drivers.errors import DeviceError


@dataclass(frozen=True)
class StreamFormat:
    """What the driver agreed to. stride: bytes a line; rate_hz: None where it does not say."""

    name: str
    width: int
    height: int
    stride: int
    rate_hz: float | None

    @property
    def size(self) -> tuple[int, int]:
        return self.width, self.height


def negotiate(
    node: VideoNode, names: Sequence[str], size: tuple[int, int], rate_hz: float
) -> StreamFormat:
    """The first of `names` that gives size and rate; else the one that comes nearest.

    Raises `DeviceError` CAM-KIND or CAM-FORMAT, `DeviceLost`, `OSError` of the driver.
    """
    _check_kind(node)
    offered = _offered(node)
    candidates = [name for name in names if name in offered]
    found: list[tuple[tuple[float, float], StreamFormat]] = []
    for name in candidates:
        form = _agree(node, name, size, rate_hz)
        if form is None:
            continue
        # A rate that the driver does not tell is judged later, from the frames.
        rate_lack = max(0.0, 1 - (form.rate_hz or rate_hz) / rate_hz - 0.03)
        size_lack = abs(form.width - size[0]) + abs(form.height - size[1])
        if not size_lack and not rate_lack:
            return form
        found.append(((size_lack, rate_lack), form))
    if not found:
        raise DeviceError(
            "CAM-FORMAT",
            f"the camera {node.path} has no picture format that is known here "
            f"(it has {', '.join(sorted(offered)) or 'none'})",
            "Use a camera with GREY, Y10, Y16, YUYV or MJPG.",
        )
    best = min(found, key=lambda pair: pair[0])[1]
    return _agree(node, best.name, size, rate_hz) or best


def _check_kind(node: VideoNode) -> None:
    capability = node.call(abi.QUERYCAP, abi.Capability())
    able = capability.capabilities
    if able & abi.CAP_DEVICE_CAPS:
        able = capability.device_caps
    if not (able & abi.CAP_VIDEO_CAPTURE and able & abi.CAP_STREAMING):
        raise DeviceError(
            "CAM-KIND",
            f"{node.path} is no camera that streams",
            "Name the capture node; `v4l2-ctl --list-devices` shows them.",
        )


def _offered(node: VideoNode) -> set[str]:
    names: set[str] = set()
    for index in range(256):
        description = abi.FormatDescription(index=index, type=abi.CAPTURE)
        if node.try_call(abi.ENUM_FMT, description) is None:
            break
        names.add(abi.fourcc_name(description.pixelformat))
    return names


def _agree(
    node: VideoNode, name: str, size: tuple[int, int], rate_hz: float
) -> StreamFormat | None:
    """Set a format and a rate; what the driver made of it, None when it gives another format."""
    wanted = abi.Format(type=abi.CAPTURE)
    pix = wanted.fmt.pix
    pix.width, pix.height = size
    pix.pixelformat, pix.field = abi.fourcc(name), abi.FIELD_NONE
    node.call(abi.S_FMT, wanted)
    if pix.pixelformat != abi.fourcc(name):
        return None
    return StreamFormat(name, pix.width, pix.height, pix.bytesperline, _set_rate(node, rate_hz))


def _set_rate(node: VideoNode, rate_hz: float) -> float | None:
    wanted = abi.StreamParameters(type=abi.CAPTURE)
    wanted.parm.capture.timeperframe = abi.Fraction(1000, round(rate_hz * 1000))
    node.try_call(abi.S_PARM, wanted)
    found = node.try_call(abi.G_PARM, abi.StreamParameters(type=abi.CAPTURE))
    if found is None or not found.parm.capture.timeperframe.numerator:
        return None
    period = found.parm.capture.timeperframe
    return float(period.denominator / period.numerator)


class FrameStream:
    """The buffers, mapped and queued, and the stream switched on."""

    def __init__(self, node: VideoNode, form: StreamFormat, count: int) -> None:
        """Raises `DeviceError` CAM-MEMORY, `DeviceLost`, `OSError` of the driver."""
        self.format = form
        self._node = node
        request = abi.RequestBuffers(count=count, type=abi.CAPTURE, memory=abi.MEMORY_MMAP)
        node.call(abi.REQBUFS, request)
        self._memories: list[Any] = []
        for index in range(request.count):
            buffer = node.call(abi.QUERYBUF, self._buffer(index))
            self._memories.append(node.map(buffer.length, buffer.m.offset))
            node.call(abi.QBUF, self._buffer(index))
        node.integer(abi.STREAMON, abi.CAPTURE)

    @staticmethod
    def _buffer(index: int = 0) -> abi.Buffer:
        return abi.Buffer(index=index, type=abi.CAPTURE, memory=abi.MEMORY_MMAP)

    def wait(self, timeout_s: float) -> bool:
        return self._node.wait(timeout_s)

    def dequeue(self) -> tuple[abi.Buffer, Any] | None:
        """The oldest full buffer and a view of its bytes; None when there is none now."""
        buffer = self._buffer()
        try:
            self._node.call(abi.DQBUF, buffer)
        except OSError as error:
            if error.errno == errno.EAGAIN:
                return None
            raise
        return buffer, memoryview(self._memories[buffer.index])[: buffer.bytesused]

    def requeue(self, buffer: abi.Buffer) -> None:
        self._node.call(abi.QBUF, self._buffer(buffer.index))

    def stop(self) -> None:
        """Never raises."""
        try:
            self._node.integer(abi.STREAMOFF, abi.CAPTURE)
            self._memories.clear()
            self._node.call(abi.REQBUFS, abi.RequestBuffers(0, abi.CAPTURE, abi.MEMORY_MMAP))
        except (OSError, DeviceError):
            return
