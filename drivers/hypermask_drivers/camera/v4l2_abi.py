"""The part of the kernel's video interface that the camera needs: structures and request numbers.

Source: linux/videodev2.h and linux/v4l2-controls.h (kernel 6.12). Time stamps are given in 64-bit
fields everywhere: 32-bit kernels from 5.6 on take that layout beside the old one.
"""

from __future__ import annotations

from ctypes import (
    Structure,
    Union,
    c_char,
    c_int32,
    c_int64,
    c_ubyte,
    c_uint32,
    c_uint64,
    c_ulong,
    c_void_p,
)
from ctypes import sizeof as _sizeof

CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
OUTPUT = 2  # V4L2_BUF_TYPE_VIDEO_OUTPUT
MEMORY_MMAP = 1
FIELD_NONE = 1

CAP_VIDEO_CAPTURE = 0x00000001
CAP_STREAMING = 0x04000000
CAP_DEVICE_CAPS = 0x80000000
CAP_TIMEPERFRAME = 0x1000
IN_CAP_DV_TIMINGS = 0x00000002

BUF_FLAG_ERROR = 0x00000040
BUF_FLAG_TIMESTAMP_MASK = 0x0000E000
BUF_FLAG_TIMESTAMP_MONOTONIC = 0x00002000
BUF_FLAG_TSTAMP_SRC_MASK = 0x00070000
BUF_FLAG_TSTAMP_SRC_SOE = 0x00010000

CID_EXPOSURE = 0x00980911  # in sensor lines on raw sensors
CID_AUTOGAIN = 0x00980912
CID_GAIN = 0x00980913
CID_EXPOSURE_AUTO = 0x009A0901
CID_EXPOSURE_ABSOLUTE = 0x009A0902  # in 100 us
CID_EXPOSURE_AUTO_PRIORITY = 0x009A0903  # may the camera lower its frame rate?
CID_VBLANK = 0x009E0901
CID_HBLANK = 0x009E0902
CID_ANALOGUE_GAIN = 0x009E0903
CID_PIXEL_RATE = 0x009F0902
EXPOSURE_MANUAL = 1

CTRL_FLAG_DISABLED = 0x0001
CTRL_FLAG_READ_ONLY = 0x0004
CTRL_FLAG_INACTIVE = 0x0010


def fourcc(name: str) -> int:
    """The number of a pixel format's four letters, e.g. 'GREY' or 'Y10 '."""
    return int.from_bytes(name.ljust(4).encode("ascii"), "little")


def fourcc_name(code: int) -> str:
    return (code & 0x7FFFFFFF).to_bytes(4, "little").decode("ascii", "replace")


class Capability(Structure):
    _fields_ = (
        ("driver", c_char * 16), ("card", c_char * 32), ("bus_info", c_char * 32),
        ("version", c_uint32), ("capabilities", c_uint32), ("device_caps", c_uint32),
        ("reserved", c_uint32 * 3),
    )  # fmt: skip


class FormatDescription(Structure):
    _fields_ = (
        ("index", c_uint32), ("type", c_uint32), ("flags", c_uint32), ("description", c_char * 32),
        ("pixelformat", c_uint32), ("mbus_code", c_uint32), ("reserved", c_uint32 * 3),
    )  # fmt: skip


class PixelFormat(Structure):
    _fields_ = (
        ("width", c_uint32), ("height", c_uint32), ("pixelformat", c_uint32), ("field", c_uint32),
        ("bytesperline", c_uint32), ("sizeimage", c_uint32), ("colorspace", c_uint32),
        ("priv", c_uint32), ("flags", c_uint32), ("ycbcr_enc", c_uint32),
        ("quantization", c_uint32), ("xfer_func", c_uint32),
    )  # fmt: skip


class _FormatUnion(Union):
    # The pointer stands for those in v4l2_window: it gives the union its alignment.
    _fields_ = (("pix", PixelFormat), ("raw", c_ubyte * 200), ("align", c_void_p))


class Format(Structure):
    _fields_ = (("type", c_uint32), ("fmt", _FormatUnion))


class Fraction(Structure):
    _fields_ = (("numerator", c_uint32), ("denominator", c_uint32))


class CaptureParameters(Structure):
    _fields_ = (
        ("capability", c_uint32), ("capturemode", c_uint32), ("timeperframe", Fraction),
        ("extendedmode", c_uint32), ("readbuffers", c_uint32), ("reserved", c_uint32 * 4),
    )  # fmt: skip


class _StreamUnion(Union):
    _fields_ = (("capture", CaptureParameters), ("raw", c_ubyte * 200))


