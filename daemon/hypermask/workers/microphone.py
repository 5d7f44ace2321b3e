"""What a microphone sends, looked through before it is heard: each trouble is said once.

A trouble that comes again soon after it went is the same trouble (a loose plug, a gated radio
microphone); so a bad night gives a few lines and not thousands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.workers.retry import Report
from hypermask_drivers.sound import SoundBlock

_Samples = NDArray[np.float64]

QUIET_S = 60.0
"""A trouble that was away for so long is a new one."""
LEAST_HZ, MOST_HZ = 4_000, 768_000

_LOUDEST = 8.0  # times full scale; beyond it a sample is broken
_BROKEN_S, _BROKEN_SHARE = 0.05, 0.05
_CLIPPED, _CLIPPED_S, _CLIPPED_SHARE = 0.999, 1.0, 0.02
_VOICE_DB = -28.0  # of a voice that was not heard yet
_MUCH_CLIPPED, _MOST_CLIPPED, _FALL_DB_S = 0.15, 0.35, 60.0
_STILL_S = 2.0
_STILL = 2e-6  # -114 dB: below the noise of any converter that is connected
_AHEAD_S, _BEHIND_S = 0.1, 10.0


@dataclass
class _Trouble:
    wrong_s: float
    told: int = 0
    open: bool = False


class Troubles:
    """Says what goes wrong when it begins, and that it is over.

    Of one code `most` times are told, then nothing until it stayed away for `QUIET_S`.
    """

    def __init__(self, report: Report) -> None:
        self._report = report
        self._known: dict[str, _Trouble] = {}

    def wrong(self, now_s: float, code: str, text: str, most: int = 3) -> None:
        trouble = self._known.setdefault(code, _Trouble(now_s))
        if now_s - trouble.wrong_s > QUIET_S:
            trouble.told = 0
        trouble.wrong_s = now_s
        if not trouble.open and trouble.told < most:
            trouble.open = True
            trouble.told += 1
            self._report(now_s, code, f"{code}: {text}")

    def right(self, now_s: float, code: str, text: str = "The sound is back.") -> None:
        trouble = self._known.get(code)
        if trouble is not None and trouble.open:
            trouble.open = False
            if text:
                self._report(now_s, "SOUND-BACK", text)


class Headroom:
    """Brings sound of which much is clipped down to the voice before it, so that what follows a
    voice by its loudness has not to find a soft one again when that is over."""

    def __init__(self) -> None:
        self._voice_db, self._envelope_db, self._gain_db = _VOICE_DB, -100.0, 0.0
        self._now = 0.0

    def gain(self, sound: _Samples, seconds: float, clipped_now: float, clipped: float) -> float:
        """For a block; clipped_now, clipped: the parts of it and of the last second that were at
        the limit."""
        self._now += (clipped_now - self._now) * min(seconds / 0.03, 1.0)
        level_db = 10 * math.log10(float(sound @ sound) / len(sound) + 1e-10)
        fall_db = _FALL_DB_S * seconds
        self._envelope_db = max(level_db, self._envelope_db - fall_db)
        if clipped > _MUCH_CLIPPED or self._now > _MOST_CLIPPED:
            self._gain_db = min(self._voice_db - self._envelope_db, 0.0)
        else:
            self._gain_db = min(self._gain_db + fall_db, 0.0)
            if clipped < _CLIPPED_SHARE:
                rise_db = (level_db - self._voice_db) * min(seconds / 0.3, 1.0)
                self._voice_db += max(rise_db, -0.3 * seconds)
                self._voice_db = max(self._voice_db, _VOICE_DB - 12)
        return float(10 ** (self._gain_db / 20))


class SoundCheck:
    """Blocks in, samples that can be heard out."""

    def __init__(self, report: Report) -> None:
        self._troubles = Troubles(report)
        self._lost: str | None = None
        self._rate_hz = 0.0
        self._broken = self._clipped = self._still_s = 0.0
        self._last = 0.0
        self._headroom = Headroom()

    def device_news(self, time_s: float, code: str, text: str) -> None:
        """The report of who keeps the device open. That it is back is believed when it sounds:
        some cards can be opened again and again and give nothing."""
        if code == "SOUND-BACK":
            return
        if self._lost is None:
            self._troubles.wrong(time_s, code, text.removeprefix(f"{code}: "))
        self._lost = self._lost or code

    def samples(self, block: SoundBlock, now_s: float) -> _Samples:
        """(n,) samples, mono and finite; none where the block is of no use."""
        rate_hz = block.rate_hz
        if not LEAST_HZ <= rate_hz <= MOST_HZ:
            self._troubles.wrong(
                now_s,
                "SND-RATE",
                f"the microphone claims a sampling rate of {rate_hz:g} Hz. "
                "Choose 16000 or 48000 Hz in its settings.",
            )
            return np.zeros(0)
        raw = np.asarray(block.samples, np.float64)
        raw = raw.mean(axis=1) if raw.ndim == 2 else raw.reshape(-1)
        if len(raw) == 0:
            return raw
        self._sounds(now_s, rate_hz)
        with np.errstate(invalid="ignore"):
            good = np.abs(raw) <= _LOUDEST
        sound = raw if good.all() else np.where(good, raw, 0.0)
        seconds = len(sound) / rate_hz
        broken = max(len(raw) - int(np.count_nonzero(good)), block.broken) / len(raw)
        if self._is_broken(broken, seconds, now_s):
            self._last = 0.0
            return np.zeros(len(sound))
        clipped = self._look_for_clipping(sound, seconds, now_s)
        self._look_for_silence(sound, seconds, now_s)
        gain = self._headroom.gain(sound, seconds, clipped, self._clipped)
        return sound if gain == 1.0 else gain * sound

    def time_of(self, block: SoundBlock, now_s: float) -> float:
        """When its first sample sounded, by the clock where the block's own time is impossible."""
        length_s = len(block.samples) / block.rate_hz
        possible = math.isfinite(block.time_s) and (
            now_s - _BEHIND_S <= block.time_s <= now_s - length_s + _AHEAD_S
        )
        return block.time_s if possible else now_s - length_s

    def _sounds(self, now_s: float, rate_hz: float) -> None:
        self._troubles.right(now_s, "SND-RATE")
        if self._lost is not None:
            self._troubles.right(now_s, self._lost)
            self._lost = None
        if self._rate_hz not in (0.0, rate_hz):
            code = "SOUND-RATE"
            self._troubles.wrong(
                now_s, code, f"the microphone gives {rate_hz:g} Hz now; it is converted."
            )
            self._troubles.right(now_s, code, "")
        self._rate_hz = rate_hz

    def _is_broken(self, share: float, seconds: float, now_s: float) -> bool:
        self._broken += (share - self._broken) * min(seconds / _BROKEN_S, 1.0)
        if self._broken > _BROKEN_SHARE:
            self._troubles.wrong(
                now_s,
                "SND-BROKEN",
                "the microphone sends values that are no sound. "
                "Unplug it and plug it in again, or set another format.",
            )
            return True
        if self._broken < _BROKEN_SHARE / 5:
            self._troubles.right(now_s, "SND-BROKEN")
        return False

    def _look_for_clipping(self, sound: _Samples, seconds: float, now_s: float) -> float:
        """Part of the block that is clipped."""
        share = float(np.mean(np.abs(sound) >= _CLIPPED)) if np.ptp(sound) > _STILL else 0.0
        self._clipped += (share - self._clipped) * min(seconds / _CLIPPED_S, 1.0)
        if self._clipped > _CLIPPED_SHARE:
            self._troubles.wrong(
                now_s,
                "SND-CLIPS",
                "the microphone is too loud and clips. Turn its gain down.",
                most=1,
            )
        elif self._clipped < _CLIPPED_SHARE / 20:
            self._troubles.right(now_s, "SND-CLIPS", "")
        return share

    def _look_for_silence(self, sound: _Samples, seconds: float, now_s: float) -> None:
        low, high = min(float(sound.min()), self._last), max(float(sound.max()), self._last)
        self._last = float(sound[-1])
        if high - low > _STILL:
            self._still_s = 0.0
            self._troubles.right(now_s, "SND-SILENT")
            return
        self._still_s += seconds
        if self._still_s >= _STILL_S:
            self._troubles.wrong(
                now_s,
                "SND-SILENT",
                "the microphone is there and sends nothing but silence. "
                "Is it muted, or its radio switched off?",
                most=1,
            )
