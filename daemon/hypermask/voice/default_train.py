"""Trains the recurrent network that ships with the program, or measures it on unheard speakers.

    python -m hypermask.voice.default_train ../shared/data/vowels \\
        --out daemon/hypermask/voice/data/default.npz
    python -m hypermask.voice.default_train ../shared/data/vowels --leave-out 33 --seed 1 \\
        --quick --report daemon/hypermask/voice/data/unheard.json

Needs Debian's espeak-ng, flite, festival, festvox-{us-slt-hts,kdlpc16k,kallpc16k,italp16k,itapc16k,
suopuhe-lj,suopuhe-mv,ca-ona-hts,czech-ph,czech-dita,czech-krb,czech-machac} and half an hour.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress, track

from hypermask.errors import HypermaskError
from hypermask.storage import write_atomically
from hypermask.voice import recurrent, synthesis
from hypermask.voice.corpus import (
    Draw,
    Mixer,
    Piece,
    at_pitch,
    of_utterance,
    of_vowel,
    silence,
    sung,
)
from hypermask.voice.evaluate import evaluate_calibrated, evaluate_default, in_pink_noise
from hypermask.voice.recurrent import Recurrent
from hypermask.voice.recurrent_train import train
from hypermask.voice.synthesis import FESTIVAL_VOICES, FLITE_VOICES, Utterance
from hypermask.voice.vowels import Vowel, read_table, read_vowel

LANGUAGES = ("en-us", "en-gb-x-rp", "es", "es-419", "de", "ja")
VARIANTS = (
    "", "+m1", "+m2", "+m3", "+m4", "+m5", "+m6", "+f1", "+f2", "+f3", "+f4", "+klatt2", "+klatt4",
    "+linda", "+steph", "+iven2", "+max", "+john", "+adam", "+whisper",
)  # fmt: skip
UNHEARD = ("+m7", "+m8", "+f5", "rms", "pc_diphone", "czech_ph")
"""Voices that are never trained on."""
_ENGLISH = (*FLITE_VOICES, "ked_diphone", "kal_diphone", "cmu_us_slt_arctic_hts")
_BY_PEOPLE, _BY_FORMANTS = 40, 110  # lines a voice, lines a language


@dataclass(frozen=True)
class Stage:
    """shares: of recorded words, of synthesisers that model people, of espeak-ng, of long notes and
    of silence; importance: of a frame of a recorded vowel; spread: of the voices' pitch."""

    shares: tuple[float, float, float, float, float]
    importance: float
    spread: tuple[float, float]
    sequences: int
    iterations: int
    rate: float


STAGES = (
    Stage((0.34, 0.34, 0.23, 0.05, 0.04), 2.0, (0.85, 1.25), 6000, 2600, 3e-3),
    Stage((0.45, 0.28, 0.19, 0.04, 0.04), 3.0, (0.85, 1.25), 3000, 700, 1.2e-3),
)
"""First mostly speech; then the recorded vowels get more room."""
QUICK = Stage((0.50, 0.26, 0.17, 0.04, 0.03), 3.5, (0.90, 1.15), 4000, 1300, 3e-3)


def all_vowels(folder: Path) -> list[Vowel]:
    """All twelve vowels. Raises `DataError` VOICE-CSV or VOICE-WAV."""
    table = folder / "vowels.csv"
    rows = read_table(table, every=True)
    return [read_vowel(table, row) for row in track(rows, "Reading recordings")]


def formants(folder: Path) -> dict[tuple[str, str], tuple[float, float, float]]:
    """Measured formants in Hz by speaker and vowel, where the table gives all three."""
    with (folder / "vowels.csv").open("r", encoding="utf-8-sig", newline="") as file:
        found = {}
        for row in csv.DictReader(file):
            values = [float(row.get(f"f{k}_hz") or 0) for k in (1, 2, 3)]
            if all(values) and row["vowel"] in ("ah", "iy", "uw", "eh", "oa"):
                found[row["speaker"], row["vowel"]] = (values[0], values[1], values[2])
        return found


