"""The operator's cross-hair and hint lines, read from the projector's pixels."""

from pathlib import Path

import numpy as np
import pytest

from hypermask.mask import load_mask
from hypermask.stage.overlay import Cross, Overlay
from hypermask.stage.renderer import StageRenderer
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.projector import ProjectorMode
from hypermask_drivers.projector.offscreen import OffscreenProjector

SIZE = (640, 360)
MASK = load_mask(Path(__file__).parents[2] / "configs" / "masks" / "reference")


class Screen:
    def __init__(self):
        self.projector = OffscreenProjector(ProjectorMode(*SIZE, 60.0, 0.025), VirtualClock())
        self.projector.open()
        self.renderer = StageRenderer(self.projector.context, SIZE, MASK)
        self.overlay = Overlay(self.projector.context, SIZE)

    def black(self):
        self.renderer.draw_black(self.projector.framebuffer)

    def cross(self, *cross):
        self.black()
        for one in cross:
            self.overlay.draw_cross(self.projector.framebuffer, one)
        return self.projector.read_picture().astype(float)

    def lines(self, *lines, **how):
        self.black()
        self.overlay.draw_lines(self.projector.framebuffer, lines, **how)
        return self.projector.read_picture().astype(float)


@pytest.fixture(scope="module")
def screen():
    screen = Screen()
    yield screen
    screen.projector.close()


@pytest.mark.parametrize("centre", [(200.0, 100.0), (200.3, 100.5), (411.75, 233.1)])
def test_the_cross_is_centred_to_a_small_part_of_a_pixel(screen, centre):
    light = screen.cross(Cross(centre))[..., 0]
    rows, columns = np.indices(light.shape)
    found = [(light * columns).sum() / light.sum(), (light * rows).sum() / light.sum()]
    np.testing.assert_allclose(found, centre, atol=0.02)


def test_the_cross_has_two_thin_arms(screen):
    light = screen.cross(Cross((200.0, 100.0), half_length_px=10, half_width_px=0.5))[..., 0]
    assert light[100, 200] == light[100, 191] == light[109, 200] == 255
    assert light[100, 188] == light[112, 200] == light[103, 203] == 0


def test_a_cross_at_the_edge_or_nowhere_does_no_harm(screen):
    assert screen.cross(Cross((0.0, 0.0)))[0, 0].max() == 255
    assert screen.cross(Cross((5000.0, -3000.0))).max() == 0
    assert screen.cross(Cross((float("nan"), 10.0))).max() == 0


def test_text_stands_where_it_was_put_and_reads_upright(screen):
    light = screen.lines("LLLL", top_left_px=(100, 50), height_px=20)[..., 0]
    ys, xs = np.nonzero(light > 100)
    assert 100 <= xs.min() <= 106 and 48 <= ys.min() <= 56
    assert 17 <= np.ptp(ys) <= 24
    foot, head = light[ys.max() - 3 : ys.max() + 1], light[ys.min() : ys.min() + 4]
    assert foot.sum() > 2 * head.sum()  # the foot of an L is at the bottom
    first = light[:, 100:118]
    assert first[:, :9].sum() > first[:, 9:].sum()  # and its stem is on the left


def test_lines_stand_below_each_other_and_empty_ones_leave_room(screen):
    light = screen.lines("one", "", "three", top_left_px=(10, 10), height_px=20)[..., 0]
    rows = np.nonzero(light.max(axis=1) > 100)[0]
    assert np.diff(rows).max() > 25
    assert screen.lines().max() == 0


def test_many_different_lines_do_not_pile_up(screen):
    for number in range(100):
        light = screen.lines(f"error {number} mm")
    assert light.max() == 255
