"""Trains the network that ships with the program, and measures the recipe on unheard speakers.

python -m hypermask.voice.train ../shared/data/vowels --out daemon/hypermask/voice/data/default.npz
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress, track

from hypermask.errors import HypermaskError
from hypermask.voice import network, noise
from hypermask.voice.backprop import train
from hypermask.voice.examples import RECIPES, Recipe, examples
from hypermask.voice.lpc import cepstra
from hypermask.voice.network import Network
from hypermask.voice.shapes import SHAPE_NAMES, nearest_shape, reference_shapes
from hypermask.voice.vowels import Vowel, read_table, read_vowel

_FOLDS = 4


def corpus(folder: Path) -> list[Vowel]:
    """All recordings of the five vowels. Raises `DataError` VOICE-CSV or VOICE-WAV."""
    table = folder / "vowels.csv"
    return [read_vowel(table, row) for row in track(read_table(table), "Reading recordings")]


def fit(vowels: Sequence[Vowel], recipe: Recipe, iterations: int, seed: int) -> Network:
    """The same vowels, recipe and seed give the same network."""
    rng = np.random.default_rng(seed)
    taught = examples(vowels, recipe, rng)
    with Progress() as bar:
        task = bar.add_task("Back-propagation", total=iterations)
        return train(taught, reference_shapes(), iterations, rng, lambda: bar.advance(task))


def accuracy(
    net: Network, vowels: Sequence[Vowel], margin: float = 0.0, pink_db: float | None = None
) -> float:
    """Part of the 32 ms frames of the steady vowels whose nearest reference shape is right."""
    rng = np.random.default_rng(0)
    right = total = 0
    for vowel in (v for v in vowels if v.vowel != "ei"):
        heard = vowel
        if pink_db is not None:
            level = float(np.sqrt(np.mean(vowel.samples[vowel.start : vowel.end] ** 2)))
            pink = noise.coloured(rng, len(vowel.samples), 1.0)
            mixed = noise.add(vowel.samples, pink, pink_db, level)
            heard = Vowel(**{**vars(vowel), "samples": mixed})
        found = nearest_shape(net(cepstra(heard.frames(margin=margin))), net.shapes)
        right += int(np.sum(found == SHAPE_NAMES.index(vowel.mouth)))
        total += len(found)
    return right / total


def leave_speakers_out(
    vowels: Sequence[Vowel], recipe: Recipe, iterations: int, seed: int
) -> dict[str, float]:
    """Four-fold cross-validation over speakers; every frame is judged by a net that never heard
    its speaker."""
    speakers = sorted({vowel.speaker for vowel in vowels})
    np.random.default_rng(seed).shuffle(speakers)
    figures: dict[str, list[float]] = {"nucleus": [], "middle": [], "pink 10 dB": []}
    for fold in range(_FOLDS):
        out = set(speakers[fold::_FOLDS])
        net = fit([v for v in vowels if v.speaker not in out], recipe, iterations, seed)
        unheard = [v for v in vowels if v.speaker in out]
        figures["nucleus"].append(accuracy(net, unheard))
        figures["middle"].append(accuracy(net, unheard, margin=0.2))
        figures["pink 10 dB"].append(accuracy(net, unheard, pink_db=10.0))
    return {name: float(np.mean(values)) for name, values in figures.items()}


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m hypermask.voice.train", description=__doc__)
    parser.add_argument("folder", type=Path, help="holds vowels.csv and the recordings it names")
    parser.add_argument("--out", type=Path, help="the npz file to write")
    parser.add_argument("--recipe", choices=sorted(RECIPES), default="default")
    parser.add_argument("--iterations", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--validate", type=int, default=0, metavar="SEEDS", help="leave speakers out"
    )
    options = parser.parse_args(arguments)
    console = Console()
    recipe = RECIPES[options.recipe]
    try:
        vowels = corpus(options.folder)
        for seed in range(options.validate):
            result = leave_speakers_out(vowels, recipe, options.iterations, seed)
            figures = ", ".join(f"{name} {value:.2%}" for name, value in result.items())
            console.print(f"unheard speakers, seed {seed}: {figures}")
        if options.out:
            network.save(fit(vowels, recipe, options.iterations, options.seed), options.out)
            console.print(f"wrote {options.out} ({options.out.stat().st_size} bytes)")
    except HypermaskError as error:
        console.print(str(error), style="red", highlight=False)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
