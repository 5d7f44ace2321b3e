"""A camera behind the kernel's video interface (V4L2): webcams, sensors on CSI, HDMI grabbers.

Source: the kernel's user-space API documentation, part "Video for Linux API". FACTS measured: a
buffer's time stamp is the start of the exposure or the end of the frame, as its flag says, and
`sequence` shows dropped frames.
"""

from __future__ import annotations

import logging
from ctypes import c_int32
from typing import Any, Literal

from pydantic import Field

from hypermask_drivers.camera import Camera, CameraMode, Frame
from hypermask_drivers.camera import v4l2_abi as abi
from hypermask_drivers.camera.v4l2_controls import CameraControls, PhaseShifter
from hypermask_drivers.camera.v4l2_formats import FORMATS, grey
from hypermask_drivers.camera.v4l2_node import (
    LinuxVideoSystem,
    VideoNode,
    VideoSystem,
    lost,
    setup_error,
)
from hypermask_drivers.camera.v4l2_stream import FrameStream, StreamFormat, negotiate
from hypermask_drivers.camera.v4l2_time import RateMeter, mid_exposure
from hypermask_drivers.clock import Clock, RealClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.errors import DeviceAbsent, DeviceError
from hypermask_drivers.settings import Settings

_log = logging.getLogger(__name__)


class V4l2Settings(Settings):
    """What is asked of the camera.

    device: video node, best a link of udev that names the plug, /dev/v4l/by-path/...
    sensor: the sub-device with the sensor's controls (/dev/v4l-subdev0), where the video node does
    not have them. exposure_ms: None leaves the camera's own. gain: in the camera's own steps.
    readout_ms: from the end of the exposure to the end of the frame, for time stamps taken there;
    None: from the sensor's pixel rate, else 0.9 of the period. newest_only: of several waiting
    frames give the newest. hung_s: no frame for so long means that the camera hangs.
    """

    device: str = "/dev/video0"
    sensor: str | None = None
    width: int = Field(default=640, gt=0)
    height: int = Field(default=480, gt=0)
    rate_hz: float = Field(default=60.0, gt=0)
    exposure_ms: float | None = Field(default=1.0, gt=0)
    gain: int | None = None
    formats: tuple[str, ...] = FORMATS
    buffers: int = Field(default=4, ge=2, le=32)
    newest_only: bool = True
    shutter: Literal["global", "rolling"] = "global"
    readout_ms: float | None = Field(default=None, ge=0)
    hung_s: float = Field(default=2.0, gt=0)


