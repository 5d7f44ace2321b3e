"""What the recurrent network is trained on: who speaks, what, and how it becomes scenes.

Three kinds of scenes: connected speech of synthesisers, several recorded words or long notes of one
person, and single recorded words that begin as a recording does, with nothing known of the voice.
Which voices choose constants and which measure is said here too.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.progress import Progress, track

from hypermask.voice import synthesis
from hypermask.voice.corpus import (
    LEARNT_VOWELS,
    Draw,
    Mixer,
    Piece,
    at_pitch,
    of_utterance,
    of_vowel,
    silence,
    sung,
)
from hypermask.voice.recurrent_train import Lesson, Sequences
from hypermask.voice.synthesis import FESTIVAL_VOICES, FLITE_VOICES, Utterance
from hypermask.voice.vowels import Vowel, read_table, read_vowel

LANGUAGES = ("en-us", "en-gb-x-rp", "es", "es-419", "de", "ja")
VARIANTS = (
    "", "+m1", "+m2", "+m3", "+m4", "+m5", "+m6", "+f1", "+f2", "+f3", "+f4", "+klatt2", "+klatt4",
    "+linda", "+steph", "+iven2", "+max", "+john", "+adam", "+whisper", "+Andrea", "+Annie",
    "+Diogo", "+Henrique", "+Mario", "+Michael", "+anika", "+aunty", "+belinda", "+boris", "+david",
    "+ed", "+edward", "+grandma", "+marcelo", "+miguel", "+norbert", "+pablo", "+quincy", "+rob",
    "+sandro", "+shelby", "+steph2", "+travis", "+victor", "+zac",
)  # fmt: skip
UNHEARD = ("+m7", "+m8", "+f5", "rms", "pc_diphone", "czech_ph")
"""Voices that are never trained on: they measure."""
VALIDATION = ("+m4", "+f4", "+belinda", "kal_diphone", "kal16", "czech_dita", "suo_fi_lj_diphone")
"""Voices that are not trained on either: the constants of hearing and lips were chosen by them."""
PARTS = 3
_ENGLISH = (*FLITE_VOICES, "ked_diphone", "kal_diphone", "cmu_us_slt_arctic_hts")
_BY_PEOPLE, _BY_FORMANTS = 40, 150  # lines a voice, lines a language
_SPEECH_SEED = 20

_OF_SPEECH = (0.56, 0.37, 0.07)  # scenes by synthesisers that model people, by espeak-ng, silent
_SPREAD = (0.85, 1.25)  # of the synthesised voices' pitch
_OWN_SPREAD = (0.88, 1.14)  # of the recorded ones'
_IMPORTANCE, _OTHERS = 2.5, 0.4  # of frames of the five vowels, and of the other seven
_FIVE = 0.6  # of the words drawn
_WORD_FRAMES, _CROP = 80, 128
_SPEECH, _LONG, _WORDS = 6000, 1500, 9000  # scenes


def all_vowels(folder: Path) -> list[Vowel]:
    """All twelve vowels. Raises `DataError` VOICE-CSV or VOICE-WAV."""
    table = folder / "vowels.csv"
    rows = read_table(table, every=True)
    return [read_vowel(table, row) for row in track(rows, "Reading recordings")]


def left_out(vowels: Sequence[Vowel], part: int) -> set[str]:
    """The speakers of part 1, 2 or 3: a third of each group's, and together all of them."""
    chosen: set[str] = set()
    for group in sorted({vowel.group for vowel in vowels}):
        speakers = sorted({vowel.speaker for vowel in vowels if vowel.group == group})
        np.random.default_rng(_SPEECH_SEED).shuffle(speakers)
        chosen |= set(speakers[part - 1 :: PARTS])
    return chosen


def formants(folder: Path) -> dict[tuple[str, str], tuple[float, float, float]]:
    """Measured formants in Hz by speaker and vowel, where the table gives all three."""
    with (folder / "vowels.csv").open("r", encoding="utf-8-sig", newline="") as file:
        found = {}
        for row in csv.DictReader(file):
            values = [float(row.get(f"f{k}_hz") or 0) for k in (1, 2, 3)]
            if all(values) and row["vowel"] in LEARNT_VOWELS:
                found[row["speaker"], row["vowel"]] = (values[0], values[1], values[2])
        return found


def speech() -> tuple[list[Utterance], list[Utterance]]:
    """What synthesisers say that model people, and what espeak-ng says; the same each time.

    Raises `DataError` VOICE-SYNTH.
    """
    rng = np.random.default_rng(_SPEECH_SEED)
    silent = {*UNHEARD, *VALIDATION}
    people: list[Utterance] = []
    for voice in track([v for v in FESTIVAL_VOICES if v not in silent], "Festival speaks"):
        people += synthesis.festival(_lines(voice in _ENGLISH, rng), voice)
    for voice in track([v for v in FLITE_VOICES if v not in silent], "flite speaks"):
        people += [synthesis.flite(line, voice) for line in _lines(True, rng)]
    espeak, formant = synthesis.espeak(), []
    variants = [variant for variant in VARIANTS if variant not in silent]
    for language in track(LANGUAGES, "espeak-ng speaks"):
        for _ in range(_BY_FORMANTS):
            text = _line(language[:2], rng)
            voice = language + str(rng.choice(variants))
            speed, pitch = int(rng.integers(110, 260)), int(rng.integers(15, 85))
            formant.append(espeak.say(text, voice, speed, pitch))
    return people, formant


