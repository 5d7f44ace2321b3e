"""Trains the data base of the paper mode: a 20-20-13 network for every speaker of the recordings.

    python -m hypermask.voice.paper_train ../shared/data/vowels \\
        --out daemon/hypermask/voice/data/paper.npz
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from hypermask.errors import HypermaskError
from hypermask.voice import paper_base
from hypermask.voice.backprop import train
from hypermask.voice.evaluate import evaluate_paper
from hypermask.voice.examples import examples
from hypermask.voice.network import Network
from hypermask.voice.paper_base import PaperBase
from hypermask.voice.shapes import reference_shapes
from hypermask.voice.vowels import Vowel, cepstra_of, read_table, read_vowel

ITERATIONS = 1200


def fit(vowels: Sequence[Vowel], iterations: int, seed: int) -> PaperBase:
    """The same recordings and seed give the same data base."""
    speakers = sorted({vowel.speaker for vowel in vowels})
    nets = []
    for number, speaker in enumerate(track(speakers, "Back-propagation, a network a speaker")):
        rng = np.random.default_rng([seed, number])
        own = [vowel for vowel in vowels if vowel.speaker == speaker]
        nets.append(train(examples(own, rng), reference_shapes(), iterations, rng))
    return _usual(joined(speakers, nets), vowels)


def joined(speakers: Sequence[str], nets: Sequence[Network]) -> PaperBase:
    names = [field.name for field in fields(Network) if field.name != "shapes"]
    weights = {name: np.stack([getattr(net, name) for net in nets]) for name in names}
    return PaperBase(tuple(speakers), weights, nets[0].shapes, speakers[0])


def _usual(base: PaperBase, vowels: Sequence[Vowel]) -> PaperBase:
    """With whom the speakers together are served best."""
    errors = np.zeros(len(base.names))
    for speaker in base.names:
        own = cepstra_of([vowel for vowel in vowels if vowel.speaker == speaker])
        errors += base.errors(own)
    usual = base.names[int(np.argmin(errors))]
    return PaperBase(base.names, base.weights, base.shapes, usual)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, help="of vowels.csv")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--iterations", type=int, default=ITERATIONS)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    console = Console()
    try:
        table = given.folder / "vowels.csv"
        vowels = [read_vowel(table, row) for row in track(read_table(table), "Reading recordings")]
        base = fit(vowels, given.iterations, given.seed)
        paper_base.save(base, given.out)
        result = evaluate_paper(vowels, paper_base.load(given.out))
        console.print(f"best of the others' by five vowels: {result['frame_accuracy']:.1%}")
    except HypermaskError as error:
        console.print(f"{error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
