"""Back-propagation learns, and learns the same each time."""

from __future__ import annotations

import numpy as np
import pytest
from voice_sounds import DATA, needs_data

from hypermask.voice import network, train
from hypermask.voice.backprop import train as backpropagate
from hypermask.voice.examples import RECIPES, Examples, examples
from hypermask.voice.shapes import CLOSED, nearest_shape, reference_shapes
from hypermask.voice.vowels import read_table, read_vowel


def six_clouds(seed: int = 0) -> Examples:
    """Cepstra of six kinds, well apart."""
    rng = np.random.default_rng(seed)
    kind = rng.integers(0, 6, 600)
    centres = np.random.default_rng(9).standard_normal((6, 20))
    return Examples(centres[kind] + 0.2 * rng.standard_normal((600, 20)), kind)


def test_it_learns_what_can_be_told_apart():
    shapes = reference_shapes()
    net = backpropagate(six_clouds(), shapes, 500, np.random.default_rng(0))
    unheard = six_clouds(seed=1)
    outputs = net(unheard.cepstra)
    assert np.mean(nearest_shape(outputs, shapes) == unheard.shape) > 0.99
    assert np.abs(outputs - shapes[unheard.shape]).mean() < 0.1 * np.ptp(shapes)


def test_the_same_seed_gives_the_same_network():
    one, same, other = (
        backpropagate(six_clouds(), reference_shapes(), 20, np.random.default_rng(seed))
        for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one.hidden_weights, same.hidden_weights)
    assert not np.array_equal(one.hidden_weights, other.hidden_weights)


def some_vowels(speakers: set[str]):
    table = DATA / "vowels" / "vowels.csv"
    return [read_vowel(table, row) for row in read_table(table) if row["speaker"] in speakers]


@needs_data
def test_noise_is_taught_as_the_closed_mouth_and_every_vowel_as_its_own():
    taught = examples(some_vowels({"m01"}), RECIPES["paper"], np.random.default_rng(0))
    assert set(np.unique(taught.shape)) == set(range(6))
    assert np.sum(taught.shape == CLOSED) > 1000
    assert taught.cepstra.shape == (len(taught.shape), 20)


@needs_data
def test_the_noisy_recipe_teaches_more():
    vowels = some_vowels({"m01"})
    counts = [
        len(examples(vowels, RECIPES[name], np.random.default_rng(0)).shape)
        for name in ("paper", "default")
    ]
    assert counts[1] > counts[0]


@needs_data
def test_unheard_speakers_are_understood():
    taught = some_vowels({f"{group}{n:02}" for group in "mwbg" for n in range(1, 9)})
    unheard = some_vowels({"m20", "w20", "m21", "w21"})
    net = train.fit(taught, RECIPES["paper"], 1000, seed=0)
    assert train.accuracy(net, unheard, margin=0.2) > 0.75


@needs_data
def test_the_default_holds_in_noise_where_the_paper_does_not():
    vowels = some_vowels({"m01", "w01", "b01", "g01"})
    clean, noisy = (
        train.accuracy(network.shipped(name), vowels, pink_db=10.0) for name in ("paper", "default")
    )
    assert noisy > clean + 0.2


def test_the_tool_names_a_missing_corpus(tmp_path, capsys):
    assert train.main([str(tmp_path)]) == 1
    assert "VOICE-CSV" in capsys.readouterr().out


@pytest.mark.parametrize("recipe", ["default", "paper"])
def test_the_shipped_networks_know_their_own_shapes(recipe):
    net = network.shipped(recipe)
    np.testing.assert_array_equal(nearest_shape(net.shapes, net.shapes), range(6))
