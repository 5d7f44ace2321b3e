"""Tables of spoken vowels: which recording holds which vowel, and where its nucleus is.

The recordings of Hillenbrand, Getty, Clark and Wheeler (1995) come so: columns `file` (relative to
the table), `speaker`, `group`, `vowel`, `start_ms`, `end_ms`; others are ignored.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.voice.lpc import FRAME, RATE_HZ, cepstra
from hypermask.voice.resample import resample
from hypermask.voice.wav import read_wav

# "hod", "heed", "who'd", "head" or "haid", "boat": the English vowels nearest to the five.
MOUTH_OF_VOWEL = {"ah": "a", "iy": "i", "uw": "u", "eh": "e", "ei": "e", "oa": "o"}

_COLUMNS = ("file", "speaker", "group", "vowel", "start_ms", "end_ms")


@dataclass(frozen=True)
class Vowel:
    """samples: the whole recording at 16 kHz (n,); start and end of the nucleus in samples.

    `mouth` is "" for a vowel that is none of the five.
    """

    speaker: str
    group: str
    vowel: str
    mouth: str
    samples: NDArray[np.float64]
    start: int
    end: int

    def frames(self, hop: int = FRAME, margin: float = 0.0) -> NDArray[np.float64]:
        """Frames (n, 512) within the nucleus, `margin` of its length left out at either end."""
        inset = int(margin * (self.end - self.start))
        starts = range(self.start + inset, self.end - inset - FRAME + 1, hop)
        if not starts:
            starts = range(max((self.start + self.end - FRAME) // 2, 0), len(self.samples), FRAME)
            starts = starts[:1]
        nucleus = [self.samples[at : at + FRAME] for at in starts]
        return np.stack([np.pad(frame, (0, FRAME - len(frame))) for frame in nucleus])


def read_table(path: Path, every: bool = False) -> list[dict[str, str]]:
    """The rows with one of the five vowels (or with `every` vowel), whole.

    Raises `DataError` VOICE-CSV: absent, unreadable, without a column, with a broken row, or
    without any of the five vowels.
    """
    try:
        text = path.read_text("utf-8-sig")
    except FileNotFoundError:
        raise _bad_table(path, "does not exist") from None
    except (OSError, UnicodeDecodeError) as error:
        raise _bad_table(path, f"cannot be read: {error}") from error
    reader = csv.DictReader(text.splitlines())
    try:
        missing = [name for name in _COLUMNS if name not in (reader.fieldnames or ())]
        if missing:
            raise _bad_table(path, f"has no column '{missing[0]}'")
        rows = [row for row in reader if _checked(path, reader.line_num, row) or every]
    except csv.Error as error:
        raise _bad_table(path, f"is broken at line {reader.line_num}: {error}") from error
    if not rows:
        raise _bad_table(path, f"has none of the vowels {', '.join(MOUTH_OF_VOWEL)}")
    return rows


def one_each(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """The rows to measure with: "haid", a glide, stands for /e/ only where "head" is absent."""
    steady = any(row["vowel"] == "eh" for row in rows)
    return [row for row in rows if not (steady and row["vowel"] == "ei")]


def _checked(path: Path, line: int, row: dict[str, str]) -> bool:
    """Whether the row holds one of the five vowels."""
    if any(not row[name] for name in _COLUMNS):
        raise _bad_table(path, f"is truncated at line {line}")
    try:
        start, end = float(row["start_ms"]), float(row["end_ms"])
    except ValueError:
        raise _bad_table(path, f"has a time that is no number at line {line}") from None
    if not 0 <= start < end < 1e7:
        raise _bad_table(path, f"has a nucleus that ends before it starts at line {line}")
    return row["vowel"] in MOUTH_OF_VOWEL


def read_vowel(table: Path, row: dict[str, str]) -> Vowel:
    """Raises `DataError` VOICE-WAV: absent, unreadable, or shorter than its nucleus."""
    path = table.parent / row["file"]
    try:
        samples, rate_hz = read_wav(path)
        finite = np.nan_to_num(samples, nan=0.0, posinf=0.0, neginf=0.0)
        sound = resample(finite, rate_hz)
    except DataError as error:
        raise DataError("VOICE-WAV", f"{table}: {error.what}", error.remedy) from error
    start, end = (round(float(row[name]) * RATE_HZ / 1000) for name in ("start_ms", "end_ms"))
    if end > len(sound) + FRAME // 2:
        raise DataError(
            "VOICE-WAV",
            f"{table}: the recording {path} ends at {1000 * len(sound) / RATE_HZ:.0f} ms, before "
            f"its vowel does at {row['end_ms']} ms",
            "Copy the recording again, or correct the table.",
        )
    mouth = MOUTH_OF_VOWEL.get(row["vowel"], "")
    return Vowel(row["speaker"], row["group"], row["vowel"], mouth, sound, start, end)


def _bad_table(path: Path, why: str) -> DataError:
    return DataError(
        "VOICE-CSV",
        f"the table of vowels {path} {why}",
        f"It needs the columns {', '.join(_COLUMNS)} and one whole row for each recording.",
    )


def cepstra_of(vowels: Sequence[Vowel]) -> dict[str, NDArray[np.float64]]:
    """One speaker's LPC cepstra (n, 20) of each of the five vowels that he has."""
    parts: dict[str, list[NDArray[np.float64]]] = {}
    for vowel in vowels:
        parts.setdefault(vowel.mouth, []).append(cepstra(vowel.frames()))
    return {mouth: np.concatenate(frames) for mouth, frames in parts.items()}
