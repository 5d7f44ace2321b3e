"""What the network hears does not depend on the gain, and does not drift."""

from __future__ import annotations

import numpy as np
import pytest
from voice_sounds import noise, spoken

from hypermask.voice.features import FEATURES, LogMel, Normaliser, Spectrum, framed, warped


def heard(sound, normaliser=None):
    spectrum = LogMel()(framed(np.asarray(sound, np.float32)))
    normaliser = normaliser or Normaliser()
    return np.array(
        [
            normaliser(Spectrum(*(part[None, k] for part in vars(spectrum).values())))[0][0]
            for k in range(len(spectrum.voicing))
        ]
    )


def test_a_tone_is_in_its_band():
    tone = np.sin(2 * np.pi * 1000 * np.arange(400) / 16_000)
    bands = LogMel()(tone[None]).bands_db[0]
    assert 9 <= np.argmax(bands) <= 13
    assert bands.max() - np.median(bands) > 40


def test_pitch_and_voicing_of_a_voice_and_of_noise():
    voice = LogMel()(framed(spoken("a", 0.3)))
    assert np.median(voice.pitch_hz) == pytest.approx(120, abs=4)
    assert np.median(voice.voicing) > 0.8
    assert np.median(LogMel()(framed(noise(0.3, -20, slope=0.0))).voicing) < 0.6


def test_a_shorter_vocal_tract_has_its_formants_higher():
    tones = [LogMel()(np.sin(np.pi * hz / 8000 * np.arange(400))[None]) for hz in (1000, 1200)]
    low, high = (tone.bands_db[0] for tone in tones)
    assert abs(int(np.argmax(warped(low, 1.2))) - int(np.argmax(high))) <= 1
    assert np.argmax(warped(low, 1.2)) > np.argmax(low)
    np.testing.assert_allclose(warped(low, 1.0), low, atol=1e-3)


def test_the_pitch_of_a_voice_is_heard_and_noise_has_none():
    from_voice, from_noise = (
        heard(spoken("a", 0.4))[:, -1],
        heard(noise(0.4, -20, slope=0.0))[:, -1],
    )
    assert np.median(from_voice) == pytest.approx(np.log2(120 / 180), abs=0.15)
    assert np.abs(np.median(from_noise)) < 0.5
    assert np.isfinite(heard(np.zeros(3200))).all()


def test_twenty_decibels_more_or_less_make_no_difference_soon():
    sound = np.tile(np.r_[spoken("a", 0.3), noise(0.2, -45)], 8)
    soft, loud = heard(0.1 * sound), heard(sound)
    assert soft.shape == loud.shape == (len(soft), FEATURES)
    assert np.abs(soft[-60:] - loud[-60:]).mean() < 0.12 < np.abs(soft[:30] - loud[:30]).mean()


def test_an_hour_of_silence_ends_where_a_minute_of_it_does():
    """Digital silence and a faint hiss: the levels reach an end and stay."""
    for level_db in (-100.0, -75.0):
        bands = np.full((1, 32), level_db - 15, np.float32)
        frame = Spectrum(bands, np.zeros(1, np.float32), np.zeros(1, np.float32))
        normaliser = Normaliser()
        for _ in range(4000):
            minute = normaliser(frame)[0]
        for _ in range(6_000):
            later = normaliser(frame)[0]
        np.testing.assert_array_equal(minute, later)


def test_streams_of_a_batch_are_apart():
    frames = LogMel()(framed(spoken("i", 0.2)))
    silent = LogMel()(framed(np.zeros(3200, np.float32)))
    alone, pair = Normaliser(1), Normaliser(2)
    for k in range(len(frames.voicing)):
        one = alone(Spectrum(*(part[None, k] for part in vars(frames).values())))[0]
        stacked = [np.stack([a[k], b[k]]) for a, b in
                   zip(vars(frames).values(), vars(silent).values(), strict=True)]  # fmt: skip
        both = pair(Spectrum(*stacked))[0]
    np.testing.assert_allclose(both[0], one[0], rtol=1e-5)
