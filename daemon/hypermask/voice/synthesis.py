"""Speech with known phone times, from synthesisers: for training and for tests, never in a show.

espeak-ng speaks four languages by formants and reports each phone exactly (its library's PHONEME
events). flite and Festival join or model recordings of people, which is nearer to a real voice.
"""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import tempfile
import tomllib
import unicodedata
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.voice.resample import resample
from hypermask.voice.visemes import CLASSES, classes_of, festival_classes
from hypermask.voice.wav import read_wav

FLITE_VOICES = ("awb", "rms", "slt", "kal16")
FESTIVAL_VOICES = (
    "ked_diphone", "kal_diphone", "cmu_us_slt_arctic_hts", "lp_diphone", "pc_diphone",
    "suo_fi_lj_diphone", "hy_fi_mv_diphone", "upc_ca_ona_hts", "czech_ph", "czech_dita",
    "czech_krb", "czech_machac",
)  # fmt: skip
_ENGLISH = ("ked_diphone", "kal_diphone", "cmu_us_slt_arctic_hts")
_STOPS = frozenset("ptkbdgɡcɟ")
_SILENT = 1e-4
_FRONT_ROUNDED = CLASSES.index("ue")

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Phone:
    """When a phone sounds, what it was called, and its one or two classes (see `visemes`)."""

    begin_s: float
    end_s: float
    label: str
    classes: list[int]


@dataclass(frozen=True)
class Utterance:
    """samples at 16 kHz."""

    samples: NDArray[np.float32]
    phones: list[Phone]
    voice: str
    text: str


@cache
def sentences(language: str, part: str) -> list[str]:
    """part: "train" or "test"; language: en, es, de, ja or ja-latin."""
    with (Path(__file__).parent / "data" / "sentences.toml").open("rb") as file:
        return list(tomllib.load(file)[language][part])


def shuffled_words(lines: list[str], rng: np.random.Generator) -> str:
    """A line of words from anywhere: sounds in company that no sentence has."""
    words = re.sub(r"[^\w\s]", "", " ".join(lines)).split()
    chosen = [words[k] for k in rng.integers(0, len(words), rng.integers(4, 10))]
    if len(chosen) > 5:
        chosen[2] += ","
    return " ".join(chosen)


_KANA = {
    "": "あいうえお", "k": "かきくけこ", "g": "がぎぐげご", "s": "さしすせそ", "z": "ざじずぜぞ",
    "t": "たちつてと", "d": "だぢづでど", "n": "なにぬねの", "h": "はひふへほ", "b": "ばびぶべぼ",
    "p": "ぱぴぷぺぽ", "m": "まみむめも", "r": "らりるれろ",
}  # fmt: skip
_GLIDES = {"y": {"a": "や", "u": "ゆ", "o": "よ"}, "w": {"a": "わ"}}
_SYLLABLES = [
    *((head + "aiueo"[k], kana) for head, row in _KANA.items() for k, kana in enumerate(row)),
    *((head + vowel, kana) for head, row in _GLIDES.items() for vowel, kana in row.items()),
]  # fmt: skip


def nonsense(rng: np.random.Generator, kana: bool) -> str:
    """Words of any open syllables, in kana or in Latin letters."""
    words = [
        "".join(_SYLLABLES[k][kana] for k in rng.integers(0, len(_SYLLABLES), rng.integers(2, 5)))
        for _ in range(rng.integers(3, 8))
    ]
    return ("、" if kana else ", ").join([words[0], (" ").join(words[1:])])


def plain(text: str) -> str:
    """Without accents: some synthesisers know Latin-1 only, or less."""
    return unicodedata.normalize("NFD", text).encode("ascii", "ignore").decode()


# --- espeak-ng


class _Name(ctypes.Union):
    _fields_ = (("number", ctypes.c_int), ("name", ctypes.c_char_p), ("string", ctypes.c_char * 8))


class _Event(ctypes.Structure):
    _fields_ = (
        ("type", ctypes.c_int),
        ("unique_identifier", ctypes.c_uint),
        ("text_position", ctypes.c_int),
        ("length", ctypes.c_int),
        ("audio_ms", ctypes.c_int),
        ("sample", ctypes.c_int),
        ("user_data", ctypes.c_void_p),
        ("id", _Name),
    )


_PHONEME_EVENT, _RETRIEVAL, _PHONEMES, _IPA = 7, 1, 1, 2
_RATE, _PITCH = 1, 3  # espeak_PARAMETER
_Callback = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.POINTER(_Event)
)


