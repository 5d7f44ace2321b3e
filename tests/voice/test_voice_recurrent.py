"""The recurrent network: its derivatives, its memory, its file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.voice import recurrent, recurrent_train
from hypermask.voice.features import FEATURES
from hypermask.voice.recurrent import LOOKAHEADS, UNITS
from hypermask.voice.recurrent_train import Lesson, Sequences
from hypermask.voice.visemes import CLASSES


def some_sequences(count=3, frames=12, seed=0) -> Sequences:
    rng = np.random.default_rng(seed)
    features = rng.standard_normal((count, frames, FEATURES)).astype(np.float32)
    targets = np.eye(len(CLASSES), dtype=np.float32)[rng.integers(0, len(CLASSES), (count, frames))]
    return Sequences(features, targets, rng.random((count, frames)).astype(np.float32))


def any_weights(seed=0):
    return recurrent_train.initial(some_sequences().features, np.random.default_rng(seed))


def any_network(seed=0) -> recurrent.Recurrent:
    return recurrent.Recurrent(**any_weights(seed))


@pytest.mark.parametrize("dropped", [False, True])
def test_the_gradients_are_those_of_the_loss(dropped):
    weights, data = any_weights(), some_sequences()
    masks = np.random.default_rng(5).integers(0, 2, (2, 3, UNITS)).astype(np.float32) * 1.5
    kept = (masks[0], masks[1]) if dropped else None
    parts = (data.features, data.targets, data.weight, kept)
    _, gradients = recurrent_train.loss_and_gradients(weights, *parts)
    assert set(gradients) == {name for name in weights if not name.startswith("input_")}
    for name, gradient in gradients.items():
        at = np.unravel_index(np.argmax(np.abs(gradient)), gradient.shape)
        kept, losses = weights[name][at], []
        for step in (0.01, -0.01):
            weights[name][at] = kept + step
            losses.append(recurrent_train.loss_and_gradients(weights, *parts)[0])
        weights[name][at] = kept
        assert gradient[at] == pytest.approx((losses[0] - losses[1]) / 0.02, rel=0.02)


def test_it_learns_what_was_said_before():
    """The answer is the sign that the first feature had two frames ago."""
    rng = np.random.default_rng(0)
    features = rng.standard_normal((64, 20, FEATURES)).astype(np.float32)
    before = np.roll(features[:, :, 0] > 0, 2, axis=1).astype(int)
    targets = np.eye(len(CLASSES), dtype=np.float32)[before]
    weight = np.ones((64, 20), np.float32)
    weight[:, :2] = 0
    losses: list[float] = []
    recurrent_train.train(
        [Lesson(Sequences(features, targets, weight), 32, 20)], 250, rng, progress=losses.append
    )
    assert np.mean(losses[-10:]) < 0.55 < 1.0 < losses[0]


def test_a_lesson_takes_every_sequence_once_before_any_twice():
    features = np.arange(6, dtype=np.float32)[:, None, None] * np.ones((6, 9, FEATURES), np.float32)
    sequences = Sequences(features, np.zeros((6, 9, len(CLASSES))), np.ones((6, 9)))
    batches = Lesson(sequences, 2, 4).batches(np.random.default_rng(0))
    taken = [next(batches) for _ in range(3)]
    assert sorted(np.concatenate([batch[0][:, 0, 0] for batch in taken])) == list(range(6))
    assert all(batch[0].shape == (2, 4, FEATURES) and batch[2].shape == (2, 4) for batch in taken)


def test_training_is_the_same_each_time():
    one, same = (
        recurrent_train.train(
            [Lesson(some_sequences(), 2, 12), Lesson(some_sequences(4, 20), 2, 8, 0.5)],
            3,
            np.random.default_rng(1),
        )
        for _ in range(2)
    )
    np.testing.assert_array_equal(one.second_state, same.second_state)


def test_training_and_show_compute_the_same():
    weights, data = any_weights(), some_sequences()
    network, state = recurrent.Recurrent(**weights), any_network().start(3)
    log = np.zeros(())
    for k in range(12):
        chances = network.posteriors(network.step(state, data.features[:, k]))
        log = log - np.sum(np.log(chances) * data.targets[:, k], axis=1) @ data.weight[:, k]
    alone = {**weights, "output": weights["output"].copy()}
    loss, _ = recurrent_train.loss_and_gradients(alone, data.features, data.targets, data.weight)
    late = 0.0
    for ahead in range(1, LOOKAHEADS):
        state = network.start(3)
        for k in range(12):
            hidden = network.step(state, data.features[:, k])
            if k >= ahead:
                chances = network.posteriors(hidden, ahead)
                said = np.sum(np.log(chances) * data.targets[:, k - ahead], axis=1)
                late -= said @ data.weight[:, k - ahead]
    assert (log + late) / (LOOKAHEADS * data.weight.sum()) == pytest.approx(loss, rel=1e-4)


def test_streams_do_not_hear_each_other():
    network, data = any_network(), some_sequences()
    together, alone = network.start(3), network.start(1)
    for k in range(12):
        both = network.step(together, data.features[:, k]).copy()
        one = network.step(alone, data.features[1:2, k])
    np.testing.assert_allclose(both[1], one[0], atol=1e-6)


def test_a_saved_network_is_loaded_as_it_was(tmp_path):
    recurrent.save(any_network(), tmp_path / "n.npz")
    loaded = recurrent.load(tmp_path / "n.npz")
    np.testing.assert_allclose(loaded.first_input, any_network().first_input, atol=1e-3)


def test_what_is_no_network_file_is_named(tmp_path, monkeypatch):
    path = tmp_path / "n.npz"
    with pytest.raises(DataError, match="VOICE-NET"):
        recurrent.load(path)
    recurrent.save(any_network(), path)
    for length in (0, 10, 300, path.stat().st_size - 30):
        (tmp_path / "cut.npz").write_bytes(path.read_bytes()[:length])
        with pytest.raises(DataError, match="VOICE-NET"):
            recurrent.load(tmp_path / "cut.npz")
    recurrent.save(replace(any_network(), output_bias=np.full(100, np.nan, np.float32)), path)
    with pytest.raises(DataError, match=r"VOICE-NET.*output_bias"):
        recurrent.load(path)
    monkeypatch.setattr(recurrent, "VERSION", 99)
    recurrent.save(any_network(), path)
    monkeypatch.undo()
    with pytest.raises(DataError, match=r"VOICE-NET.*version 99"):
        recurrent.load(path)


def test_the_shipped_weights_are_small_and_sound():
    path = recurrent.Path(recurrent.__file__).parent / "data" / "default.npz"
    assert path.stat().st_size < 300_000
    network = recurrent.shipped()
    hidden = network.step(network.start(), np.zeros((1, FEATURES), np.float32))
    assert network.posteriors(hidden).sum() == pytest.approx(1, abs=1e-4)
