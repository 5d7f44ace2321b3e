"""Display modes: read, chosen, computed for a silent display, told by an EDID."""

import pytest

from hypermask_drivers.errors import ConfigError
from hypermask_drivers.projector import drm_abi as abi
from hypermask_drivers.projector.drm_edid import edid
from hypermask_drivers.projector.drm_modes import choose, modeline, rate_hz, reduced_blanking
from hypermask_drivers.projector.kms_settings import KmsSettings
from hypermask_drivers.settings import parse

HD = "74.25 1280 1390 1430 1650 720 725 730 750 +hsync +vsync"


def offered(*texts: str) -> list[abi.ModeInfo]:
    return [modeline(text) for text in texts]


def test_a_modeline_is_read_as_xorg_has_it() -> None:
    mode = modeline(HD)
    assert (mode.clock, mode.hdisplay, mode.htotal, mode.vdisplay) == (74250, 1280, 1650, 720)
    assert (mode.vsync_start, mode.vsync_end, mode.vtotal) == (725, 730, 750)
    assert mode.flags == abi.FLAG_PHSYNC | abi.FLAG_PVSYNC
    assert rate_hz(mode) == pytest.approx(60.0) and mode.vrefresh == 60
    assert mode.name == b"1280x720"


@pytest.mark.parametrize(
    "text",
    [
        "", "big", "1280", "74 1280 1390", HD + " +dsync", HD.replace("1390", "1200"), "1 2 x",
        "1280*720", "0x0", "1280x720@0", "99999x720", "1280x720@5000", HD.replace("74.25", "inf"),
        HD.replace("1650", "1e99"), HD.replace("1650", "70000"),
    ],
)  # fmt: skip
def test_what_is_no_mode_is_said(text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        choose([], text, True)
    assert caught.value.code == "PRJ-MODE"
    with pytest.raises(ConfigError, match="is no display mode"):
        parse(KmsSettings, {"mode": text}, "cart.toml")


@pytest.mark.parametrize("text", [None, "1280x720", "1280x720@59.94", HD])
def test_a_mode_may_be_written_in_three_ways(text: str | None) -> None:
    assert KmsSettings(mode=text).mode == text


@pytest.mark.parametrize(
    ("size", "rate", "clock", "total"),
    [
        # As `cvt -r` prints them.
        ((1920, 1080), 60.0, 138.50, (2080, 1111)),
        ((1280, 720), 60.0, 64.00, (1440, 741)),
        ((1280, 800), 60.0, 71.00, (1440, 823)),
        ((1024, 768), 60.0, 56.00, (1184, 790)),
    ],
)
def test_timings_for_a_silent_display(
    size: tuple[int, int], rate: float, clock: float, total: tuple[int, int]
) -> None:
    mode = reduced_blanking(*size, rate)
    assert mode.clock / 1000 == pytest.approx(clock)
    assert (mode.htotal, mode.vtotal) == total
    assert rate_hz(mode) == pytest.approx(rate, rel=0.005)


def test_the_preferred_mode_unless_told() -> None:
    modes = offered("25 640 656 752 800 480 490 492 525", HD)
    assert choose(modes, None, False) is modes[0]
    modes[1].type |= abi.TYPE_PREFERRED
    assert choose(modes, None, False) is modes[1]


def test_size_and_rate_choose_among_those_offered() -> None:
    fifty = HD.replace("1390 1430 1650", "1720 1760 1980")
    modes = offered(fifty, HD)
    assert choose(modes, "1280x720", False) is modes[1]
    assert choose(modes, "1280x720@50", False) is modes[0]
    assert choose(modes, "1280x720@120", False) is None
    assert choose(modes, "800x600", False) is None


def test_interlaced_modes_are_left_out() -> None:
    mode = modeline(HD)
    mode.flags |= abi.FLAG_INTERLACE
    assert choose([mode], "1280x720", False) is None


def test_a_forced_mode_is_computed_where_none_is_offered() -> None:
    mode = choose([], "1280x720@60", True)
    assert mode is not None and (mode.hdisplay, mode.vdisplay) == (1280, 720)


# EDID for a projector that tells none


def test_an_edid_tells_the_mode() -> None:
    data = edid(modeline(HD), "Cart")
    assert len(data) == 128 and sum(data) % 256 == 0
    assert data[:8] == b"\x00\xff\xff\xff\xff\xff\xff\x00"
    # The detailed timing of 1280x720 at 60 Hz as in CTA-861, without the picture's size.
    assert data[54:72].hex() == "011d007251d01e206e285500" + "000000" + "00001e"
    assert data[77:82] == b"Cart\n"


def test_a_mode_too_large_for_an_edid_is_said() -> None:
    with pytest.raises(ConfigError) as caught:
        edid(modeline("1000 5000 5010 5020 5100 2000 2003 2008 2050"))
    assert caught.value.code == "PRJ-EDID"
