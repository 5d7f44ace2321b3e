"""Any format and channel count becomes mono float, without NaN."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hypermask_drivers.sound.alsa_samples import FORMATS, mono, sample_bytes
from hypermask_sim.emulators.alsa import encode

WAVE = np.sin(np.linspace(0, 20, 400)) * 0.9


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("channels", [1, 2, 6])
def test_every_format_gives_the_same_sound(form: str, channels: int) -> None:
    raw = encode(np.repeat(WAVE[:, None], channels, axis=1), form)
    assert len(raw) == len(WAVE) * channels * sample_bytes(form)
    samples, broken = mono(raw, form, channels)
    assert samples.dtype == np.float32 and broken == 0
    np.testing.assert_allclose(samples, WAVE, atol=2**-15)


@pytest.mark.parametrize("form", FORMATS)
def test_one_channel_can_be_chosen(form: str) -> None:
    raw = encode(np.column_stack([WAVE, -WAVE, 0 * WAVE]), form)
    np.testing.assert_allclose(mono(raw, form, 3, 1)[0], -WAVE, atol=2**-15)
    np.testing.assert_allclose(mono(raw, form, 3, 9)[0], 0, atol=2**-15)
    np.testing.assert_allclose(mono(raw, form, 3, "mix")[0], 0, atol=2**-15)


@pytest.mark.parametrize("form", FORMATS)
def test_full_scale_is_one(form: str) -> None:
    samples, _ = mono(encode(np.array([[-1.0], [1.0]]), form), form, 1)
    np.testing.assert_allclose(samples, [-1, 1], atol=2**-15)


def test_the_upper_byte_of_24_bits_in_32_does_not_matter() -> None:
    dirty = (np.frombuffer(encode(WAVE[:, None], "S24_LE"), "<u4") | 0x5A000000).tobytes()
    np.testing.assert_allclose(mono(dirty, "S24_LE", 1)[0], WAVE, atol=1e-6)


def test_broken_float_samples_become_silence_and_are_counted() -> None:
    values = np.array([0.5, np.nan, np.inf, -np.inf, 0.25], "<f4")
    samples, broken = mono(values.tobytes(), "FLOAT_LE", 1)
    assert broken == 3
    np.testing.assert_array_equal(samples, np.float32([0.5, 0, 0, 0, 0.25]))


def test_a_broken_channel_that_nobody_listens_to_does_not_count() -> None:
    values = np.column_stack([WAVE, WAVE * np.nan]).astype("<f4").tobytes()
    assert mono(values, "FLOAT_LE", 2, 0)[1] == 0


@given(st.binary(max_size=300), st.sampled_from(FORMATS), st.integers(1, 8))
def test_no_bytes_whatever_give_a_number_that_is_none(raw: bytes, form: str, channels: int) -> None:
    samples, _ = mono(raw, form, channels)
    assert np.isfinite(samples).all()
    assert len(samples) == len(raw) // (channels * sample_bytes(form))
