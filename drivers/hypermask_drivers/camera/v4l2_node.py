"""A video device node: system calls with their errors told as device errors."""

from __future__ import annotations

import errno
import fcntl
import mmap
import os
import select
from ctypes import Structure, addressof, c_int32
from typing import Any, Protocol, TypeVar

from hypermask_drivers.camera import v4l2_abi as abi
from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost

Argument = TypeVar("Argument", bound=Structure | c_int32)

_RETRIED = "Check the cable; it is retried every second."
_GONE = (errno.ENODEV, errno.ENXIO, errno.ESHUTDOWN, errno.EBADF)


class VideoSystem(Protocol):
    """The system calls; a test puts a device made of Python here. All raise `OSError`."""

    def open(self, path: str) -> int: ...

    def close(self, descriptor: int) -> None: ...

    def ioctl(self, descriptor: int, request: int, argument: Any) -> None:
        """The kernel reads and writes the ctypes object `argument`."""

    def mmap(self, descriptor: int, length: int, offset: int) -> Any:
        """A readable buffer; `release` frees it."""

    def release(self, memory: Any) -> None: ...

    def wait(self, descriptor: int, timeout_s: float) -> bool:
        """Whether a read would find something (a frame or an error) within `timeout_s`."""


class LinuxVideoSystem:
    def open(self, path: str) -> int:
        # Non-blocking: a driver that hangs may not take the reader with it.
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def close(self, descriptor: int) -> None:
        os.close(descriptor)

    def ioctl(self, descriptor: int, request: int, argument: Any) -> None:
        fcntl.ioctl(descriptor, request, argument, True)

    def mmap(self, descriptor: int, length: int, offset: int) -> Any:
        return mmap.mmap(
            descriptor, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, offset=offset
        )

    def release(self, memory: Any) -> None:
        try:
            memory.close()
        except BufferError:  # somebody still looks into it; it goes with the last view
            return

    def wait(self, descriptor: int, timeout_s: float) -> bool:
        poll = select.poll()
        poll.register(descriptor, select.POLLIN | select.POLLERR)
        # Rounded up: a wait that ends early would turn into a busy loop.
        return bool(poll.poll(max(0, -int(-timeout_s * 1000 // 1))))


class VideoNode:
    """An open device node. `path` may be a link of udev (/dev/v4l/by-path/...)."""

    def __init__(self, path: str, system: VideoSystem) -> None:
        """Raises `DeviceAbsent` CAM-ABSENT, CAM-RIGHTS or CAM-BUSY."""
        self.path = path
        self._system = system
        try:
            self._descriptor = system.open(path)
        except OSError as error:
            raise _open_error(path, error) from error
        self._maps: list[Any] = []

    def close(self) -> None:
        """Never raises."""
        for memory in self._maps:
            self._system.release(memory)
        self._maps.clear()
        try:
            self._system.close(self._descriptor)
        except OSError:
            return

    def call(self, request: int, argument: Argument) -> Argument:
        """One ioctl; the argument comes back as the kernel left it.

        Raises `DeviceLost` CAM-LOST when the device is gone, `OSError` for every other refusal.
        """
        while True:
            try:
                self._system.ioctl(self._descriptor, request, argument)
            except InterruptedError:
                continue
            except OSError as error:
                if error.errno in _GONE:
                    raise lost() from error
                raise
            return argument

    def integer(self, request: int, value: int) -> int:
        argument = c_int32(value)
        self.call(request, argument)
        return argument.value

    def try_call(self, request: int, argument: Argument) -> Argument | None:
        """As `call`, None where the driver refuses. Raises `DeviceLost`."""
        try:
            return self.call(request, argument)
        except OSError:
            return None

    def wait(self, timeout_s: float) -> bool:
        """Raises `DeviceLost` CAM-LOST."""
        try:
            return self._system.wait(self._descriptor, timeout_s)
        except OSError as error:
            raise lost() from error

    def map(self, length: int, offset: int) -> Any:
        """Raises `DeviceError` CAM-MEMORY."""
        try:
            memory = self._system.mmap(self._descriptor, length, offset)
        except OSError as error:
            raise DeviceError(
                "CAM-MEMORY",
                f"the camera's buffers cannot be mapped ({error.strerror})",
                "Ask for fewer buffers or a smaller picture; free contiguous memory (cma=).",
            ) from error
        self._maps.append(memory)
        return memory

    # Controls

    def control_range(self, control: int) -> tuple[int, int, int] | None:
        """(minimum, maximum, step) of a control that can be set, None without it."""
        query = self.try_call(abi.QUERYCTRL, abi.QueryControl(id=control))
        if query is None or query.flags & (abi.CTRL_FLAG_DISABLED | abi.CTRL_FLAG_READ_ONLY):
            return None
        return query.minimum, query.maximum, max(1, query.step)

    def get(self, control: int) -> int | None:
        found = self.try_call(abi.G_CTRL, abi.Control(control, 0))
        return None if found is None else int(found.value)

    def get64(self, control: int) -> int | None:
        """A control of 64 bits, such as the pixel rate."""
        item = abi.ExtendedControl(id=control)
        controls = abi.ExtendedControls(which=0, count=1, controls=addressof(item))
        return None if self.try_call(abi.G_EXT_CTRLS, controls) is None else int(item.value64)

    def set(self, control: int, value: int) -> int | None:
        """Set within the control's range; returns what it is afterwards, None without it."""
        limits = self.control_range(control)
        if limits is None:
            return None
        low, high, step = limits
        wanted = low + round((min(max(value, low), high) - low) / step) * step
        self.try_call(abi.S_CTRL, abi.Control(control, min(wanted, high)))
        return self.get(control)


def lost(code: str = "CAM-LOST", what: str = "the camera vanished") -> DeviceLost:
    return DeviceLost(code, what, _RETRIED)


def _open_error(path: str, error: OSError) -> DeviceAbsent:
    if error.errno in (errno.EACCES, errno.EPERM):
        return DeviceAbsent(
            "CAM-RIGHTS",
            f"the camera {path} may not be opened",
            "Put the service's user into the group video.",
        )
    if error.errno == errno.EBUSY:
        return _busy(path)
    return DeviceAbsent("CAM-ABSENT", f"there is no camera at {path}", _RETRIED)


def _busy(path: str) -> DeviceAbsent:
    return DeviceAbsent(
        "CAM-BUSY",
        f"another program uses the camera {path}",
        f"Stop it; `fuser {path}` names it. It is retried every second.",
    )


def setup_error(path: str, error: OSError) -> DeviceError:
    """What a refusal while the stream is set up means."""
    if error.errno == errno.EBUSY:
        return _busy(path)
    if error.errno == errno.ENOMEM:
        return DeviceError(
            "CAM-MEMORY",
            "the kernel has no memory for the camera's buffers",
            "Ask for fewer buffers or a smaller picture; free contiguous memory (cma=).",
        )
    if error.errno == errno.ENOSPC:
        return DeviceError(
            "CAM-BUS",
            "the USB bus has no bandwidth left for the camera",
            "Plug it into a port of its own, or ask for MJPG, a lower rate or a smaller picture.",
        )
    return DeviceError(
        "CAM-SETUP",
        f"the camera {path} refuses to stream ({error.strerror})",
        "Try another size or format (`v4l2-ctl --list-formats-ext` shows them).",
    )
