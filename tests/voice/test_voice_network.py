"""The 20-20-13 network, its file, and the reference shapes it interpolates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.voice import network
from hypermask.voice.shapes import (
    SHAPE_NAMES,
    Interpolation,
    nearest_shape,
    reference_shapes,
)

PACKAGE_DATA = network.Path(network.__file__).parent / "data"


def any_network(seed: int = 0) -> network.Network:
    rng = np.random.default_rng(seed)
    sizes = [(20,), (20,), (20, 20), (20,), (20, 13), (13,)]
    parts = [rng.uniform(0.5, 1.5, size).astype(np.float32).astype(float) for size in sizes]
    return network.Network(*parts, shapes=np.eye(6, 13))


def test_the_network_is_20_20_13():
    assert any_network()(np.zeros((7, 20))).shape == (7, 13)


def test_it_computes_a_sigmoid_layer_and_a_linear_one():
    net = any_network()
    x = net.input_mean + np.linspace(-0.1, 0.1, 20)
    scaled = (x - net.input_mean) / net.input_scale
    hidden = 1 / (1 + np.exp(-(scaled @ net.hidden_weights + net.hidden_bias)))
    np.testing.assert_allclose(net(x[None])[0], hidden @ net.output_weights + net.output_bias)


def test_a_saved_network_is_loaded_as_it_was(tmp_path):
    network.save(any_network(), tmp_path / "n.npz")
    loaded = network.load(tmp_path / "n.npz")
    x = np.random.default_rng(2).standard_normal((5, 20))
    np.testing.assert_array_equal(loaded(x), any_network()(x))


def test_what_is_no_network_file_is_named(tmp_path):
    path = tmp_path / "n.npz"
    with pytest.raises(DataError, match="VOICE-NET"):
        network.load(path)
    network.save(any_network(), path)
    for length in (0, 10, 300, path.stat().st_size - 30):
        (tmp_path / "cut.npz").write_bytes(path.read_bytes()[:length])
        with pytest.raises(DataError, match="VOICE-NET"):
            network.load(tmp_path / "cut.npz")


def test_another_version_or_size_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "n.npz"
    monkeypatch.setattr(network, "VERSION", 99)
    network.save(any_network(), path)
    monkeypatch.undo()
    with pytest.raises(DataError, match=r"VOICE-NET.*version 99"):
        network.load(path)
    network.save(replace(any_network(), hidden_bias=np.zeros(7)), path)
    with pytest.raises(DataError, match=r"VOICE-NET.*hidden_bias"):
        network.load(path)
    network.save(replace(any_network(), hidden_bias=np.full(20, np.nan)), path)
    with pytest.raises(DataError, match=r"VOICE-NET.*hidden_bias"):
        network.load(path)


@pytest.mark.parametrize("model", ["default", "paper"])
def test_the_shipped_weights_are_small_and_sound(model):
    assert (PACKAGE_DATA / f"{model}.npz").stat().st_size < 50_000
    assert np.isfinite(network.shipped(model)(np.zeros((1, 20)))).all()


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
