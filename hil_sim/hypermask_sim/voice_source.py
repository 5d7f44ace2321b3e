"""The actor's voice: a WAV file of any common form, or a sentence spoken by espeak-ng."""

from __future__ import annotations

import hashlib
import math
import os
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.errors import ConfigError, DataError
from hypermask_drivers.sound import wav

Samples = NDArray[np.float32]

SPEECH = (
    "Ladies and gentlemen, welcome to the show. I am nobody in particular, and I may become "
    "anyone you please. Look closely at my face, and do not believe a word of it."
)


@dataclass(frozen=True)
class Voice:
    """samples: (n,) float32, full scale 1; note: something the user should know, or ''."""

    samples: Samples
    rate_hz: int
    note: str = ""

    def repeated(self, pause_s: float, duration_s: float) -> Voice:
        """The recording again and again, `pause_s` of silence between, for `duration_s`."""
        if not len(self.samples):
            return self
        pause = np.zeros(round(pause_s * self.rate_hz), np.float32)
        once = np.concatenate([self.samples, pause])
        times = math.ceil(duration_s * self.rate_hz / len(once))
        return Voice(np.tile(once, max(times, 1)), self.rate_hz, self.note)

    def block(self, first: int, count: int) -> Samples:
        """(count,) samples from number `first` on, silence outside the recording."""
        block = np.zeros(count, np.float32)
        start, stop = max(first, 0), min(first + count, len(self.samples))
        if start < stop:
            block[start - first : stop - first] = self.samples[start:stop]
        return block


def find_voice(choices: tuple[str, ...], rate_hz: int) -> Voice:
    """The first of `choices` that is there: "none", "speech" or a WAV file, at `rate_hz`.

    Raises `ConfigError` VOICE-ABSENT and `DataError` VOICE-FORMAT.
    """
    for choice in choices:
        if choice == "none":
            return Voice(np.zeros(0, np.float32), rate_hz)
        if choice == "speech":
            return spoken(SPEECH, rate_hz)
        if Path(choice).is_file():
            samples, rate = read_wav(Path(choice))
            return Voice(resample(samples, rate, rate_hz), rate_hz)
    raise ConfigError(
        "VOICE-ABSENT",
        f"there is no recording '{' or '.join(choices)}'",
        "Name a WAV file in performer.voice, or 'speech' or 'none'.",
    )


def spoken(text: str, rate_hz: int) -> Voice:
    """`text` spoken by espeak-ng, kept in the cache; silence and a note where it is missing."""
    program = shutil.which("espeak-ng")
    if program is None:
        silence = np.zeros(0, np.float32)
        return Voice(silence, rate_hz, "espeak-ng is not installed, so the actor is silent")
    key = hashlib.sha256(text.encode()).hexdigest()[:16]
    path = cache_folder() / f"speech-{key}.wav"
    if not path.is_file():
        _speak(program, text, path)
    samples, rate = read_wav(path)
    return Voice(resample(samples, rate, rate_hz), rate_hz)


def _speak(program: str, text: str, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        part = Path(folder) / "speech.wav"
        command = [program, "-v", "en-us", "-s", "140", "-w", str(part), text]
        done = subprocess.run(command, capture_output=True, check=False, timeout=60)
        if done.returncode != 0 or not part.is_file():
            raise DataError(
                "VOICE-SPEECH", "espeak-ng could not speak", "Try it by hand, or take a WAV file."
            )
        part.replace(path)


def cache_folder() -> Path:
    """HYPERMASK_CACHE, else build/cache of a checkout, else the user's cache folder."""
    named = os.environ.get("HYPERMASK_CACHE")
    if named:
        return Path(named)
    repository = Path(__file__).resolve().parents[2]
    if (repository / "configs").is_dir() and os.access(repository, os.W_OK):
        return repository / "build" / "cache"
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "hypermask"


def read_wav(path: Path) -> tuple[Samples, int]:
    """Mono samples (n,) float32 within full scale, and the rate in Hz.

    Values that are no numbers stay: they are what a broken microphone sends. Raises `DataError`
    VOICE-ABSENT, VOICE-READ, VOICE-FORMAT.
    """
    samples, rate = wav.read_wav(path)
    samples = np.where(np.isfinite(samples), samples, np.float32(np.nan))
    return np.clip(samples, -1, 1), round(rate)


def resample(samples: Samples, from_hz: int, to_hz: int, zeros: int = 24) -> Samples:
    """Change the rate with a Kaiser-windowed sinc (about 80 dB down beyond the band).

    zeros: zero crossings of the sinc on each side.
    """
    if from_hz == to_hz or not len(samples):
        return samples
    lost = ~np.isfinite(samples)
    if lost.any():  # a sinc would carry them to all their neighbours
        result = resample(np.where(lost, np.float32(0), samples), from_hz, to_hz, zeros)
        nearest = np.arange(len(result)) * from_hz // to_hz
        result[lost[np.minimum(nearest, len(samples) - 1)]] = np.nan
        return result
    divisor = math.gcd(from_hz, to_hz)
    up, down = to_hz // divisor, from_hz // divisor
    cutoff = 0.95 * min(1.0, to_hz / from_hz)
    half = math.ceil(zeros / cutoff)
    phases = np.arange(up)[:, None] / up
    taps = np.arange(-half + 1, half + 1)[None, :] - phases
    window = np.i0(8.0 * np.sqrt(np.maximum(1 - (taps / half) ** 2, 0))) / np.i0(8.0)
    kernel = (cutoff * np.sinc(cutoff * taps) * window).astype(np.float32)
    padded = np.pad(samples, half)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half)
    count = math.ceil(len(samples) * up / down)
    result = np.empty(count, np.float32)
    for start in range(0, count, 8192):
        place = np.arange(start, min(start + 8192, count)) * down
        result[start : start + 8192] = np.einsum(
            "nk,nk->n", windows[place // up + 1], kernel[place % up]
        )
    return result
