"""When a display flips next, and which of its flips passed without a new picture."""

import pytest

from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.projector.kms_pacing import FlipGrid

RATE_HZ = 50.0
PERIOD_S = 0.02


def grid(vblank_s: float | None, now_s: float = 10.0) -> tuple[FlipGrid, VirtualClock]:
    clock = VirtualClock(now_s)
    return FlipGrid(clock, RATE_HZ, vblank_s), clock


def test_the_next_flip_is_the_next_blanking() -> None:
    paced, clock = grid(9.995)
    assert paced.next_s() == pytest.approx(10.015)
    clock.sleep_until(10.016)
    assert paced.next_s() == pytest.approx(10.035)


def test_a_picture_that_is_not_lit_yet_takes_its_blanking() -> None:
    """The kernel may stamp a flip with a time that is still to come."""
    paced, _ = grid(9.995)
    paced.flipped(10.015, 10.015)
    assert paced.next_s() == pytest.approx(10.035)


def test_the_grid_follows_the_display_and_not_the_mode() -> None:
    paced, clock = grid(10.0)
    for n in range(1, 51):
        due_s = paced.next_s()
        clock.sleep_until(10.0 + n * 0.0201)
        paced.flipped(clock.now(), due_s)
    assert paced.next_s() == pytest.approx(10.0 + 50 * 0.0201 + PERIOD_S)
    assert paced.missed == 0


def test_without_blanking_small_delays_do_not_shift_the_grid_and_large_ones_do() -> None:
    free, clock = grid(None)
    for delay_s, then_s in ((0.004, 10.04), (0.015, 10.075)):
        due_s = free.next_s()
        clock.sleep_until(due_s + delay_s)
        free.flipped(clock.now(), due_s)
        assert free.next_s() == pytest.approx(then_s)
    assert not free.paced and free.missed == 1


def test_flips_without_a_picture_are_missed_but_not_while_there_was_no_signal() -> None:
    paced, clock = grid(10.0)
    for time_s in (10.02, 10.04, 10.10):
        clock.sleep_until(time_s)
        paced.flipped(time_s, time_s)
    assert paced.missed == 2
    clock.sleep_until(12.0)
    paced.begin_anew()
    assert paced.next_s() == pytest.approx(12.02)
    clock.sleep_until(12.02)
    paced.flipped(12.02, 12.02)
    assert paced.missed == 2
