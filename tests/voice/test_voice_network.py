"""The paper's 20-20-13 network, its data base of speakers, and the reference shapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.voice import network, paper_base
from hypermask.voice.paper_train import joined
from hypermask.voice.shapes import (
    SHAPE_NAMES,
    Interpolation,
    nearest_shape,
    reference_shapes,
)


def any_network(seed: int = 0) -> network.Network:
    rng = np.random.default_rng(seed)
    sizes = [(20,), (20,), (20, 20), (20,), (20, 13), (13,)]
    parts = [rng.uniform(0.5, 1.5, size).astype(np.float16).astype(float) for size in sizes]
    return network.Network(*parts, shapes=reference_shapes())


def any_base() -> paper_base.PaperBase:
    return joined(["anna", "bert", "carl"], [any_network(seed) for seed in range(3)])


def test_the_network_is_20_20_13():
    assert any_network()(np.zeros((7, 20))).shape == (7, 13)


def test_it_computes_a_sigmoid_layer_and_a_linear_one():
    net = any_network()
    x = net.input_mean + np.linspace(-0.1, 0.1, 20)
    scaled = (x - net.input_mean) / net.input_scale
    hidden = 1 / (1 + np.exp(-(scaled @ net.hidden_weights + net.hidden_bias)))
    np.testing.assert_allclose(net(x[None])[0], hidden @ net.output_weights + net.output_bias)


def test_the_data_base_answers_as_each_of_its_networks():
    base, x = any_base(), np.random.default_rng(2).standard_normal((5, 20))
    for k, name in enumerate(base.names):
        np.testing.assert_allclose(base.outputs(x)[k], base.network(name)(x))


def test_the_network_that_makes_the_reference_shapes_best_is_chosen():
    """Three that always make one vowel's mouth: who says that vowel gets that network."""
    shapes = reference_shapes()
    nets = []
    for vowel in (1, 2, 5):
        still = np.zeros((20, 13))
        nets.append(replace(any_network(), output_weights=still, output_bias=shapes[vowel]))
    base = joined(["says a", "says i", "says o"], nets)
    x = np.zeros((4, 20))
    assert base.choose({"i": x}) == "says i"
    assert base.choose({"o": x}) == "says o"
    assert base.choose({"o": x}, without="says o") == "says a"


def test_a_saved_data_base_is_loaded_as_it_was(tmp_path):
    paper_base.save(any_base(), tmp_path / "b.npz")
    loaded = paper_base.load(tmp_path / "b.npz")
    x = np.random.default_rng(2).standard_normal((5, 20))
    np.testing.assert_array_equal(loaded.outputs(x), any_base().outputs(x))
    assert (loaded.names, loaded.usual) == (("anna", "bert", "carl"), "anna")
    with pytest.raises(DataError, match=r"VOICE-BASE.*dora"):
        loaded.network("dora")


def test_what_is_no_data_base_is_named(tmp_path):
    path = tmp_path / "b.npz"
    with pytest.raises(DataError, match="VOICE-NET"):
        paper_base.load(path)
    paper_base.save(any_base(), path)
    for length in (0, 10, 300, path.stat().st_size - 30):
        (tmp_path / "cut.npz").write_bytes(path.read_bytes()[:length])
        with pytest.raises(DataError, match="VOICE-NET"):
            paper_base.load(tmp_path / "cut.npz")


def test_another_version_or_size_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "b.npz"
    monkeypatch.setattr(paper_base, "VERSION", 99)
    paper_base.save(any_base(), path)
    monkeypatch.undo()
    with pytest.raises(DataError, match=r"VOICE-NET.*version 99"):
        paper_base.load(path)
    base = any_base()
    for broken in (np.zeros((3, 7)), np.full((3, 20), np.nan)):
        weights = {**base.weights, "hidden_bias": broken}
        paper_base.save(replace(base, weights=weights), path)
        with pytest.raises(DataError, match=r"VOICE-NET.*hidden_bias"):
            paper_base.load(path)


def test_a_hundred_speakers_are_shipped_in_one_small_file():
    base = paper_base.shipped()
    assert len(base.names) == 100
    assert base.usual in base.names
    path = paper_base.Path(paper_base.__file__).parent / "data" / "paper.npz"
    assert path.stat().st_size < 200_000


def test_every_shape_is_its_own_interpolation():
    shapes = reference_shapes()
    np.testing.assert_allclose(Interpolation(shapes).linear(shapes), np.eye(6), atol=1e-6)
    np.testing.assert_array_equal(nearest_shape(shapes, shapes), range(6))


def test_a_mixture_is_taken_apart_again():
    shapes = reference_shapes()
    mixture = np.array([0.2, 0.3, 0.0, 0.1, 0.4, 0.0])
    np.testing.assert_allclose(
        Interpolation(shapes).weights((mixture @ shapes)[None])[0], mixture, atol=1e-6
    )


def test_weights_stay_within_the_hull():
    wild = np.random.default_rng(0).standard_normal((100, 13))
    weights = Interpolation(reference_shapes()).weights(wild)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)


def test_the_mouth_nearest_to_a_shape_is_that_shape():
    shapes = reference_shapes()
    almost = 0.7 * shapes + 0.3 * shapes.mean(axis=0)
    assert [SHAPE_NAMES[k] for k in nearest_shape(almost, shapes)] == list(SHAPE_NAMES)
