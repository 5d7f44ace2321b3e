"""Phone labels of any aligner or synthesiser become visemes, and visemes become mouths."""

from __future__ import annotations

import numpy as np
import pytest

from hypermask.voice.shapes import reference_shapes
from hypermask.voice.visemes import (
    CLASSES,
    VISEME_OF_CLASS,
    VISEMES,
    basis_shapes,
    class_weights,
    classes_of,
    festival_classes,
)


def names(labels, of=classes_of):
    return [" ".join(CLASSES[k] for k in found) for found in of(labels)]


def test_arpabet_with_stress():
    assert names(["SIL", "P", "AA1", "S", "T", "ER0"]) == ["silence", "lips", "aa", "s", "t", "er"]


def test_flite_writes_small_letters():
    assert names(["pau", "sh", "iy", "b", "ow"]) == ["silence", "sh", "iy", "lips", "oa"]


def test_ipa_of_four_languages():
    assert names(["", "ʃ", "iː", "p", "t", "ʁ"]) == ["silence", "sh", "iy", "lips", "t", "k"]
    assert names(["β", "ɾ", "o̞", "ɯᵝ", "ũ"]) == ["lips", "t", "oa", "uw", "uw"]
    assert names(["tʃ", "pf", "yː"]) == ["sh", "teeth", "ue"]


def test_a_diphthong_has_two_mouths():
    assert names(["AY", "OW", "SIL"]) == ["aa ih", "oa", "silence"]
    assert names(["aɪ", "ə", "eː"]) == ["aa ih", "schwa", "eh"]


def test_h_has_the_mouth_of_what_follows():
    assert names(["HH", "UW", "SIL", "HH"]) == ["uw", "uw", "silence", "silence"]


def test_the_same_sign_is_another_phone_in_another_alphabet():
    assert names(["S", "IY", "SIL"])[0] == "s"
    assert names(["#", "S", "i1", "#"], festival_classes)[1] == "sh"


def test_what_is_no_phone_has_no_class():
    assert names(["AA", "IY", "UW", "P", "T", "S", "EH", "M", "N", "L", "OW", "K", "B", "D", "V",
                  "W", "SH", "R", "AE", "AH", "??"])[-1] == ""  # fmt: skip


def test_every_class_has_a_mouth_and_a_viseme():
    weights = class_weights()
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    assert (weights >= 0).all()
    assert set(VISEME_OF_CLASS) == set(range(len(VISEMES)))


def test_the_vowels_are_the_reference_shapes():
    mouths = class_weights() @ basis_shapes()
    for k, name in enumerate(("aa", "iy", "uw", "eh", "oa")):
        np.testing.assert_allclose(mouths[CLASSES.index(name)], reference_shapes()[k + 1])


@pytest.mark.parametrize("name", ["silence", "lips"])
def test_lips_that_are_shut_are_the_closed_mouth(name):
    mouth = class_weights()[CLASSES.index(name)] @ basis_shapes()
    np.testing.assert_array_equal(mouth, reference_shapes()[0])


def test_consonants_do_what_lips_do():
    mouths = dict(zip(CLASSES, class_weights() @ basis_shapes(), strict=True))
    assert mouths["teeth"][5] < -0.1  # the lower lip is drawn in
    assert mouths["sh"][3] > 0.2  # the lips are pushed forward
    assert mouths["w"][10] < -0.3  # the corners come in
    opening = {name: mouth[2] - mouth[4] for name, mouth in mouths.items()}
    assert opening["teeth"] < 0.15 < opening["t"] < opening["eh"] < opening["aa"]