class Espeak:
    """The library of espeak-ng; raises `DataError` VOICE-SYNTH if absent. See `espeak`."""

    def __init__(self) -> None:
        try:
            self._library = ctypes.CDLL("libespeak-ng.so.1")
        except OSError as error:
            raise absent("espeak-ng") from error
        self._rate_hz = self._library.espeak_Initialize(_RETRIEVAL, 0, None, _PHONEMES | _IPA)
        self._sound: list[NDArray[np.int16]] = []
        self._events: list[tuple[float, str]] = []
        self._callback = _Callback(self._take)
        self._library.espeak_SetSynthCallback(self._callback)

    def say(self, text: str, voice: str, words_a_minute: int = 175, pitch: int = 50) -> Utterance:
        """voice: a language and a variant, as "de+f2". Raises `DataError` VOICE-SYNTH."""
        self._sound, self._events = [], []
        if self._library.espeak_SetVoiceByName(voice.encode()) != 0:
            raise absent(f"the voice {voice} of espeak-ng")
        self._library.espeak_SetParameter(_RATE, words_a_minute, 0)
        self._library.espeak_SetParameter(_PITCH, pitch, 0)
        spoken = text.encode()
        self._library.espeak_Synth(spoken, len(spoken) + 1, 0, 1, 0, 1, None, None)
        self._library.espeak_Synchronize()
        samples = np.concatenate([*self._sound, np.zeros(1, np.int16)]) / 32768.0
        return Utterance(
            resample(samples, self._rate_hz).astype(np.float32), self._phones(samples), voice, text
        )

    def _take(self, wave: ctypes._Pointer[ctypes.c_short], count: int, events: object) -> int:
        if wave and count > 0:
            self._sound.append(np.ctypeslib.as_array(wave, (count,)).copy())
        k = 0
        while events[k].type != 0:  # type: ignore[index]
            event = events[k]  # type: ignore[index]
            if event.type == _PHONEME_EVENT:
                label = bytes(event.id.string).decode("utf-8", "ignore")
                self._events.append((event.audio_ms / 1000, label))
            k += 1
        return 0

    def _phones(self, samples: _Floats) -> list[Phone]:
        """A stop's silence belongs to the stop; espeak-ng counts it to the phone before."""
        begins = [begin_s for begin_s, _ in self._events]
        labels = [label for _, label in self._events]
        for k in range(1, len(begins)):
            if labels[k][:1] in _STOPS and labels[k - 1] not in ("", "_"):
                begins[k] = self._closure(samples, begins[k - 1], begins[k])
        return phones(begins, labels, len(samples) / self._rate_hz, classes_of(labels))

    def _closure(self, samples: _Floats, after_s: float, burst_s: float) -> float:
        """Where the silence before the burst begins."""
        at, first = int(burst_s * self._rate_hz) - 1, int(after_s * self._rate_hz)
        loud = np.flatnonzero(np.abs(samples[first : max(at, first)]) > _SILENT)
        return min((first + int(loud[-1]) + 1) / self._rate_hz, burst_s) if len(loud) else burst_s


@cache
def espeak() -> Espeak:
    """The one of this process: its library cannot be begun twice. Raises VOICE-SYNTH."""
    return Espeak()


def phones(
    begins: list[float], labels: list[str], end_s: float, classes: list[list[int]]
) -> list[Phone]:
    ends = [*begins[1:], end_s]
    return [Phone(*of) for of in zip(begins, ends, labels, classes, strict=True) if of[1] > of[0]]


# --- flite and Festival


def flite(text: str, voice: str) -> Utterance:
    """Raises `DataError` VOICE-SYNTH."""
    if shutil.which("flite") is None:
        raise absent("flite")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.wav"
        done = subprocess.run(
            ["flite", "-voice", voice, "-psdur", "-t", plain(text), "-o", str(path)],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        spans = [part.rpartition(":") for part in done.stdout.split()]
        samples = _read(path)
    labels = [label for label, _, _ in spans]
    ends = [float(end) for _, _, end in spans]
    return Utterance(
        samples,
        phones([0.0, *ends[:-1]], labels, ends[-1], classes_of([n.upper() for n in labels])),
        voice,
        text,
    )


def festival(texts: list[str], voice: str) -> list[Utterance]:
    """Many at once, because a voice takes a second to load. Raises `DataError` VOICE-SYNTH."""
    if shutil.which("festival") is None:
        raise absent("festival")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lines = [f"(voice_{voice})"]
        for k, text in enumerate(texts):
            lines.append(f'(set! u (utt.synth (Utterance Text "{plain(text)}")))')
            lines.append(f'(utt.save.wave u "{folder}/{k}.wav")')
            lines.append(f'(utt.save.segs u "{folder}/{k}.lab")')
        (folder / "say.scm").write_text("\n".join(lines), "ascii")
        subprocess.run(
            ["festival", "-b", str(folder / "say.scm")], capture_output=True, check=False
        )
        made = [k for k in range(len(texts)) if (folder / f"{k}.lab").is_file()]
        if not made:
            raise absent(f"the voice {voice} of Festival")
        return [_labelled(folder / str(k), voice, texts[k]) for k in made]


def _labelled(path: Path, voice: str, text: str) -> Utterance:
    samples = _read(path.with_suffix(".wav"))
    rows = path.with_suffix(".lab").read_text("latin-1").split("#\n", 1)[1].splitlines()
    ends = [float(row.split()[0]) for row in rows]
    labels = [row.split()[2] for row in rows]
    of = classes_of if voice in _ENGLISH else festival_classes
    classes = of([n.upper() for n in labels] if voice in _ENGLISH else labels)
    if "_fi_" in voice:  # here "y" is a vowel
        classes = [
            [_FRONT_ROUNDED] if n[:1] == "y" else c for n, c in zip(labels, classes, strict=True)
        ]
    return Utterance(samples, phones([0.0, *ends[:-1]], labels, ends[-1], classes), voice, text)


def _read(path: Path) -> NDArray[np.float32]:
    samples, rate_hz = read_wav(path)
    return resample(samples, rate_hz).astype(np.float32)


def absent(what: str) -> DataError:
    return DataError(
        "VOICE-SYNTH",
        f"{what} is not installed; the network is trained with its speech",
        "Install espeak-ng, flite, festival and the voices that the module's documentation names.",
    )
