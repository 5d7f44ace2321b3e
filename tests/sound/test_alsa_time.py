"""Times of samples: they neither jitter nor creep, whatever the card's quartz does."""

import itertools

import numpy as np
import pytest

from hypermask_drivers.sound.alsa_time import SampleClock

RATE_HZ = 48000.0


def run(clock: SampleClock, seconds: float, hz: float, jitter_s: float, step_s: float = 0.02):
    """Readings every `step_s`, each up to `jitter_s` late; yields (error, step) of their times."""
    random = np.random.default_rng(4)
    block = round(RATE_HZ * step_s)
    for index in range(1, int(seconds / step_s)):
        frame = index * block
        clock.update(frame, 100 + frame / hz + jitter_s * random.random())
        yield clock.time_of(frame) - (100 + frame / hz), clock.time_of(frame + block)


def test_an_hour_on_a_quartz_100_ppm_off_does_not_creep() -> None:
    """Unfiltered by rate it would be 360 ms late by then."""
    clock = SampleClock(RATE_HZ)
    errors = np.array([error for error, _ in run(clock, 3600, RATE_HZ * (1 + 100e-6), 0.002)])
    late = errors[len(errors) // 60 :]
    # The readings are late by 1 ms on average, which cannot be known.
    assert np.abs(late - 1e-3).max() < 0.25e-3
    assert abs(late[-1000:].mean() - late[:1000].mean()) < 0.05e-3
    assert clock.drift_ppm == pytest.approx(100, abs=5)
    assert clock.jumps == 0


def test_the_steps_from_block_to_block_are_even() -> None:
    times = [time for _, time in run(SampleClock(RATE_HZ), 60, RATE_HZ, 0.002)][500:]
    steps = np.diff(times)
    assert np.abs(steps - 0.02).max() < 50e-6


def test_perfect_readings_give_perfect_times() -> None:
    clock = SampleClock(RATE_HZ)
    assert max(abs(error) for error, _ in run(clock, 20, RATE_HZ, 0.0)) < 1e-9


def test_one_late_reading_moves_nothing() -> None:
    clock = SampleClock(RATE_HZ)
    list(run(clock, 60, RATE_HZ, 0.0005))
    before = clock.time_of(60 * RATE_HZ)
    clock.update(60 * RATE_HZ, 100 + 60 + 0.015)
    assert abs(clock.time_of(60 * RATE_HZ) - before) < 0.1e-3


def test_sound_that_went_missing_is_noticed_within_half_a_second() -> None:
    clock = SampleClock(RATE_HZ)
    list(run(clock, 10, RATE_HZ, 0.0005))
    missing = [clock.update(RATE_HZ * (10 + 0.02 * k), 110.2 + 0.02 * k) for k in range(25)]
    assert sum(missing) == pytest.approx(0.2, abs=0.002)
    assert clock.time_of(RATE_HZ * 10.5) == pytest.approx(110.7, abs=0.002)


def test_a_new_stream_keeps_what_is_known_of_the_quartz() -> None:
    clock = SampleClock(RATE_HZ)
    list(run(clock, 120, RATE_HZ * (1 - 300e-6), 0.0005))
    clock.restart()
    clock.update(0, 500.0)
    assert clock.time_of(RATE_HZ * 10) == pytest.approx(500 + 10 / (1 - 300e-6), abs=0.3e-3)


def test_times_never_go_back() -> None:
    times = [time for _, time in run(SampleClock(RATE_HZ), 30, RATE_HZ * 1.0002, 0.008, 0.004)]
    assert all(after > before for before, after in itertools.pairwise(times))
