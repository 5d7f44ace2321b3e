"""The KMS projector over a display card made of Python."""

from typing import Any

import numpy as np
import pytest

from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.errors import DeviceAbsent, DeviceLost
from hypermask_drivers.projector.kms import KmsProjector
from hypermask_drivers.projector.kms_settings import KmsSettings
from hypermask_sim.display_emulator import EmulatedDisplay, OffscreenBuffers

HD = "74.25 1280 1390 1430 1650 720 725 730 750 +hsync +vsync"


def rig(**settings: object) -> tuple[KmsProjector, EmulatedDisplay]:
    """Settings as they may have been kept: nobody checks them here."""
    display = EmulatedDisplay(VirtualClock(100.0))
    asked: dict[str, Any] = {"card": "/dev/dri/card0", "silence_console": False, **settings}
    projector = KmsProjector(
        KmsSettings.model_construct(**asked),
        display.clock,
        display.open,  # type: ignore[arg-type]
        OffscreenBuffers,  # type: ignore[arg-type]
    )
    return projector, display


def codes(projector: KmsProjector) -> list[str]:
    return [each.code for each in projector.shortfalls]


def test_it_begins_black() -> None:
    projector, display = rig()
    projector.open()
    with projector.context:
        data = projector.framebuffer.read(components=4)
    pixels = np.frombuffer(data, np.uint8).reshape(-1, 4)[:, :3]
    assert pixels.max() == 0 and display.lit and display.switched_on == 1


def test_a_display_that_was_off_comes_back_with_what_was_loaded() -> None:
    projector, display = rig()
    projector.open()
    context = projector.context
    for _ in range(8):  # buffers that leak would run out
        projector.present()
        display.connected = False
        with pytest.raises(DeviceLost) as lost:
            projector.present()
        assert lost.value.code == "PRJ-LOST" and projector.state is DeviceState.LOST
        with pytest.raises(DeviceAbsent) as absent:
            projector.open()
        assert absent.value.code == "PRJ-ABSENT"
        display.connected = True
        projector.open()
        assert projector.context is context
    assert display.lit


def replug(projector: KmsProjector, display: EmulatedDisplay, modeline: str) -> None:
    """Away, and back as a display that offers this mode; not opened."""
    display.connected = False
    with pytest.raises(DeviceLost):
        projector.present()
    display.modeline, display.connected = modeline, True


def test_another_size_makes_another_context_once_the_earlier_one_stays_away() -> None:
    projector, display = rig()
    projector.open()
    context = projector.context
    replug(projector, display, HD)
    for _ in range(5):
        with pytest.raises(DeviceAbsent) as absent:
            projector.open()
        assert absent.value.code == "PRJ-ABSENT" and "640x480" in absent.value.what
        assert projector.context is context
        display.clock.sleep_until(display.clock.now() + 1.0)
    projector.open()
    assert projector.context is not context and projector.mode.width == 1280
    projector.present()


def test_a_display_that_tells_its_modes_late_keeps_the_size_of_the_picture() -> None:
    projector, display = rig()
    projector.open()
    context, own = projector.context, display.modeline
    replug(projector, display, HD)
    with pytest.raises(DeviceAbsent):
        projector.open()
    display.modeline = own
    projector.open()
    assert projector.context is context and projector.mode.width == 640


def lose_by_a_fault(projector: KmsProjector, display: EmulatedDisplay) -> None:
    display.hung = True
    with pytest.raises(DeviceLost):
        projector.present()
    display.hung = False


def test_a_forced_signal_keeps_its_size_while_the_display_says_nothing() -> None:
    projector, display = rig(force=True)
    projector.open()
    lose_by_a_fault(projector, display)
    display.connected = False
    projector.open()
    assert (projector.mode.width, codes(projector)) == (640, ["PRJ-SILENT"])


def test_a_forced_signal_is_none_that_another_display_does_not_take() -> None:
    projector, display = rig(force=True)
    projector.open()
    lose_by_a_fault(projector, display)
    display.modeline = HD
    with pytest.raises(DeviceAbsent):
        projector.open()
    display.clock.sleep_until(display.clock.now() + 5.0)
    projector.open()
    assert projector.mode.width == 1280


