"""Training material: labels are where the sound is."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.voice import stage_noise, synthesis
from hypermask.voice.corpus import (
    FRAMES,
    LEAD,
    Mixer,
    Piece,
    at_pitch,
    led,
    of_utterance,
    silence,
    sung,
    timeline,
)
from hypermask.voice.synthesis import Phone, Utterance, sentences
from hypermask.voice.visemes import CLASSES, LIPS, SILENCE

needs_espeak = pytest.mark.skipif(shutil.which("espeak-ng") is None, reason="espeak-ng is absent")


def phones(*spans):
    at, found = 0.0, []
    for duration, name in spans:
        classes = [CLASSES.index(part) for part in name.split()]
        found.append(Phone(at, at + duration, name, classes))
        at += duration
    return found


def test_each_hop_has_the_class_of_its_middle():
    targets = timeline(phones((0.02, "silence"), (0.1, "aa ih"), (0.03, "lips")), 15)
    heard = [CLASSES[k] for k in targets.argmax(axis=1)]
    assert heard == ["silence"] * 2 + ["aa"] * 6 + ["ih"] * 4 + ["lips"] * 3


def test_the_tongues_consonants_leave_the_lips_to_the_vowels_and_the_lips_consonants_do_not():
    spoken = phones((0.1, "aa"), (0.1, "t"), (0.1, "uw"), (0.1, "lips"), (0.1, "iy"))
    mixed = led(timeline(spoken, 50))
    np.testing.assert_allclose(mixed.sum(axis=1), 1)
    t, aa, uw = mixed[15, [CLASSES.index(name) for name in ("t", "aa", "uw")]]
    assert t > 0.6
    assert aa > 0.05
    assert uw > 0.05
    assert mixed[35, LIPS] == pytest.approx(1)


def test_a_quicker_voice_keeps_its_labels():
    utterance = Utterance(np.ones(8000, np.float32), phones((0.2, "aa"), (0.3, "iy")), "x", "")
    quick = at_pitch(of_utterance(utterance), 1.25)
    assert len(quick.targets) * 160 == len(quick.samples) == 6400
    assert quick.targets.argmax(axis=1).tolist().count(CLASSES.index("aa")) == 16


@needs_espeak
def test_a_stop_of_espeak_begins_with_its_silence():
    utterance = synthesis.espeak().say("a papa and a paper", "en-us")
    for phone in (p for p in utterance.phones if p.label == "p"):
        begin = round(phone.begin_s * 16_000)
        closure = utterance.samples[begin + 80 : begin + 320]
        assert np.abs(closure).max() < 0.01


@needs_espeak
@pytest.mark.parametrize("language", ["en", "es", "de", "ja"])
def test_four_languages_are_spoken_and_understood(language):
    espeak = synthesis.espeak()
    voice = {"en": "en-us"}.get(language, language)
    for line in sentences(language, "test")[:3]:
        utterance = espeak.say(line, voice)
        known = [phone for phone in utterance.phones if phone.classes]
        assert len(known) >= 0.97 * len(utterance.phones)
        assert utterance.phones[-1].end_s == pytest.approx(
            len(utterance.samples) / 16_000, abs=0.01
        )


@needs_espeak
def test_a_voice_that_does_not_exist_is_named():
    with pytest.raises(DataError, match="VOICE-SYNTH"):
        synthesis.espeak().say("a", "xx-nowhere")


@pytest.mark.parametrize("language", ["en", "es", "de", "ja", "ja-latin"])
def test_no_test_sentence_is_trained_on(language):
    assert not set(sentences(language, "train")) & set(sentences(language, "test"))


@pytest.mark.parametrize("make", [*stage_noise.EVENTS, stage_noise.stage])
def test_noises_are_of_unit_level_and_finite(make):
    sound = make(np.random.default_rng(1), 32_000)
    assert sound.shape == (32_000,)
    assert np.isfinite(sound).all()
    assert np.sqrt(np.mean(sound**2)) == pytest.approx(1, rel=0.01)


def test_sequences_are_whole_and_the_same_each_time():
    notes = [(1.0, lambda rng: [sung(rng, (730.0, 1090.0, 2440.0), "ah"), silence(20)])]
    crowd = [sung(np.random.default_rng(0), (300.0, 870.0, 2240.0), "uw")]
    one, same = (Mixer(notes, crowd).sequences(3, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(one.features, same.features)
    assert one.features.shape[:2] == (3, FRAMES)
    assert np.isfinite(one.features).all()
    heard = set(np.unique(one.targets.argmax(axis=2)))
    assert heard == {SILENCE, CLASSES.index("aa")}


def test_a_single_word_begins_soon_and_its_answer_runs_ahead_of_it():
    count = 60
    sound = np.zeros(count * 160, np.float32)
    sound[20 * 160 : 40 * 160] = np.sin(0.3 * np.arange(20 * 160))
    targets = np.zeros((count, len(CLASSES)), np.float16)
    targets[:, SILENCE] = 1
    targets[20:40] = np.eye(len(CLASSES))[CLASSES.index("aa")]
    word = Piece(sound, targets, np.ones(count, np.float16), 0.5)
    mixer = Mixer([(1.0, lambda rng: [word])], [word], 80, single=True)
    made = mixer.sequences(20, np.random.default_rng(0))
    assert made.features.shape[:2] == (20, 80)
    said = made.targets.argmax(axis=2) == CLASSES.index("aa")
    assert said.sum(axis=1).tolist() == [20] * 20
    assert said.argmax(axis=1).min() == 20 - LEAD
    assert said.argmax(axis=1).max() < 32


def test_nonsense_has_the_same_syllables_in_both_scripts():
    latin, kana = (synthesis.nonsense(np.random.default_rng(3), script) for script in (False, True))
    assert latin.isascii()
    assert not kana.replace("、", "").replace(" ", "").isascii()
    assert latin.count(" ") == kana.count(" ") + kana.count("、")
