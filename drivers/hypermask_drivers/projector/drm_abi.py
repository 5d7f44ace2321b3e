"""The part of the kernel's display interface (DRM/KMS) that the projector needs.

Source: drm/drm.h and drm/drm_mode.h (kernel 6.12).
"""

from __future__ import annotations

from ctypes import Structure, c_char, c_int32, c_int64, c_uint16, c_uint32, c_uint64
from ctypes import sizeof as _sizeof

OBJECT_CRTC = 0xCCCCCCCC
OBJECT_CONNECTOR = 0xC0C0C0C0
OBJECT_PLANE = 0xEEEEEEEE

CLIENT_CAP_UNIVERSAL_PLANES = 2
CLIENT_CAP_ATOMIC = 3
CAP_TIMESTAMP_MONOTONIC = 0x6

PAGE_FLIP_EVENT = 0x0001
ATOMIC_TEST_ONLY = 0x0100
ATOMIC_NONBLOCK = 0x0200
ATOMIC_ALLOW_MODESET = 0x0400

EVENT_FLIP_COMPLETE = 0x02

FLAG_PHSYNC, FLAG_NHSYNC, FLAG_PVSYNC, FLAG_NVSYNC, FLAG_INTERLACE = 1, 2, 4, 8, 16
TYPE_PREFERRED = 8
TYPE_USERDEF = 32

FORMAT_XRGB8888 = int.from_bytes(b"XR24", "little")

CONNECTOR_NAMES = (
    "Unknown", "VGA", "DVI-I", "DVI-D", "DVI-A", "Composite", "SVIDEO", "LVDS", "Component", "DIN",
    "DP", "HDMI-A", "HDMI-B", "TV", "eDP", "Virtual", "DSI", "DPI", "Writeback", "SPI", "USB",
)  # fmt: skip
"""As in the names of /sys/class/drm/card0-HDMI-A-1."""


class ModeInfo(Structure):
    _fields_ = (
        ("clock", c_uint32), ("hdisplay", c_uint16), ("hsync_start", c_uint16),
        ("hsync_end", c_uint16), ("htotal", c_uint16), ("hskew", c_uint16), ("vdisplay", c_uint16),
        ("vsync_start", c_uint16), ("vsync_end", c_uint16), ("vtotal", c_uint16),
        ("vscan", c_uint16), ("vrefresh", c_uint32), ("flags", c_uint32), ("type", c_uint32),
        ("name", c_char * 32),
    )  # fmt: skip


class Capability(Structure):
    _fields_ = (("capability", c_uint64), ("value", c_uint64))


class CardResources(Structure):
    _fields_ = (
        ("fb_id_ptr", c_uint64), ("crtc_id_ptr", c_uint64), ("connector_id_ptr", c_uint64),
        ("encoder_id_ptr", c_uint64), ("count_fbs", c_uint32), ("count_crtcs", c_uint32),
        ("count_connectors", c_uint32), ("count_encoders", c_uint32), ("min_width", c_uint32),
        ("max_width", c_uint32), ("min_height", c_uint32), ("max_height", c_uint32),
    )  # fmt: skip


class GetConnector(Structure):
    _fields_ = (
        ("encoders_ptr", c_uint64), ("modes_ptr", c_uint64), ("props_ptr", c_uint64),
        ("prop_values_ptr", c_uint64), ("count_modes", c_uint32), ("count_props", c_uint32),
        ("count_encoders", c_uint32), ("encoder_id", c_uint32), ("connector_id", c_uint32),
        ("connector_type", c_uint32), ("connector_type_id", c_uint32), ("connection", c_uint32),
        ("mm_width", c_uint32), ("mm_height", c_uint32), ("subpixel", c_uint32), ("pad", c_uint32),
    )  # fmt: skip


class GetEncoder(Structure):
    _fields_ = (
        ("encoder_id", c_uint32), ("encoder_type", c_uint32), ("crtc_id", c_uint32),
        ("possible_crtcs", c_uint32), ("possible_clones", c_uint32),
    )  # fmt: skip


class PlaneResources(Structure):
    _fields_ = (("plane_id_ptr", c_uint64), ("count_planes", c_uint32))