class StreamParameters(Structure):
    _fields_ = (("type", c_uint32), ("parm", _StreamUnion))


class RequestBuffers(Structure):
    _fields_ = (
        ("count", c_uint32), ("type", c_uint32), ("memory", c_uint32), ("capabilities", c_uint32),
        ("flags", c_ubyte), ("reserved", c_ubyte * 3),
    )  # fmt: skip


class TimeValue(Structure):
    _fields_ = (("seconds", c_int64), ("microseconds", c_int64))


class TimeCode(Structure):
    _fields_ = (
        ("type", c_uint32), ("flags", c_uint32), ("frames", c_ubyte), ("seconds", c_ubyte),
        ("minutes", c_ubyte), ("hours", c_ubyte), ("userbits", c_ubyte * 4),
    )  # fmt: skip


class _MemoryUnion(Union):
    _fields_ = (("offset", c_uint32), ("userptr", c_ulong), ("planes", c_void_p), ("fd", c_int32))


class Buffer(Structure):
    _fields_ = (
        ("index", c_uint32), ("type", c_uint32), ("bytesused", c_uint32), ("flags", c_uint32),
        ("field", c_uint32), ("timestamp", TimeValue), ("timecode", TimeCode),
        ("sequence", c_uint32), ("memory", c_uint32), ("m", _MemoryUnion), ("length", c_uint32),
        ("reserved2", c_uint32), ("request_fd", c_int32),
    )  # fmt: skip


class Input(Structure):
    _fields_ = (
        ("index", c_uint32), ("name", c_ubyte * 32), ("type", c_uint32), ("audioset", c_uint32),
        ("tuner", c_uint32), ("std", c_uint64), ("status", c_uint32),
        ("capabilities", c_uint32), ("reserved", c_uint32 * 3),
    )  # fmt: skip


class QueryControl(Structure):
    _fields_ = (
        ("id", c_uint32), ("type", c_uint32), ("name", c_ubyte * 32), ("minimum", c_int32),
        ("maximum", c_int32), ("step", c_int32), ("default_value", c_int32), ("flags", c_uint32),
        ("reserved", c_uint32 * 2),
    )  # fmt: skip


class Control(Structure):
    _fields_ = (("id", c_uint32), ("value", c_int32))


class ExtendedControl(Structure):
    _pack_ = 1
    _fields_ = (
        ("id", c_uint32), ("size", c_uint32), ("reserved2", c_uint32), ("value64", c_int64),
    )  # fmt: skip


class ExtendedControls(Structure):
    _fields_ = (
        ("which", c_uint32), ("count", c_uint32), ("error_idx", c_uint32), ("request_fd", c_int32),
        ("reserved", c_uint32), ("controls", c_void_p),
    )  # fmt: skip


class VideoTimings(Structure):
    """v4l2_dv_timings: handed from query to set as it is."""

    _fields_ = (("raw", c_ubyte * 132),)


_WRITE, _READ = 1, 2


def _request(direction: int, number: int, argument: type) -> int:
    """`_IOC` of asm-generic/ioctl.h for the type 'V'."""
    return direction << 30 | _sizeof(argument) << 16 | ord("V") << 8 | number


QUERYCAP = _request(_READ, 0, Capability)
ENUM_FMT = _request(_READ | _WRITE, 2, FormatDescription)
G_FMT = _request(_READ | _WRITE, 4, Format)
S_FMT = _request(_READ | _WRITE, 5, Format)
REQBUFS = _request(_READ | _WRITE, 8, RequestBuffers)
QUERYBUF = _request(_READ | _WRITE, 9, Buffer)
QBUF = _request(_READ | _WRITE, 15, Buffer)
DQBUF = _request(_READ | _WRITE, 17, Buffer)
STREAMON = _request(_WRITE, 18, c_int32)
STREAMOFF = _request(_WRITE, 19, c_int32)
G_PARM = _request(_READ | _WRITE, 21, StreamParameters)
S_PARM = _request(_READ | _WRITE, 22, StreamParameters)
ENUMINPUT = _request(_READ | _WRITE, 26, Input)
G_CTRL = _request(_READ | _WRITE, 27, Control)
S_CTRL = _request(_READ | _WRITE, 28, Control)
QUERYCTRL = _request(_READ | _WRITE, 36, QueryControl)
G_INPUT = _request(_READ, 38, c_int32)
S_INPUT = _request(_READ | _WRITE, 39, c_int32)
G_EXT_CTRLS = _request(_READ | _WRITE, 71, ExtendedControls)
S_DV_TIMINGS = _request(_READ | _WRITE, 87, VideoTimings)
QUERY_DV_TIMINGS = _request(_READ, 99, VideoTimings)
