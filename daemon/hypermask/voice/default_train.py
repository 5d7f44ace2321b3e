"""Trains the recurrent network that ships with the program, or measures it on unheard speakers.

    python -m hypermask.voice.default_train ../shared/data/vowels \\
        --out daemon/hypermask/voice/data/default.npz
    python -m hypermask.voice.default_train ../shared/data/vowels --leave-out 1 --seed 1 \\
        --report daemon/hypermask/voice/data/unheard.json

Needs Debian's espeak-ng, flite, festival, festvox-{us-slt-hts,kdlpc16k,kallpc16k,italp16k,itapc16k,
suopuhe-lj,suopuhe-mv,ca-ona-hts,czech-ph,czech-dita,czech-krb,czech-machac} and half an hour.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from hypermask.errors import HypermaskError
from hypermask.storage import write_atomically
from hypermask.voice import material, recurrent
from hypermask.voice.evaluate import evaluate_calibrated, evaluate_default, in_pink_noise
from hypermask.voice.recurrent import Recurrent
from hypermask.voice.recurrent_train import Lesson, train
from hypermask.voice.vowels import Vowel

FIRST, ITERATIONS = 2200, 1100
"""Of speech alone, which is the same whoever is left out; and then of speech and vowels."""
_FIRST_RATE, _RATE = 4e-3, 2.5e-3
_FIRST_SEED = 20


def fit(kept: Sequence[Vowel], folder: Path, seed: int, iterations: int) -> Recurrent:
    """The same recordings and seed give the same network."""
    people, formant = material.speech()
    spoken = material.speech_scenes(people, formant)
    first = [material.spoken_lesson(spoken)]
    network = taught(first, FIRST, np.random.default_rng(_FIRST_SEED), _FIRST_RATE)
    rng = np.random.default_rng(seed)
    every = material.lessons(spoken, kept, folder, people, rng)
    return taught(every, iterations, rng, _RATE, network)


def taught(
    lessons: Sequence[Lesson],
    iterations: int,
    rng: np.random.Generator,
    rate: float,
    start: Recurrent | None = None,
) -> Recurrent:
    with Progress() as bar:
        task = bar.add_task("Back-propagation through time", total=iterations)
        recent: list[float] = []

        def progress(loss: float) -> None:
            recent.append(loss)
            shown = f"Back-propagation, loss {np.mean(recent[-100:]):.3f}"
            bar.update(task, advance=1, description=shown)

        return train(lessons, iterations, rng, rate, progress, start)


def judged(
    network: Recurrent, unheard: Sequence[Vowel], seed: int, iterations: int
) -> dict[str, Any]:
    """How well speakers are heard whom the network was not trained on."""
    rng = np.random.default_rng(0)
    pink = [in_pink_noise(vowel, 10.0, rng) for vowel in unheard]
    clean, noisy = (evaluate_default(part, network) for part in (unheard, pink))
    return {
        "seed": seed,
        "iterations": iterations,
        "speakers": clean["speakers"],
        "frame_accuracy": round(clean["frame_accuracy"], 4),
        "groups": {name: round(part, 4) for name, part in clean["groups"].items()},
        "to_the_edges": round(clean["to_the_edges"]["frame_accuracy"], 4),
        "groups_to_the_edges": {
            name: round(part, 4) for name, part in clean["to_the_edges"]["groups"].items()
        },
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
    parser.add_argument(
        "--leave-out",
        type=int,
        choices=range(1, material.PARTS + 1),
        help="which third of the speakers is kept for measuring",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--iterations", type=int, default=ITERATIONS)
    parser.add_argument("--report", type=Path, help="a JSON file that gets what was measured")
    given = parser.parse_args(arguments)
    console = Console()
    try:
        vowels = material.all_vowels(given.folder)
        out = material.left_out(vowels, given.leave_out) if given.leave_out else set()
        kept = [vowel for vowel in vowels if vowel.speaker not in out]
        network = fit(kept, given.folder, given.seed, given.iterations)
        if given.out is not None:
            recurrent.save(network, given.out)
        unheard = _asked([vowel for vowel in vowels if vowel.speaker in out])
        if unheard:
            run = judged(network, unheard, given.seed, given.iterations)
            console.print(run)
            if given.report is not None:
                _note(run, given.report)
    except HypermaskError as error:
        console.print(f"{error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
