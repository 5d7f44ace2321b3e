"""Display modes: from a connector's list, from a modeline, or computed for a silent display.

Source: VESA CVT 1.2, reduced blanking version 1; modelines in the order of xorg.conf.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from hypermask_drivers.errors import ConfigError
from hypermask_drivers.projector import drm_abi as abi

_SIZE = re.compile(r"(\d+)x(\d+)(?:@(\d+(?:\.\d+)?))?")
_SYNC = {
    "+hsync": abi.FLAG_PHSYNC, "-hsync": abi.FLAG_NHSYNC,
    "+vsync": abi.FLAG_PVSYNC, "-vsync": abi.FLAG_NVSYNC,
}  # fmt: skip


_LARGEST, _FASTEST_HZ, _FASTEST_MHZ = 16384, 1000.0, 4000.0


class Size(NamedTuple):
    """A size in pixels, and a rate where one was asked for."""

    width: int
    height: int
    rate_hz: float | None


def parse(text: str) -> Size | abi.ModeInfo:
    """What "1280x720", "1280x720@60" or a modeline mean. Raises `ConfigError` PRJ-MODE."""
    found = _SIZE.fullmatch(text.strip())
    if found is None:
        return modeline(text)
    size = Size(int(found[1]), int(found[2]), float(found[3]) if found[3] else None)
    if not (8 <= size.width <= _LARGEST and 1 <= size.height <= _LARGEST):
        raise _wrong(text)
    if size.rate_hz is not None and not 1 <= size.rate_hz <= _FASTEST_HZ:
        raise _wrong(text)
    return size


def rate_hz(mode: abi.ModeInfo) -> float:
    """Frames a second, exact from the pixel clock."""
    if not mode.htotal or not mode.vtotal:
        return float(mode.vrefresh)
    fields = 2 if mode.flags & abi.FLAG_INTERLACE else 1
    return float(mode.clock * 1000 * fields / (mode.htotal * mode.vtotal))


def choose(modes: Sequence[abi.ModeInfo], wanted: str | None, forced: bool) -> abi.ModeInfo | None:
    """The mode to use of those that the display offers.

    wanted: as `parse` takes it, or None for the display's preferred one.
    forced: whether a mode that it does not offer is computed. None: it has none that fits.
    Raises `ConfigError` PRJ-MODE for a text that is no mode.
    """
    progressive = [mode for mode in modes if not mode.flags & abi.FLAG_INTERLACE]
    if wanted is None:
        preferred = [mode for mode in progressive if mode.type & abi.TYPE_PREFERRED]
        return next(iter([*preferred, *progressive]), None)
    asked = parse(wanted)
    if isinstance(asked, abi.ModeInfo):
        return asked
    width, height, rate = asked
    fitting = [
        mode
        for mode in progressive
        if (mode.hdisplay, mode.vdisplay) == (width, height)
        and (rate is None or abs(rate_hz(mode) - rate) < 0.6)
    ]
    if fitting:
        return min(fitting, key=lambda mode: abs(rate_hz(mode) - (rate or 60.0)))
    return reduced_blanking(width, height, rate or 60.0) if forced else None


def like(modes: Sequence[abi.ModeInfo], earlier: abi.ModeInfo, forced: bool) -> abi.ModeInfo | None:
    """The mode of an earlier one's size, and of the nearest rate. forced: as in `choose`."""
    size, rate = (earlier.hdisplay, earlier.vdisplay), rate_hz(earlier)
    same = [
        mode
        for mode in modes
        if (mode.hdisplay, mode.vdisplay) == size and not mode.flags & abi.FLAG_INTERLACE
    ]
    if same:
        return min(same, key=lambda mode: abs(rate_hz(mode) - rate))
    return reduced_blanking(*size, rate or 60.0) if forced else None


def modeline(text: str) -> abi.ModeInfo:
    """'clock_MHz h hs he ht v vs ve vt [+hsync|-hsync] [+vsync|-vsync]'. Raises PRJ-MODE."""
    words = text.split()
    flags = [word.lower() for word in words if word[0] in "+-"]
    try:
        clock, *times = (float(word) for word in words if word[0] not in "+-")
        h, hs, he, ht, v, vs, ve, vt = (int(time) for time in times)
        sync = sum(_SYNC[flag] for flag in flags)
    except (ValueError, OverflowError, KeyError, IndexError):
        raise _wrong(text) from None
    ordered = 0 < h <= hs < he <= ht < 1 << 16 and 0 < v <= vs < ve <= vt < 1 << 16
    if not (ordered and 0 < clock <= _FASTEST_MHZ):
        raise _wrong(text)
    return _mode(clock * 1000, (h, hs, he, ht), (v, vs, ve, vt), sync)


def reduced_blanking(width: int, height: int, rate: float) -> abi.ModeInfo:
    """CVT timings with reduced blanking for a display that says nothing."""
    width = width // 8 * 8
    line_us = (1e6 / rate - 460.0) / height
    sync = {(4, 3): 4, (16, 9): 5, (16, 10): 6, (5, 4): 7, (15, 9): 7}
    lines = next(
        (n for (a, b), n in sync.items() if height % b == 0 and width == height * a // b), 10
    )
    blank = max(int(460.0 / line_us) + 1, 3 + lines + 6)
    total_h, total_v = width + 160, height + blank
    clock = int(rate * total_h * total_v / 1e6 / 0.25) * 250
    horizontal = (width, width + 48, width + 80, total_h)
    vertical = (height, height + 3, height + 3 + lines, total_v)
    return _mode(clock, horizontal, vertical, abi.FLAG_PHSYNC | abi.FLAG_NVSYNC)


def _mode(
    clock_khz: float,
    horizontal: tuple[int, int, int, int],
    vertical: tuple[int, int, int, int],
    flags: int,
) -> abi.ModeInfo:
    mode = abi.ModeInfo(clock=round(clock_khz), flags=flags, type=abi.TYPE_USERDEF)
    mode.hdisplay, mode.hsync_start, mode.hsync_end, mode.htotal = horizontal
    mode.vdisplay, mode.vsync_start, mode.vsync_end, mode.vtotal = vertical
    mode.vrefresh = round(rate_hz(mode))
    mode.name = f"{horizontal[0]}x{vertical[0]}".encode()
    return mode


def _wrong(text: str) -> ConfigError:
    return ConfigError(
        "PRJ-MODE",
        f"'{text}' is no display mode",
        'Write mode = "1280x720@60" or the numbers of a modeline, e.g. '
        '"74.25 1280 1390 1430 1650 720 725 730 750 +hsync +vsync".',
    )
