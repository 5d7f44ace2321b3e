"""A projector without a display: flips on a grid, and GLES contexts that live side by side."""

import numpy as np
import pytest

from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.errors import DeviceAbsent, DeviceError
from hypermask_drivers.projector import ProjectorMode, gles
from hypermask_drivers.projector.offscreen import OffscreenProjector

MODE = ProjectorMode(64, 32, 50.0, 0.02)


@pytest.fixture
def clock():
    return VirtualClock()


@pytest.fixture
def projector(clock):
    with OffscreenProjector(MODE, clock, phase_s=0.005) as projector:
        yield projector


def test_it_speaks_gles_3_and_reads_back_the_right_way_up(projector):
    assert projector.context.version_code >= 300
    projector.framebuffer.clear(viewport=(0, 16, 32, 16), color=(1.0, 0.5, 0.0, 1.0))
    picture = projector.read_picture()
    assert picture.shape == (32, 64, 3)
    np.testing.assert_array_equal(picture[3, 3], [255, 128, 0])  # OpenGL's upper left
    assert picture[20:].max() == 0 and picture[:, 40:].max() == 0


def test_the_next_flip_is_on_the_grid_and_after_now(projector, clock):
    assert projector.next_flip_s() == pytest.approx(0.005)
    clock.sleep_until(0.005)
    assert projector.next_flip_s() == pytest.approx(0.025)
    clock.sleep_until(0.0449)
    assert projector.next_flip_s() == pytest.approx(0.045)


def test_one_frame_a_flip(projector):
    flips = [projector.present() for _ in range(3)]
    np.testing.assert_allclose(flips, [0.005, 0.025, 0.045])
    assert projector.missed_flips == 0


def test_flips_without_a_new_picture_are_counted(projector, clock):
    projector.present()
    clock.sleep_until(0.07)
    assert projector.present() == pytest.approx(0.085)
    assert projector.missed_flips == 3


def test_a_virtual_clock_is_moved_by_its_owner_only(projector, clock):
    projector.present()
    assert clock.now() == 0


class WaitingClock:
    """Time that passes only by sleeping, as a real clock's does."""

    def __init__(self):
        self.time = 0.0

    def now(self):
        return self.time

    def sleep_until(self, time_s):
        self.time = max(self.time, time_s)


def test_on_another_clock_present_waits_for_the_flip():
    clock = WaitingClock()
    with OffscreenProjector(MODE, clock) as projector:
        assert [projector.present(), projector.present()] == pytest.approx([0.02, 0.04])
        assert clock.now() == pytest.approx(0.04)


def test_closed_it_says_so_and_may_be_opened_again(clock):
    projector = OffscreenProjector(MODE, clock)
    for use in (lambda: projector.context, lambda: projector.framebuffer, projector.present):
        with pytest.raises(DeviceError, match="PRJ-CLOSED"):
            use()
    for _ in range(2):
        projector.open()
        assert projector.state is DeviceState.READY
        projector.close()
        projector.close()
        assert projector.state is DeviceState.ABSENT


def test_contexts_live_side_by_side():
    first, second = gles.create_context(), gles.create_context()
    pictures = {}
    for context, colour in ((first, 0.2), (second, 0.6)):
        with context:
            pictures[context] = context.framebuffer([context.texture((4, 4), 4)])
            pictures[context].clear(colour, colour, colour, 1.0)
    with second:
        with first:
            inner = pictures[first].read(components=4)[0]
        outer = pictures[second].read(components=4)[0]
    assert (inner, outer) == (51, 153)
    first.release()
    with second:
        assert pictures[second].read(components=4)[0] == 153
    second.release()


def test_without_libegl_the_user_learns_what_to_install(monkeypatch):
    def no_library(name):
        raise OSError(name)

    gles._egl.cache_clear()
    monkeypatch.setattr(gles.ctypes, "CDLL", no_library)
    gles._headless_display.cache_clear()
    with pytest.raises(DeviceAbsent, match=r"GPU-EGL: .*libEGL.*Install"):
        gles.create_context()
    monkeypatch.undo()
    gles.create_context().release()
