"""What is not seen or heard any more leaves the stage, without a flash on the way back."""

import numpy as np
import pytest

from hypermask.stage.scene import MaskFade, live_mouth, smoothstep

FLIP = 1 / 60


def levels(seen_at, until_s, fade=None):
    """Levels at 60 flips a second; seen_at(t) = time of the latest frame with the mask."""
    fade = fade or MaskFade()
    times = np.arange(0, until_s, FLIP)
    return times, np.array([fade.update(t, seen_at(t)) for t in times])


def test_a_mask_never_seen_stays_black():
    assert levels(lambda t: None, 1.0)[1].max() == 0


def test_a_short_loss_changes_nothing():
    _, level = levels(lambda t: t if not 1 < t < 1.14 else 1.0, 2.0)
    assert level[30:].min() == 1


def test_lost_for_150_ms_it_fades_and_is_black_250_ms_later():
    times, level = levels(lambda t: min(t, 1.0), 2.0)
    assert (level[(times > 0.5) & (times <= 1.15)] == 1).all()
    fading = level[(times > 1.15) & (times < 1.3)]
    assert (np.diff(fading) < 0).all() and fading[1] > 0.5
    assert (level[times >= 1.40] == 0).all()


def test_a_slow_stage_does_not_fade_faster():
    """Only the time since the loss became sure counts, not the whole time between two frames."""
    fade = MaskFade()
    for time_s in (0.0, 1.0):
        fade.update(time_s, time_s)
    for time_s in (1.07, 1.14):
        assert fade.update(time_s, 1.0) == 1
    assert fade.update(1.16, 1.0) > 0.97
    assert fade.update(1.25, 1.0) == pytest.approx(0.5)


def at_full_light(until_s):
    fade = MaskFade()
    for time_s in (*np.arange(0, until_s, FLIP), until_s):
        fade.update(time_s, time_s - 0.01)
    return fade


@pytest.mark.parametrize("stood_s", [0.11, 0.4, 5.0])
def test_a_machine_that_stood_still_flashes_no_black_frame(stood_s):
    fade = at_full_light(1.0)
    woken = 1.0 + stood_s
    for late_s in (0.0, FLIP, 5 * FLIP):  # the tracker wakes as well, and needs some frames
        assert fade.update(woken + late_s, 0.99) == 1
    assert fade.update(woken + 6 * FLIP, woken + 5 * FLIP) == 1


def test_a_mask_that_left_while_the_machine_stood_still_fades_as_usual():
    fade = at_full_light(1.0)
    times = 1.4 + np.arange(0, 0.6, FLIP)
    level = np.array([fade.update(t, 0.99) for t in times])
    assert (level[times < 1.4 + 0.14] == 1).all()
    assert (level[times >= 1.4 + 0.4] == 0).all()


def test_a_mask_that_was_lost_before_stays_lost():
    fade = at_full_light(1.0)
    for n in range(1, 30):
        dark = fade.update(1.0 + n * FLIP, 1.0)
    assert dark == 0
    assert fade.update(3.0, 1.0) == 0


def test_a_stage_that_crawls_does_not_believe_for_ever():
    fade = at_full_light(1.0)
    assert [fade.update(1.0 + 0.12 * n, 0.99) for n in range(1, 8)][-1] == 0


def test_back_in_60_ms_without_a_flash():
    back = 2.0
    times, level = levels(lambda t: 1.0 if t < back else t, 3.0)
    returned = level[times >= back]
    assert 0 < returned[0] < 0.7
    assert (np.diff(returned[:4]) >= 0).all()
    assert (level[times >= back + 0.06] == 1).all()


def test_back_in_the_middle_of_the_fade_goes_on_from_there():
    times, level = levels(lambda t: 1.0 if 1 < t < 1.25 else t, 2.0)
    dip = level[(times > 1.15) & (times < 1.5)]
    assert 0.3 < dip.min() < 1
    assert np.abs(np.diff(dip)).max() < 0.75


def test_smoothstep_is_flat_at_both_ends():
    assert smoothstep(-1) == 0 and smoothstep(2) == 1 and smoothstep(0.5) == 0.5
    assert smoothstep(0.01) < 0.001


def test_stale_mouth_parameters_close_the_mouth():
    open_mouth = np.linspace(0.1, 0.5, 13)
    np.testing.assert_array_equal(live_mouth(open_mouth, 0.19), open_mouth)
    half = live_mouth(open_mouth, 0.25)
    np.testing.assert_allclose(half, open_mouth / 2)
    assert not live_mouth(open_mouth, 0.31).any()


def test_a_mouth_that_is_not_a_number_is_closed():
    broken = np.full(13, 0.3)
    broken[4] = np.nan
    assert not live_mouth(broken, 0.0).any()
    assert not live_mouth(np.full(13, 0.3), np.inf).any()