def _line(language: str, rng: np.random.Generator) -> str:
    lines = synthesis.sentences(language, "train")
    if rng.uniform() < 0.5:
        return str(rng.choice(lines))
    if language == "ja":
        return synthesis.nonsense(rng, kana=True)
    return synthesis.shuffled_words(lines, rng)


def _lines(english: bool, rng: np.random.Generator) -> list[str]:
    languages = ["en"] if english else ["es", "ja-latin"]
    lines = [line for name in languages for line in synthesis.sentences(name, "train")]
    half = rng.choice(lines, min(_BY_PEOPLE // 2, len(lines)), replace=False)
    made = [synthesis.shuffled_words(lines, rng) for _ in range(_BY_PEOPLE - len(half))]
    if not english:
        made[::2] = [synthesis.nonsense(rng, kana=False) for _ in made[::2]]
    return [*map(str, half), *made]


def speech_scenes(people: Sequence[Utterance], formant: Sequence[Utterance]) -> Sequences:
    """The same each time."""
    by_people, by_formants = ([of_utterance(u) for u in said] for said in (people, formant))
    draws = [_spoken(by_people), _spoken(by_formants), _silent]
    mixer = Mixer(list(zip(_OF_SPEECH, draws, strict=True)), by_people)
    return _mixed(mixer, _SPEECH, np.random.default_rng(_SPEECH_SEED), "Mixing speech")


def spoken_lesson(spoken: Sequences) -> Lesson:
    return Lesson(spoken, 48, _CROP)


def lessons(
    spoken: Sequences,
    vowels: Sequence[Vowel],
    folder: Path,
    babble: Sequence[Utterance],
    rng: np.random.Generator,
) -> list[Lesson]:
    """spoken: of `speech_scenes`; vowels: of the speakers to learn from."""
    named = {vowel.speaker for vowel in vowels}
    measured = [(key[1], value) for key, value in formants(folder).items() if key[0] in named]
    crowd = [of_utterance(utterance) for utterance in babble]
    several = Mixer([(0.75, _recorded(vowels, 4)), (0.25, _sung(measured))], crowd)
    single = Mixer([(1.0, _recorded(vowels, 1))], crowd, _WORD_FRAMES, single=True)
    return [
        Lesson(spoken, 32, _CROP, 1.0),
        Lesson(_mixed(several, _LONG, rng, "Mixing words"), 8, _CROP, 0.3),
        Lesson(_mixed(single, _WORDS, rng, "Mixing single words"), 64, _WORD_FRAMES, 0.6),
    ]


def _mixed(mixer: Mixer, count: int, rng: np.random.Generator, what: str) -> Sequences:
    with Progress() as bar:
        task = bar.add_task(what, total=count)
        return mixer.sequences(count, rng, lambda: bar.advance(task))


def _recorded(vowels: Sequence[Vowel], count: int) -> Draw:
    """Words of one speaker; every group of speakers is heard equally often, the five vowels more
    than others."""
    groups: dict[str, dict[str, tuple[list[Piece], list[Piece]]]] = {}
    for vowel in vowels:
        own = groups.setdefault(vowel.group, {}).setdefault(vowel.speaker, ([], []))
        own[vowel.vowel in LEARNT_VOWELS].append(of_vowel(vowel, _IMPORTANCE, _OTHERS))
    speakers = [list(group.values()) for group in groups.values()]

    def draw(rng: np.random.Generator) -> list[Piece]:
        group = speakers[rng.integers(len(speakers))]
        own = group[rng.integers(len(group))]
        factor = rng.uniform(*_OWN_SPREAD)
        words = []
        for _ in range(count):
            some = own[bool(rng.uniform() < _FIVE)] or own[0] or own[1]
            words.append(at_pitch(some[rng.integers(len(some))], factor))
        return words

    return draw


def _spoken(pieces: Sequence[Piece]) -> Draw:
    def draw(rng: np.random.Generator) -> list[Piece]:
        return [at_pitch(pieces[int(rng.integers(len(pieces)))], rng.uniform(*_SPREAD))]

    return draw


def _sung(notes: Sequence[tuple[str, tuple[float, float, float]]]) -> Draw:
    def draw(rng: np.random.Generator) -> list[Piece]:
        vowel, measured = notes[int(rng.integers(len(notes)))]
        return [silence(int(rng.integers(3, 30))), sung(rng, measured, vowel)]

    return draw


def _silent(rng: np.random.Generator) -> list[Piece]:
    return [silence(int(rng.integers(100, 300)))]
