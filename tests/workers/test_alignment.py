"""The camera's phase is moved until a frame is ready just before the latch, and then left alone."""

import pytest

from hypermask.workers.alignment import AlignmentSettings, PhaseAligner

FRAME, FLIP = 1 / 120, 1 / 60
SETTINGS = AlignmentSettings(settle_frames=0)


@pytest.mark.parametrize("phase_ms", [0.0, 1.0, 3.0, 5.0, 8.0])
def test_a_frame_becomes_ready_the_margin_before_the_latch(phase_ms: float) -> None:
    aligner, ready, latch = PhaseAligner(SETTINGS), phase_ms * 1e-3, 0.1
    ready += aligner.delay(ready, FRAME, latch, FLIP)
    assert (latch - ready) % FRAME == pytest.approx(SETTINGS.margin_s, abs=SETTINGS.dead_band_s)


def test_the_camera_is_never_moved_by_more_than_half_a_period() -> None:
    for step in range(100):
        assert abs(PhaseAligner(SETTINGS).delay(step * 1e-4, FRAME, 0.1, FLIP)) <= FRAME / 2


def test_an_aligned_camera_is_left_alone() -> None:
    assert PhaseAligner(SETTINGS).delay(0.1 - SETTINGS.margin_s, FRAME, 0.1, FLIP) == 0.0


def test_a_shift_is_left_to_settle() -> None:
    aligner = PhaseAligner(AlignmentSettings(settle_frames=3))
    delays = [aligner.delay(0.003, FRAME, 0.1, FLIP) for _ in range(5)]
    assert delays[0] != 0 and delays[1:4] == [0, 0, 0] and delays[4] != 0


def test_rates_that_are_no_multiples_have_no_phase_to_keep() -> None:
    assert PhaseAligner(SETTINGS).delay(0.003, 1 / 100, 0.1, FLIP) == 0.0
