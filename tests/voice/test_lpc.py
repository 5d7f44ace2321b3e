"""LPC cepstrum of order 20 on frames of 512 samples."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from voice_sounds import DATA, noise, recorded, spoken

from hypermask.voice import lpc

SPTK = Path("/usr/libexec/sptk/bin")
needs_sptk = pytest.mark.skipif(not (SPTK / "lpc").exists(), reason="Debian's sptk is absent")


def frames_of_speech() -> np.ndarray:
    sound = np.concatenate([spoken(vowel, 0.2) for vowel in "aiu"]) + noise(0.6, -60)
    return sound[: len(sound) // 512 * 512].reshape(-1, 512).astype(np.float64)


@needs_sptk
@pytest.mark.parametrize("source", ["synthetic", "recorded"])
def test_agrees_with_sptk(source):
    if source == "recorded" and not DATA.is_dir():
        pytest.skip("the recordings in ../shared are absent")
    frames = frames_of_speech() if source == "synthetic" else recorded("w03", "eh").frames(64)
    windowed = (frames * lpc.window()).astype(np.float32)  # what SPTK reads and writes
    predictor = sptk("lpc", windowed)
    reference = sptk("lpc2c", predictor).reshape(len(frames), 21)[:, 1:]
    polynomials, _ = lpc.levinson_durbin(lpc.autocorrelation(windowed.astype(np.float64)))
    np.testing.assert_allclose(polynomials[:, 1:], predictor.reshape(-1, 21)[:, 1:], atol=1e-6)
    piped = polynomials.astype(np.float32).astype(np.float64)  # as between SPTK's two tools
    np.testing.assert_allclose(lpc.lpc_to_cepstrum(piped), reference, atol=1e-6)


def sptk(tool: str, data: np.ndarray) -> np.ndarray:
    options = {"lpc": ["-l", "512", "-m", "20"], "lpc2c": ["-m", "20", "-M", "20"]}[tool]
    done = subprocess.run([SPTK / tool, *options], input=data.tobytes(), capture_output=True)
    return np.frombuffer(done.stdout, np.float32)


def test_cepstrum_of_a_single_pole_is_known_in_closed_form():
    polynomial = np.zeros((1, 21))
    polynomial[0, :2] = 1.0, -0.9
    order = np.arange(1, 21)
    np.testing.assert_allclose(lpc.lpc_to_cepstrum(polynomial)[0], 0.9**order / order, atol=1e-14)


def test_the_window_is_hamming():
    n = np.arange(512)
    np.testing.assert_allclose(lpc.window(), 0.54 - 0.46 * np.cos(2 * np.pi * n / 511))


def test_levinson_durbin_solves_the_normal_equations():
    correlation = lpc.autocorrelation(frames_of_speech() * lpc.window())
    polynomials, power = lpc.levinson_durbin(correlation)
    lag = np.abs(np.subtract.outer(np.arange(20), np.arange(20)))
    for r, a, error in zip(correlation, polynomials, power, strict=True):
        np.testing.assert_allclose(a[1:], np.linalg.solve(r[lag], -r[1:]), atol=1e-6)
        assert error == pytest.approx(a @ r, rel=1e-6)


def test_one_frame_at_a_time_is_the_same_as_many():
    frames = frames_of_speech()
    analyse = lpc.FrameAnalyser()
    np.testing.assert_allclose([analyse(f) for f in frames], lpc.cepstra(frames), atol=1e-9)


def test_level_does_not_matter():
    frames = frames_of_speech()
    np.testing.assert_allclose(lpc.cepstra(0.01 * frames), lpc.cepstra(frames), atol=1e-9)


def test_silence_has_a_flat_spectrum():
    assert np.all(lpc.cepstra(np.zeros((2, 512))) == 0)
    assert np.all(lpc.FrameAnalyser()(np.zeros(512)) == 0)


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_broken_samples_count_as_zero(broken):
    frames = frames_of_speech()[:1]
    frames[0, 100:110] = broken
    repaired = np.where(np.isfinite(frames), frames, 0.0)
    np.testing.assert_array_equal(lpc.cepstra(frames), lpc.cepstra(repaired))


def test_a_pure_tone_stays_finite():
    tone = np.sin(2 * np.pi * 1000 * np.arange(512) / 16_000)[None]
    assert np.isfinite(lpc.cepstra(tone)).all()
    assert np.isfinite(lpc.cepstra(np.ones((1, 512)))).all()
    assert np.isfinite(lpc.FrameAnalyser()(tone[0])).all()
