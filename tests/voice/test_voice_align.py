"""The scores of connected speech mean what they say."""

from __future__ import annotations

import json

import numpy as np
import pytest
from voice_sounds import DATA, needs_data

from hypermask.errors import DataError
from hypermask.voice.align import Track, align, report, visemes_of
from hypermask.voice.phones import read_phones, write_phones
from hypermask.voice.synthesis import Phone
from hypermask.voice.visemes import CLASSES, VISEMES, basis_shapes, class_weights

LABELS = {"lips": "P"}
MOUTHS = dict(zip(CLASSES, class_weights() @ basis_shapes(), strict=True))
SENTENCE = [(0.4, "silence"), (0.2, "aa"), (0.1, "lips"), (0.2, "iy"), (0.1, "sh"), (0.2, "uw"),
            (0.1, "teeth"), (0.2, "oa"), (0.5, "silence")]  # fmt: skip


def phones(of=SENTENCE):
    ends = np.cumsum([duration for duration, _ in of])
    return [
        Phone(float(end - duration), float(end), LABELS.get(name, name), [CLASSES.index(name)])
        for end, (duration, name) in zip(ends, of, strict=True)
    ]


def track(late_s=0.0, latency_s=0.02, mouths=MOUTHS, of=SENTENCE) -> Track:
    spoken = phones(of)
    times = np.arange(0, spoken[-1].end_s, 0.01) + 0.005
    said = [next((p for p in spoken if t - late_s < p.end_s), spoken[0]) for t in times]
    shown = [mouths[CLASSES[phone.classes[0]]] for phone in said]
    return Track(times, np.array(shown), latency_s)


def test_a_perfect_mouth_is_perfect():
    scores = report([(track(), phones())])
    assert scores["frame_accuracy"] > 0.96
    assert scores["macro_f1"] > 0.93
    assert scores["closure_recall"] == 1
    assert scores["false_opening"] == 0
    assert set(scores["f1"]) == {"closed", "a", "i", "u", "o", "teeth", "rounded"}


def test_the_delay_counts_from_the_closure_to_when_the_mouth_exists():
    for late_s in (0.0, 0.03):
        scores = report([(track(late_s, latency_s=0.02), phones())])
        assert scores["closure_delay_ms"] == pytest.approx(1e3 * late_s + 25, abs=6)


def test_a_mouth_that_does_not_close_is_seen():
    scores = report([(track(mouths={**MOUTHS, "lips": MOUTHS["t"]}), phones())])
    assert scores["closure_recall"] == 0
    assert scores["closure_delay_ms"] is None


def test_a_mouth_that_is_open_in_a_pause_is_seen():
    scores = report([(track(mouths={**MOUTHS, "silence": MOUTHS["eh"]}), phones())])
    assert scores["false_opening"] == 1


def test_a_mouth_may_take_a_moment_to_close_in_a_pause_but_no_longer():
    assert report([(track(late_s=0.08), phones())])["false_opening"] < 0.05
    assert report([(track(late_s=0.25), phones())])["false_opening"] > 0.2


def test_a_short_pause_is_not_judged():
    short = [(0.2, "silence"), (0.3, "aa"), (0.2, "silence")]
    assert report([(track(of=short), phones(short))])["false_opening"] is None


def test_chatter_is_seen():
    still = track()
    chattering = Track(still.time_s, still.parameters.copy(), 0.02)
    chattering.parameters[::2] *= 0.5
    both = [report([(one, phones())])["jitter"] for one in (still, chattering)]
    assert both[1] > 3 * both[0]


def test_softly_spoken_vowels_are_still_those_vowels():
    for name in ("a", "i", "u", "e", "o"):
        whole = MOUTHS[{"a": "aa", "i": "iy", "u": "uw", "e": "eh", "o": "oa"}[name]]
        assert VISEMES[visemes_of(0.8 * whole[None])[0]] == name


# --- phone files


def test_phones_are_written_and_read(tmp_path):
    arpabet = [Phone(0.0, 0.1, "SIL", []), Phone(0.1, 0.3, "AA", []), Phone(0.3, 0.4, "P", [])]
    write_phones(arpabet, tmp_path / "p.json")
    found = read_phones(tmp_path / "p.json")
    assert [p.label for p in found] == ["SIL", "AA", "P"]
    assert found[1].end_s == pytest.approx(0.3)
    assert [CLASSES[p.classes[0]] for p in found] == ["silence", "aa", "lips"]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "cut short or not JSON"),
        ('{"w": [{"b": 0', "cut short or not JSON"),
        ("[" * 100_000, "cut short or not JSON"),
        ("{}", "without begin, duration or label"),
        ('{"w": []}', "no phones"),
        ('{"w": [{"b": 0, "d": "x", "t": "AA"}]}', "without begin"),
        ('{"w": [{"b": 0, "d": -1, "t": "AA"}]}', "impossible times"),
        ('{"w": [{"b": NaN, "d": 1, "t": "AA"}]}', "impossible times"),
        ('{"w": [{"b": 0, "d": 1, "t": "?"}]}', "neither ARPAbet nor IPA"),
        ("7", "without begin"),
    ],
)
def test_a_bad_file_of_phones_is_named_with_its_fault(tmp_path, text, why):
    (tmp_path / "p.json").write_text(text)
    with pytest.raises(DataError, match=f"VOICE-PHONES.*{why}"):
        read_phones(tmp_path / "p.json")
    with pytest.raises(DataError, match=r"VOICE-PHONES.*does not exist"):
        read_phones(tmp_path / "none.json")


@needs_data
def test_a_read_sentence_is_scored():
    speech = DATA / "speech"
    result = align(speech / "austen-0880.wav", speech / "austen-0880.phone.json")
    assert result["frame_accuracy"] > 0.45
    assert result["latency_ms"] < 25
    json.dumps(result, allow_nan=False)
