"""An excited voice has more arousal than a calm one, for men and women, at any gain."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from hypermask.voice import synthesis
from hypermask.voice.arousal import Arousal
from hypermask.voice.follower import MouthFollower


def speak(arousal, pitch_hz, level_db, seconds, lively=0.0, seed=0, pauses=True):
    """Syllables of 200 ms with 50 ms between; returns the values."""
    rng = np.random.default_rng(seed)
    values, pitch, level = [], pitch_hz, level_db
    for k in range(int(seconds * 100)):
        if k % 25 == 0:
            pitch = pitch_hz * 2 ** (lively * rng.normal(0, 0.25))
            level = level_db + lively * rng.normal(0, 5)
        if pauses and k % 25 >= 20:
            values.append(arousal(-60.0, 0.1, 80.0, 0.9))
        else:
            values.append(
                arousal(level + rng.normal(0, 1), 0.9, pitch * 2 ** rng.normal(0, 0.02), 0.05)
            )
    return np.array(values)


@pytest.mark.parametrize("pitch_hz", [100.0, 210.0, 300.0])
@pytest.mark.parametrize("level_db", [-45.0, -20.0])
def test_louder_higher_and_livelier_is_excited(pitch_hz, level_db):
    arousal = Arousal()
    calm = speak(arousal, pitch_hz, level_db, 10, lively=0.3)[-300:].mean()
    excited = speak(arousal, 1.5 * pitch_hz, level_db + 9, 5, lively=1.2, seed=1)[-200:].mean()
    assert calm < 0.4
    assert excited > 0.7


def test_it_calms_down_again():
    arousal = Arousal()
    speak(arousal, 120, -25, 10, lively=0.3)
    speak(arousal, 190, -15, 4, lively=1.2)
    assert speak(arousal, 120, -25, 5, lively=0.3)[-100:].mean() < 0.4


def test_silence_has_none():
    arousal = Arousal()
    assert speak(arousal, 120, -25, 5)[-1] > 0.05
    values = [arousal(-90.0, 0.0, 75.0, 1.0) for _ in range(2000)]
    assert np.all(np.diff(values) <= 0)
    assert values[-1] < 0.01


def test_it_stays_within_its_range_whatever_comes():
    rng, arousal = np.random.default_rng(0), Arousal()
    for _ in range(3000):
        value = arousal(rng.uniform(-100, 20), rng.uniform(), rng.uniform(1, 9000), rng.uniform())
        assert 0 <= value <= 1


@pytest.mark.skipif(shutil.which("espeak-ng") is None, reason="espeak-ng is absent")
@pytest.mark.parametrize("voice", ["en-us+m3", "de+f2"])
def test_excited_speech_is_told_from_calm_speech(voice):
    lines = synthesis.sentences(voice[:2], "test")[:6]

    def said(speed: int, pitch: int, gain: float) -> np.ndarray:
        parts = [synthesis.espeak().say(line, voice, speed, pitch).samples for line in lines]
        return gain * np.concatenate(parts)

    follower = MouthFollower(16_000)
    means, at_s = [], 0.0
    for sound in (said(140, 30, 0.15), said(220, 90, 0.6), said(140, 30, 0.15)):
        frames = follower.feed(sound, at_s)
        at_s += len(sound) / 16_000
        means.append(np.mean([frame.arousal for frame in frames[len(frames) // 3 :]]))
    assert means[1] > means[0] + 0.25
    assert means[1] > means[2] + 0.25