class GetPlane(Structure):
    _fields_ = (
        ("plane_id", c_uint32), ("crtc_id", c_uint32), ("fb_id", c_uint32),
        ("possible_crtcs", c_uint32), ("gamma_size", c_uint32), ("count_format_types", c_uint32),
        ("format_type_ptr", c_uint64),
    )  # fmt: skip


class ObjectProperties(Structure):
    _fields_ = (
        ("props_ptr", c_uint64), ("prop_values_ptr", c_uint64), ("count_props", c_uint32),
        ("obj_id", c_uint32), ("obj_type", c_uint32),
    )  # fmt: skip


class GetProperty(Structure):
    _fields_ = (
        ("values_ptr", c_uint64), ("enum_blob_ptr", c_uint64), ("prop_id", c_uint32),
        ("flags", c_uint32), ("name", c_char * 32), ("count_values", c_uint32),
        ("count_enum_blobs", c_uint32),
    )  # fmt: skip


class Framebuffer(Structure):
    _fields_ = (
        ("fb_id", c_uint32), ("width", c_uint32), ("height", c_uint32),
        ("pixel_format", c_uint32), ("flags", c_uint32), ("handles", c_uint32 * 4),
        ("pitches", c_uint32 * 4), ("offsets", c_uint32 * 4), ("modifier", c_uint64 * 4),
    )  # fmt: skip


class Atomic(Structure):
    _fields_ = (
        ("flags", c_uint32), ("count_objs", c_uint32), ("objs_ptr", c_uint64),
        ("count_props_ptr", c_uint64), ("props_ptr", c_uint64), ("prop_values_ptr", c_uint64),
        ("reserved", c_uint64), ("user_data", c_uint64),
    )  # fmt: skip


class CreateBlob(Structure):
    _fields_ = (("data", c_uint64), ("length", c_uint32), ("blob_id", c_uint32))


class DestroyBlob(Structure):
    _fields_ = (("blob_id", c_uint32),)


class CrtcSequence(Structure):
    _fields_ = (
        ("crtc_id", c_uint32), ("active", c_uint32), ("sequence", c_uint64),
        ("sequence_ns", c_int64),
    )  # fmt: skip


class ColorLut(Structure):
    _fields_ = (
        ("red", c_uint16), ("green", c_uint16), ("blue", c_uint16), ("reserved", c_uint16),
    )  # fmt: skip


class VblankEvent(Structure):
    """drm_event_vblank: what a page flip's end puts into the card's file."""

    _fields_ = (
        ("type", c_uint32), ("length", c_uint32), ("user_data", c_uint64), ("seconds", c_uint32),
        ("microseconds", c_uint32), ("sequence", c_uint32), ("crtc_id", c_uint32),
    )  # fmt: skip


def _request(direction: int, number: int, argument: type | None = None) -> int:
    size = 0 if argument is None else _sizeof(argument)
    return direction << 30 | size << 16 | ord("d") << 8 | number


_WRITE, _BOTH = 1, 3
GET_CAP = _request(_BOTH, 0x0C, Capability)
SET_CLIENT_CAP = _request(_WRITE, 0x0D, Capability)
SET_MASTER = _request(0, 0x1E)
DROP_MASTER = _request(0, 0x1F)
CRTC_GET_SEQUENCE = _request(_BOTH, 0x3B, CrtcSequence)
GET_RESOURCES = _request(_BOTH, 0xA0, CardResources)
GET_ENCODER = _request(_BOTH, 0xA6, GetEncoder)
GET_CONNECTOR = _request(_BOTH, 0xA7, GetConnector)
GET_PROPERTY = _request(_BOTH, 0xAA, GetProperty)
REMOVE_FRAMEBUFFER = _request(_BOTH, 0xAF, c_int32)
GET_PLANE_RESOURCES = _request(_BOTH, 0xB5, PlaneResources)
GET_PLANE = _request(_BOTH, 0xB6, GetPlane)
ADD_FRAMEBUFFER2 = _request(_BOTH, 0xB8, Framebuffer)
GET_OBJECT_PROPERTIES = _request(_BOTH, 0xB9, ObjectProperties)
ATOMIC = _request(_BOTH, 0xBC, Atomic)
CREATE_BLOB = _request(_BOTH, 0xBD, CreateBlob)
DESTROY_BLOB = _request(_BOTH, 0xBE, DestroyBlob)