def speech(rng: np.random.Generator) -> tuple[list[Utterance], list[Utterance]]:
    """What synthesisers say that model people, and what espeak-ng says. Raises VOICE-SYNTH."""
    people: list[Utterance] = []
    for voice in track([v for v in FESTIVAL_VOICES if v not in UNHEARD], "Festival speaks"):
        people += synthesis.festival(_lines(voice in _ENGLISH, rng, _BY_PEOPLE), voice)
    for voice in track([v for v in FLITE_VOICES if v not in UNHEARD], "flite speaks"):
        people += [synthesis.flite(line, voice) for line in _lines(True, rng, _BY_PEOPLE)]
    espeak, formant = synthesis.espeak(), []
    for language in track(LANGUAGES, "espeak-ng speaks"):
        lines = synthesis.sentences(language[:2], "train")
        for _ in range(_BY_FORMANTS):
            shuffled = language[:2] != "ja" and rng.uniform() < 0.5
            text = synthesis.shuffled_words(lines, rng) if shuffled else str(rng.choice(lines))
            voice = language + str(rng.choice(VARIANTS))
            speed, pitch = int(rng.integers(110, 260)), int(rng.integers(15, 85))
            formant.append(espeak.say(text, voice, speed, pitch))
    return people, formant


def _lines(english: bool, rng: np.random.Generator, count: int) -> list[str]:
    languages = ["en"] if english else ["es", "ja-latin"]
    lines = [line for name in languages for line in synthesis.sentences(name, "train")]
    half = [str(line) for line in rng.choice(lines, min(count // 2, len(lines)), replace=False)]
    return half + [synthesis.shuffled_words(lines, rng) for _ in range(count - len(half))]


def mixer(
    vowels: Sequence[Vowel],
    measured: dict[tuple[str, str], tuple[float, float, float]],
    people: Sequence[Utterance],
    formant: Sequence[Utterance],
    stage: Stage,
) -> Mixer:
    by_people, by_formants = ([of_utterance(u) for u in said] for said in (people, formant))
    draws: list[Draw] = [
        _recorded(vowels, stage.importance),
        _spoken(by_people, stage.spread),
        _spoken(by_formants, stage.spread),
        _sung(list(measured.items())),
        lambda rng: [silence(int(rng.integers(100, 300)))],
    ]
    return Mixer(list(zip(stage.shares, draws, strict=True)), by_people)


def _recorded(vowels: Sequence[Vowel], importance: float) -> Draw:
    """Words of one speaker; every group of speakers is heard equally often."""
    groups: dict[str, dict[str, list[Piece]]] = {}
    for vowel in vowels:
        groups.setdefault(vowel.group, {}).setdefault(vowel.speaker, []).append(
            of_vowel(vowel, importance)
        )
    speakers = [list(group.values()) for group in groups.values()]

    def draw(rng: np.random.Generator) -> list[Piece]:
        group = speakers[rng.integers(len(speakers))]
        words = group[rng.integers(len(group))]
        factor = rng.uniform(0.92, 1.08)
        return [at_pitch(words[k], factor) for k in rng.integers(0, len(words), 4)]

    return draw


def _spoken(pieces: Sequence[Piece], spread: tuple[float, float]) -> Draw:
    def draw(rng: np.random.Generator) -> list[Piece]:
        return [at_pitch(pieces[int(rng.integers(len(pieces)))], rng.uniform(*spread))]

    return draw


def _sung(notes: list[tuple[tuple[str, str], tuple[float, float, float]]]) -> Draw:
    def draw(rng: np.random.Generator) -> list[Piece]:
        (_, vowel), measured = notes[rng.integers(len(notes))]
        return [silence(int(rng.integers(3, 30))), sung(rng, measured, vowel)]

    return draw


def fit(
    kept: Sequence[Vowel], folder: Path, seed: int, stages: Sequence[Stage], start: Recurrent | None
) -> Recurrent:
    """The same recordings and seed give the same network."""
    rng = np.random.default_rng(seed)
    people, formant = speech(rng)
    named = {vowel.speaker for vowel in kept}
    measured = {key: value for key, value in formants(folder).items() if key[0] in named}
    network = start
    for stage in stages:
        source = mixer(kept, measured, people, formant, stage)
        network = _stage(source, stage, network, rng)
    assert network is not None
    return network


def _stage(
    source: Mixer, stage: Stage, network: Recurrent | None, rng: np.random.Generator
) -> Recurrent:
    with Progress() as bar:
        mixing = bar.add_task("Mixing sequences", total=stage.sequences)
        made = source.sequences(stage.sequences, rng, lambda: bar.advance(mixing))
        task = bar.add_task("Back-propagation through time", total=stage.iterations)
        recent: list[float] = []

        def progress(loss: float) -> None:
            recent.append(loss)
            shown = f"Back-propagation, loss {np.mean(recent[-100:]):.3f}"
            bar.update(task, advance=1, description=shown)

        weights = None if network is None else {k: v.copy() for k, v in vars(network).items()}
        return train(
            made, stage.iterations, rng, rate=stage.rate, progress=progress, weights=weights
        )


def judged(network: Recurrent, unheard: Sequence[Vowel], seed: int) -> dict[str, Any]:
    """How well speakers are heard whom the network was not trained on."""
    rng = np.random.default_rng(0)
    pink = [in_pink_noise(vowel, 10.0, rng) for vowel in unheard]
    clean, noisy = (evaluate_default(part, network) for part in (unheard, pink))
    return {
        "seed": seed,
        "speakers": clean["speakers"],
        "frame_accuracy": round(clean["frame_accuracy"], 4),
        "groups": {name: round(part, 4) for name, part in clean["groups"].items()},
        "pink_10_db": round(noisy["frame_accuracy"], 4),
        "calibrated": round(evaluate_calibrated(unheard, network)["frame_accuracy"], 4),
    }


def _note(run: dict[str, Any], path: Path) -> None:
    """Adds a run to a file of them, in the place of an older one with its seed."""
    runs = json.loads(path.read_text("utf-8"))["runs"] if path.is_file() else []
    runs = sorted([r for r in runs if r["seed"] != run["seed"]] + [run], key=lambda r: r["seed"])
    write_atomically(path, (json.dumps({"runs": runs}, indent=1) + "\n").encode())


def _asked(vowels: Sequence[Vowel]) -> list[Vowel]:
    """The five, "haid" only where "head" is missing, as `evaluate` does."""
    steady = {vowel.speaker for vowel in vowels if vowel.vowel == "eh"}
    return [v for v in vowels if v.mouth and not (v.vowel == "ei" and v.speaker in steady)]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, help="of vowels.csv")
    parser.add_argument("--out", type=Path, help="where the network goes")
    parser.add_argument("--leave-out", type=int, default=0, help="speakers kept for measuring")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--report", type=Path, help="a JSON file that gets what was measured")
    parser.add_argument("--start", type=Path, help="a network: only the last stage is done")
    parser.add_argument("--quick", action="store_true", help="one shorter stage, for measuring")
    given = parser.parse_args(arguments)
    console = Console()
    try:
        vowels = all_vowels(given.folder)
        speakers = sorted({vowel.speaker for vowel in vowels})
        np.random.default_rng(given.seed).shuffle(speakers)
        out = set(speakers[: given.leave_out])
        kept = [vowel for vowel in vowels if vowel.speaker not in out]
        start = recurrent.load(given.start) if given.start else None
        stages = (QUICK,) if given.quick else STAGES[-1:] if start else STAGES
        network = fit(kept, given.folder, given.seed, stages, start)
        if given.out is not None:
            recurrent.save(network, given.out)
        unheard = _asked([vowel for vowel in vowels if vowel.speaker in out])
        if unheard:
            run = judged(network, unheard, given.seed)
            console.print(run)
            if given.report is not None:
                _note(run, given.report)
    except HypermaskError as error:
        console.print(f"{error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
