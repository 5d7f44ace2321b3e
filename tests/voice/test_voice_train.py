"""Back-propagation learns, and learns the same each time."""

from __future__ import annotations

import numpy as np
import pytest
from voice_sounds import DATA, needs_data

from hypermask.voice import default_train, material, paper_train, synthesis
from hypermask.voice.backprop import train as backpropagate
from hypermask.voice.evaluate import evaluate_paper
from hypermask.voice.examples import Examples, examples
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
    taught = examples(some_vowels({"m01"}), np.random.default_rng(0))
    assert set(np.unique(taught.shape)) == set(range(6))
    assert np.sum(taught.shape == CLOSED) > 500
    assert taught.cepstra.shape == (len(taught.shape), 20)


@needs_data
def test_a_small_data_base_serves_a_stranger_better_than_a_random_member():
    vowels = some_vowels({"m01", "m02", "w01", "w02", "b01", "g02"})
    base = paper_train.fit(vowels, 300, seed=0)
    assert base.names == ("b01", "g02", "m01", "m02", "w01", "w02")
    chosen = evaluate_paper(vowels, base)["frame_accuracy"]
    strangers = some_vowels({"m06", "w06"})
    assert chosen > 0.5
    assert evaluate_paper(strangers, base)["frame_accuracy"] > 0.5


@needs_data
def test_every_speaker_is_left_out_once_and_every_group_by_thirds():
    table = DATA / "vowels" / "vowels.csv"
    vowels = [read_vowel(table, row) for row in read_table(table) if row["vowel"] == "ah"]
    parts = [material.left_out(vowels, part) for part in (1, 2, 3)]
    assert sum(map(len, parts)) == 100
    assert set().union(*parts) == {vowel.speaker for vowel in vowels}
    for group in "mwbg":
        sizes = [sum(name.startswith(group) for name in part) for part in parts]
        assert max(sizes) - min(sizes) <= 1


def test_voices_that_measure_are_never_trained_on_nor_chosen_by():
    taught = {*material.VARIANTS, *synthesis.FLITE_VOICES, *synthesis.FESTIVAL_VOICES}
    assert set(material.VALIDATION) < taught
    assert not set(material.UNHEARD) & {*material.VARIANTS, *material.VALIDATION}


@pytest.mark.parametrize("tool", [default_train, paper_train])
def test_the_tools_name_a_missing_corpus(tool, tmp_path, capsys):
    assert tool.main([str(tmp_path), "--out", str(tmp_path / "n.npz")]) == 1
    assert "VOICE-CSV" in capsys.readouterr().out
