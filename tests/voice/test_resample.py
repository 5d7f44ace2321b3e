"""Any sampling rate becomes 16 kHz, in blocks, without drift."""

from __future__ import annotations

import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.voice.resample import Resampler, resample

RATES = [8_000, 11_025, 22_050, 32_000, 44_100, 48_000, 96_000, 192_000, 44_099.5]


def tone(frequency_hz: float, rate_hz: float, duration_s: float) -> np.ndarray:
    return np.sin(2 * np.pi * frequency_hz * np.arange(int(duration_s * rate_hz)) / rate_hz)


@pytest.mark.parametrize("rate_hz", RATES)
def test_a_tone_keeps_its_amplitude_and_its_time(rate_hz):
    output = resample(tone(1000, rate_hz, 0.2), rate_hz)
    expected = tone(1000, 16_000, 0.2)[: len(output)]
    np.testing.assert_allclose(output[100:-100], expected[100 : len(output) - 100], atol=0.005)


@pytest.mark.parametrize("rate_hz", [44_100, 48_000, 192_000])
def test_what_16_khz_cannot_hold_is_removed_and_not_folded_down(rate_hz):
    assert np.abs(resample(tone(11_000, rate_hz, 0.1), rate_hz))[100:-100].max() < 0.01


@pytest.mark.parametrize("rate_hz", RATES)
def test_the_blocks_sizes_make_no_difference(rate_hz):
    sound = np.random.default_rng(1).standard_normal(5000)
    whole = Resampler(rate_hz).process(sound)
    stream = Resampler(rate_hz)
    cuts = np.cumsum([1, 0, 7, 480, 3, 1024])
    pieces = [stream.process(block) for block in np.split(sound, cuts)]
    np.testing.assert_allclose(np.concatenate(pieces), whole, atol=1e-12)


@pytest.mark.parametrize("rate_hz", RATES)
def test_the_delay_is_short_and_kept_for_ever(rate_hz):
    stream = Resampler(rate_hz)
    given = taken = 0
    for _ in range(3000):
        taken += 1000
        given += len(stream.process(np.zeros(1000)))
    behind_s = taken / rate_hz - given / 16_000
    assert 0 <= behind_s <= stream.delay_s + 1 / 16_000
    assert stream.delay_s < 0.002


def test_16_khz_passes_untouched():
    sound = np.random.default_rng(1).standard_normal(100)
    np.testing.assert_array_equal(Resampler(16_000).process(sound), sound)


@pytest.mark.parametrize("rate_hz", [0, -1, 100, 1e9, float("nan")])
def test_an_impossible_rate_is_refused(rate_hz):
    with pytest.raises(DataError, match="VOICE-RATE"):
        Resampler(rate_hz)
