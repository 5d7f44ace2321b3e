"""The EDID of a projector that tells none, for the kernel to load as firmware.

Put the bytes into /lib/firmware/edid/hypermask.bin (and the initial RAM disk) and boot with
``drm.edid_firmware=HDMI-A-1:edid/hypermask.bin video=HDMI-A-1:e``: the kernel then offers that one
mode on that connector, display or not. Source: VESA E-EDID standard, structure 1.3.
"""

from __future__ import annotations

from hypermask_drivers.errors import ConfigError
from hypermask_drivers.projector import drm_abi as abi
from hypermask_drivers.projector.drm_modes import rate_hz

_HEADER = b"\x00\xff\xff\xff\xff\xff\xff\x00"
_MAKER = (ord("H") - 64) << 10 | (ord("Y") - 64) << 5 | (ord("M") - 64)
_SRGB = bytes.fromhex("ee91a3544c99260f5054")


def edid(mode: abi.ModeInfo, name: str = "HYPERMASK") -> bytes:
    """128 bytes that describe a digital display with this one mode.

    name: at most 13 ASCII characters. Raises `ConfigError` PRJ-EDID for a mode that does not fit
    into an EDID (4095 pixels, 655 MHz).
    """
    body = bytearray(_HEADER + _MAKER.to_bytes(2, "big") + bytes(6))
    body += bytes([0, 36, 1, 3])  # week, year - 1990, version 1.3
    body += bytes([0x80, 0, 0, 120, 0x0A])  # digital, no size, gamma 2.2, RGB, preferred timing
    body += _SRGB + bytes(3) + b"\x01\x01" * 8  # no established or standard timings
    body += _timing(mode) + _text(0xFC, name) + _range(mode) + _text(0x10, "")
    body.append(0)  # no extension blocks
    body.append(-sum(body) % 256)
    return bytes(body)


def _timing(mode: abi.ModeInfo) -> bytes:
    """The detailed timing descriptor, 18 bytes."""
    clock = round(mode.clock / 10)
    blank_h, blank_v = mode.htotal - mode.hdisplay, mode.vtotal - mode.vdisplay
    front_h, front_v = mode.hsync_start - mode.hdisplay, mode.vsync_start - mode.vdisplay
    sync_h, sync_v = mode.hsync_end - mode.hsync_start, mode.vsync_end - mode.vsync_start
    limits = [(clock, 16), (mode.hdisplay, 12), (mode.vdisplay, 12), (blank_h, 12), (blank_v, 12)]
    limits += [(front_h, 10), (sync_h, 10), (front_v, 6), (sync_v, 6)]
    if any(not 0 <= value < 1 << bits for value, bits in limits):
        raise ConfigError(
            "PRJ-EDID", "the mode does not fit into an EDID", "Choose a smaller mode."
        )
    positive_v = 4 if mode.flags & abi.FLAG_PVSYNC else 0
    positive_h = 2 if mode.flags & abi.FLAG_PHSYNC else 0
    return bytes(clock.to_bytes(2, "little")) + bytes([
        mode.hdisplay & 255, blank_h & 255, mode.hdisplay >> 8 << 4 | blank_h >> 8,
        mode.vdisplay & 255, blank_v & 255, mode.vdisplay >> 8 << 4 | blank_v >> 8,
        front_h & 255, sync_h & 255, (front_v & 15) << 4 | sync_v & 15,
        front_h >> 8 << 6 | sync_h >> 8 << 4 | front_v >> 4 << 2 | sync_v >> 4,
        0, 0, 0, 0, 0, 0x18 | positive_v | positive_h,
    ])  # fmt: skip


def _text(tag: int, text: str) -> bytes:
    line = text.encode("ascii", "replace")[:13]
    line = line if len(line) == 13 else line + b"\n"
    return bytes([0, 0, 0, tag, 0]) + line.ljust(13)


def _range(mode: abi.ModeInfo) -> bytes:
    """Limits just around the mode: vertical Hz, horizontal kHz, clock in 10 MHz."""
    vertical, horizontal = rate_hz(mode), mode.clock / mode.htotal
    limits = [vertical - 1, vertical + 1, horizontal - 1, horizontal + 1, mode.clock / 10000 + 1]
    numbers = bytes(min(255, max(1, round(limit))) for limit in limits)
    return b"\x00\x00\x00\xfd\x00" + numbers + b"\x00\n".ljust(8)