def test_a_size_that_was_asked_for_is_not_waited_for() -> None:
    projector, display = rig(mode="640x480")
    projector.open()
    replug(projector, display, HD)
    with pytest.raises(DeviceAbsent) as absent:
        projector.open()
    assert absent.value.code == "PRJ-SIZE"


def test_coming_back_leaves_nothing_behind_in_the_card() -> None:
    projector, display = rig()
    projector.open()
    for _ in range(5):
        replug(projector, display, display.modeline)
        projector.open()
    assert display.blobs == 1


def test_a_picture_that_the_card_has_no_memory_for_gives_its_buffer_back() -> None:
    projector, display = rig()
    projector.open()
    assert isinstance(projector._screen, OffscreenBuffers)
    before = len(projector._screen._free)
    display.full = True
    with pytest.raises(DeviceLost):
        projector.present()
    assert len(projector._screen._free) == before


def test_the_signal_begins_anew_when_a_display_says_it_was_plugged() -> None:
    projector, display = rig()
    projector.open()
    display.events += 1
    projector.present()
    assert display.switched_on == 2 and projector.missed_flips == 0


def test_a_silent_display_gets_its_signal_when_forced() -> None:
    projector, display = rig(force=True, mode="1280x720@60")
    display.connected = False
    projector.open()
    assert projector.mode.width == 1280 and codes(projector) == ["PRJ-SILENT"]
    projector.present()
    display.connected = True
    projector.present()
    display.connected = False
    projector.present()
    assert projector.state is DeviceState.READY


def test_no_display_and_not_forced_is_absent() -> None:
    projector, display = rig()
    display.connected = False
    with pytest.raises(DeviceAbsent) as caught:
        projector.open()
    assert caught.value.code == "PRJ-ABSENT" and projector.state is DeviceState.ABSENT


def test_another_program_takes_the_display_and_gives_it_back() -> None:
    projector, display = rig()
    projector.open()
    context = projector.context
    display.master = False
    with pytest.raises(DeviceLost) as lost:
        projector.present()
    assert lost.value.code == "PRJ-MASTER"
    with pytest.raises(DeviceAbsent) as absent:
        projector.open()
    assert absent.value.code == "PRJ-MASTER"
    display.master = True
    projector.open()
    projector.present()
    assert projector.context is context


def test_a_driver_without_flips_is_said_to_hang() -> None:
    projector, display = rig()
    projector.open()
    display.hung = True
    with pytest.raises(DeviceLost) as caught:
        projector.present()
    assert caught.value.code == "PRJ-HUNG"


def test_missed_flips_are_counted() -> None:
    projector, display = rig()
    projector.open()
    projector.present()
    display.clock.sleep_until(display.clock.now() + 3.5 * display.period_s)
    projector.present()
    projector.present()
    assert projector.missed_flips == 3


def test_a_display_without_blanking_is_paced_by_the_modes_rate() -> None:
    projector, display = rig()
    display.vblank = False
    projector.open()
    flips = [projector.present() for _ in range(20)]
    assert np.diff(flips) == pytest.approx(display.period_s)
    assert projector.missed_flips == 0


def test_a_card_without_a_brightness_table_says_so() -> None:
    projector, _ = rig(brightness=0.5)
    projector.open()
    assert codes(projector) == ["PRJ-GAMMA"]


def test_closing_ends_the_signal_and_may_be_done_twice() -> None:
    projector, display = rig()
    projector.open()
    projector.close()
    projector.close()
    assert not display.lit and projector.state is DeviceState.ABSENT
    projector.open()
    projector.present()


def test_a_mode_that_nobody_checked_is_no_end_of_the_service() -> None:
    """The stage's quick start takes settings as they were kept."""
    projector, _ = rig(mode="1280*720")
    with pytest.raises(DeviceAbsent) as caught:
        projector.open()
    assert caught.value.code == "PRJ-MODE" and projector.state is DeviceState.ABSENT