class V4l2Camera(Camera):
    """Grey frames with the time of mid-exposure, from a bounded ring of the kernel's buffers.

    What the camera does not deliver as asked is no failure: `shortfalls` tells it, each a
    `DeviceError` with its code (CAM-SIZE, CAM-RATE, CAM-EXPOSURE, CAM-GAIN, CAM-CLOCK,
    CAM-SIGNAL), once; it is also logged as a warning.
    """

    def __init__(
        self,
        settings: V4l2Settings | None = None,
        clock: Clock | None = None,
        system: VideoSystem | None = None,
    ) -> None:
        super().__init__()
        self.settings = settings or V4l2Settings()
        self._clock = clock or RealClock()
        self._system = system or LinuxVideoSystem()
        self._node: VideoNode | None = None
        self._sensor: VideoNode | None = None
        self._forget()

    def _forget(self) -> None:
        self._stream: FrameStream | None = None
        self._controls: CameraControls | None = None
        self._shifter: PhaseShifter | None = None
        self._mode: CameraMode | None = None
        self._exposure_known = False
        self._readout_s = 0.0
        self._last_sequence: int | None = None
        self._last_frame_s = 0.0
        self._meter = RateMeter()
        self._shortfalls: dict[str, DeviceError] = {}
        self.dropped = 0  # frames that the driver exposed and could not deliver
        self.skipped = 0  # frames passed over for a newer one
        self.corrupt = 0  # frames marked as wrong by the driver, or undecodable

    # Open and close

    def open(self) -> None:
        """Raises `DeviceAbsent` CAM-ABSENT, CAM-RIGHTS, CAM-BUSY; `DeviceError` CAM-KIND,
        CAM-FORMAT, CAM-SETUP, CAM-MEMORY, CAM-BUS."""
        if self._state is DeviceState.READY:
            return
        self.close()
        self._state = DeviceState.OPENING
        try:
            self._node = VideoNode(self.settings.device, self._system)
            if self.settings.sensor is not None:
                self._sensor = VideoNode(self.settings.sensor, self._system)
            self._set_up(self._node)
        except OSError as error:
            self.close()
            raise setup_error(self.settings.device, error) from error
        except DeviceError as error:
            self.close()
            if error.code == "CAM-LOST":  # it vanished while it was opened
                raise DeviceAbsent("CAM-ABSENT", error.what, error.remedy) from error
            raise
        self._state = DeviceState.READY

    def close(self) -> None:
        if self._stream is not None:
            self._stream.stop()
        for node in (self._sensor, self._node):
            if node is not None:
                node.close()
        self._node = self._sensor = None
        self._stream = None
        self._state = DeviceState.ABSENT

    def _set_up(self, node: VideoNode) -> None:
        self._forget()
        asked = self.settings
        if not _follow_input(node):
            self._short("CAM-SIGNAL", "no picture signal arrives at the camera's input", "Plug it.")
        found = negotiate(node, asked.formats, (asked.width, asked.height), asked.rate_hz)
        nodes = [n for n in (self._sensor, node) if n is not None]
        self._controls = CameraControls(nodes, found.size)
        rate_hz = self._controls.set_rate_by_blanking(asked.rate_hz) or found.rate_hz
        exposure_s = self._apply_exposure(1 / (rate_hz or asked.rate_hz))
        self._apply_gain()
        self._check_delivery(found, rate_hz)
        rate_hz = rate_hz or asked.rate_hz
        self._mode = CameraMode(*found.size, rate_hz, exposure_s)
        self._readout_s = self._readout(rate_hz)
        self._shifter = self._controls.phase_shifter()
        self._stream = FrameStream(node, found, asked.buffers)
        self._last_frame_s = self._clock.now()

    def _readout(self, rate_hz: float) -> float:
        assert self._controls is not None
        if self.settings.readout_ms is not None:
            return self.settings.readout_ms * 1e-3
        told = self._controls.readout_s()
        return 0.9 / rate_hz if told is None else told

    def _apply_exposure(self, period_s: float) -> float:
        """Raises nothing but `DeviceLost`: a camera without the control goes on with its own."""
        assert self._controls is not None
        asked = self.settings.exposure_ms
        if asked is None:
            return self._controls.exposure_s() or 0.0
        used = self._controls.set_exposure(asked * 1e-3, period_s)
        self._exposure_known = used is not None
        if used is None:
            self._short(
                "CAM-EXPOSURE",
                "the camera's exposure time cannot be set",
                "Set exposure_ms to what it has, or give sensor = the sub-device with the control.",
            )
            return self._controls.exposure_s() or asked * 1e-3
        if abs(used - asked * 1e-3) > max(0.1 * asked * 1e-3, 1e-4):
            self._short(
                "CAM-EXPOSURE",
                f"the camera exposes for {used * 1e3:.2f} ms instead of {asked:g} ms",
                "Ask for a time within its range.",
            )
        return used

    def _apply_gain(self) -> None:
        assert self._controls is not None
        asked = self.settings.gain
        if asked is None:
            return
        self.gain = self._controls.set_gain(asked)
        if self.gain is None:
            self._short("CAM-GAIN", "the camera's gain cannot be set", "Leave out the key gain.")
        elif self.gain != asked:
            self._short(
                "CAM-GAIN",
                f"the camera's gain is {self.gain} instead of {asked}",
                "Ask for a value within its range (`v4l2-ctl --list-ctrls` shows it).",
            )

    gain: int | None = None

    def _check_delivery(self, found: StreamFormat, rate_hz: float | None) -> None:
        asked = self.settings
        if found.size != (asked.width, asked.height):
            self._short(
                "CAM-SIZE",
                f"the camera gives {found.width} x {found.height} instead of "
                f"{asked.width} x {asked.height}",
                "Ask for a size it has (`v4l2-ctl --list-formats-ext` shows them), "
                "and calibrate again.",
            )
        if rate_hz is not None:
            self._check_rate(rate_hz, "promises")

    def _check_rate(self, rate_hz: float, verb: str) -> None:
        if rate_hz < 0.97 * self.settings.rate_hz:
            self._short(
                "CAM-RATE",
                f"the camera {verb} {rate_hz:.1f} frames/s instead of {self.settings.rate_hz:g}",
                "Ask for a smaller picture or MJPG, a shorter exposure, or a faster port.",
            )

    def _short(self, code: str, what: str, remedy: str) -> None:
        if code not in self._shortfalls:
            self._shortfalls[code] = DeviceError(code, what, remedy)
            _log.warning("%s", self._shortfalls[code])

    # What it delivers

    @property
    def mode(self) -> CameraMode:
        if self._mode is None or self._state is DeviceState.ABSENT:
            raise _closed()
        return self._mode

    @property
    def pixel_format(self) -> str:
        """Four letters, e.g. 'GREY'."""
        return self._streaming().format.name

    @property
    def shortfalls(self) -> tuple[DeviceError, ...]:
        """What is not as asked, since `open`."""
        return tuple(self._shortfalls.values())

    @property
    def measured_rate_hz(self) -> float | None:
        """Frames exposed a second by their time stamps; None before enough have come."""
        return self._meter.rate_hz

    def _streaming(self) -> FrameStream:
        if self._state is DeviceState.LOST:
            raise lost()
        if self._stream is None:
            raise _closed()
        return self._stream

    def read(self, timeout_s: float) -> Frame | None:
        """The newest waiting frame (or the oldest, `newest_only = false`), None within the timeout.

        Raises `DeviceLost` CAM-LOST, or CAM-HUNG when none came for `hung_s`.
        """
        stream = self._streaming()
        try:
            frame = self._read(stream, timeout_s)
            if frame is None and self._clock.now() - self._last_frame_s > self.settings.hung_s:
                raise lost("CAM-HUNG", f"the camera gave no frame for {self.settings.hung_s:g} s")
            if frame is not None and self._shifter is not None:
                self._shifter.frame(frame.sequence)
        except DeviceError:
            self._state = DeviceState.LOST
            raise
        except OSError as error:
            self._state = DeviceState.LOST
            raise lost(what=f"the camera's driver failed ({error.strerror})") from error
        return frame

    def _read(self, stream: FrameStream, timeout_s: float) -> Frame | None:
        deadline = self._clock.now() + timeout_s
        while True:
            frame = self._take(stream)
            remaining = deadline - self._clock.now()
            if frame is not None or remaining <= 0:
                return frame
            stream.wait(remaining)

    def _take(self, stream: FrameStream) -> Frame | None:
        """The frame to give of those waiting."""
        newest: Frame | None = None
        # Bounded: a camera that is faster than this loop may not hold it.
        for _ in range(self.settings.buffers if self.settings.newest_only else 1):
            raw = stream.dequeue()
            if raw is None:
                break
            buffer, data = raw
            try:
                frame = self._frame(stream.format, buffer, data)
            finally:
                stream.requeue(buffer)
            if frame is not None:
                self.skipped += newest is not None
                newest = frame
        return newest

    def _frame(self, form: StreamFormat, buffer: abi.Buffer, data: Any) -> Frame | None:
        now = self._clock.now()
        self._last_frame_s = now
        sequence = self._count(buffer.sequence)
        if buffer.flags & abi.BUF_FLAG_ERROR:
            self.corrupt += 1
            return None
        image = grey(data, form.name, form.width, form.height, form.stride)
        if image is None:
            self.corrupt += 1
            return None
        image.flags.writeable = False
        time_s = self._time(buffer, now)
        if self._meter.add(time_s, sequence) and self._meter.rate_hz is not None:
            self._check_rate(self._meter.rate_hz, "delivers")
        return Frame(image, time_s, sequence)

    def _count(self, number: int) -> int:
        """The driver's 32-bit frame number without its wrap; counts what is missing."""
        last = self._last_sequence
        step = 1 if last is None else (number - last) % 2**32
        if step >= 2**31:  # the driver began to count anew
            step = 1
        sequence = number if last is None else last + step
        self.dropped += max(0, step - 1)
        self._last_sequence = sequence
        return sequence

    def _time(self, buffer: abi.Buffer, now_s: float) -> float:
        mode = self.mode
        stamp = mid_exposure(
            buffer, now_s, mode.exposure_s, self._readout_s, self.settings.shutter == "rolling"
        )
        if not stamp.trusted:
            self._short(
                "CAM-CLOCK",
                "the camera's time stamps are not on the system's clock",
                "The time of arrival is used: expect some milliseconds of jitter.",
            )
        return stamp.time_s

    # Set while it runs

    def set_exposure(self, exposure_s: float) -> float:
        """Where it cannot be set, what the camera has; raises `DeviceLost`."""
        self._streaming()
        assert self._controls is not None and self._mode is not None
        used = self._controls.set_exposure(exposure_s, 1 / self._mode.rate_hz)
        if used is None:
            return self._mode.exposure_s
        mode = self._mode
        self._mode = CameraMode(mode.width, mode.height, mode.rate_hz, used)
        return used

    def shift_phase(self, delay_s: float) -> float:
        """By the vertical blanking, where the sensor lets it be set; else 0."""
        self._streaming()
        return 0.0 if self._shifter is None else self._shifter.shift(delay_s)


def _follow_input(node: VideoNode) -> bool:
    """Take the timings that arrive at an HDMI input; False when none arrive."""
    index = c_int32()
    if node.try_call(abi.G_INPUT, index) is None:
        return True
    description = node.try_call(abi.ENUMINPUT, abi.Input(index=index.value))
    if description is None or not description.capabilities & abi.IN_CAP_DV_TIMINGS:
        return True
    timings = node.try_call(abi.QUERY_DV_TIMINGS, abi.VideoTimings())
    return timings is not None and node.try_call(abi.S_DV_TIMINGS, timings) is not None


def _closed() -> DeviceError:
    return DeviceError("CAM-CLOSED", "the camera is not open", "Open it first.")
