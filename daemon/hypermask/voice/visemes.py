"""Visemes: what the network tells apart, the mouth of each, and the phones that belong to it.

The network hears `CLASSES`, finer than a mouth is. Each has a mouth, an interpolation of the six
reference shapes (PAPERS A5) or of the two that vowels lack: lower lip at the teeth, lips rounded
and parted. Scores use the nine coarser `VISEMES` (as many as Luo and King 1994 have).
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hypermask.voice.shapes import SHAPE_NAMES, reference_shapes

_Floats = NDArray[np.float64]

VISEMES = ("closed", "a", "i", "u", "e", "o", "teeth", "rounded", "narrow")
CLOSED = 0

# Lower lip drawn in under the upper teeth; parameters as in `hypermask.face.mouth`.
TEETH: _Floats = np.array(
    [0.10, 0.02, 0.14, 0.02, 0.03, -0.14, -0.02, -0.10, -0.03, 0.02, 0.02, 0.0, 0.26]
)
# The lips of "sh": pushed forward like /u/, but parted.
ROUNDED: _Floats = np.array(
    [0.12, 0.30, 0.12, 0.32, -0.24, 0.32, -0.26, 0.28, -0.10, -0.01, -0.26, 0.14, 0.20]
)
BASIS = (*SHAPE_NAMES, "teeth", "rounded")
"""The mouths that all others mix: weights (8,) -> parameters (13,)."""

_CLASS_MOUTHS: dict[str, tuple[str, dict[str, float]]] = {
    # class: (viseme, weights of the basis; what is missing to 1 is the closed mouth)
    "silence": ("closed", {}),
    "lips": ("closed", {}),
    "teeth": ("teeth", {"teeth": 1.0}),
    "w": ("rounded", {"u": 0.75, "rounded": 0.25}),
    "sh": ("rounded", {"rounded": 1.0}),
    "r": ("rounded", {"rounded": 0.65, "e": 0.2}),
    "th": ("narrow", {"e": 0.35, "i": 0.2}),
    "s": ("narrow", {"i": 0.45, "e": 0.1}),
    "t": ("narrow", {"i": 0.25, "e": 0.3}),
    "l": ("narrow", {"i": 0.15, "e": 0.4}),
    "k": ("narrow", {"i": 0.2, "e": 0.35}),
    "j": ("narrow", {"i": 0.7}),
    "aa": ("a", {"a": 1.0}),
    "ae": ("e", {"a": 0.4, "e": 0.6}),
    "ah": ("a", {"a": 0.6, "e": 0.25}),
    "schwa": ("e", {"e": 0.55, "a": 0.1}),
    "er": ("e", {"e": 0.5, "rounded": 0.3}),
    "eh": ("e", {"e": 1.0}),
    "ih": ("i", {"i": 0.55, "e": 0.35}),
    "iy": ("i", {"i": 1.0}),
    "uh": ("u", {"u": 0.6, "o": 0.2}),
    "uw": ("u", {"u": 1.0}),
    "oa": ("o", {"o": 1.0}),
    "ao": ("o", {"o": 0.65, "a": 0.3}),
    "ue": ("u", {"u": 0.85, "i": 0.1}),
}
CLASSES = tuple(_CLASS_MOUTHS)
VISEME_OF_CLASS: NDArray[np.intp] = np.array(
    [VISEMES.index(viseme) for viseme, _ in _CLASS_MOUTHS.values()], np.intp
)
LIPS, SILENCE = CLASSES.index("lips"), CLASSES.index("silence")
CLASS_OF_VOWEL = {
    "ah": "aa", "iy": "iy", "uw": "uw", "eh": "eh", "oa": "oa", "ae": "ae", "aw": "ao",
    "er": "er", "ih": "ih", "oo": "uh", "uh": "ah", "ei": "eh",
}  # fmt: skip
"""Hillenbrand's names of the vowels."""


def class_weights() -> _Floats:
    """(classes, 8): the mouth of each class as weights of `BASIS`, rows sum to 1."""
    weights = np.zeros((len(CLASSES), len(BASIS)))
    for row, (_, parts) in zip(weights, _CLASS_MOUTHS.values(), strict=True):
        for name, weight in parts.items():
            row[BASIS.index(name)] = weight
        row[CLOSED] = 1.0 - row.sum()
    return weights


def basis_shapes(shapes: _Floats | None = None) -> _Floats:
    """(8, 13): a face's own six shapes (6, 13), and the two consonants' beside them."""
    own = reference_shapes() if shapes is None else shapes
    return np.concatenate([own, np.stack([TEETH, ROUNDED]) + own[CLOSED]])


_ARPABET = {
    "SIL": "silence", "P": "lips", "B": "lips", "M": "lips", "F": "teeth", "V": "teeth", "W": "w",
    "SH": "sh", "ZH": "sh", "CH": "sh", "JH": "sh", "R": "r", "TH": "th", "DH": "th", "S": "s",
    "Z": "s", "T": "t", "D": "t", "N": "t", "L": "l", "K": "k", "G": "k", "NG": "k", "Y": "j",
    "AA": "aa", "AE": "ae", "AH": "ah", "ER": "er", "EH": "eh", "IH": "ih", "IY": "iy", "UH": "uh",
    "UW": "uw", "OW": "oa", "AO": "ao", "EY": "eh ih", "AY": "aa ih", "AW": "aa uh", "OY": "ao ih",
    "HH": "h", "AX": "schwa", "AXR": "er", "IX": "ih", "DX": "t", "EL": "l", "EM": "lips",
    "EN": "t", "PAU": "silence", "SP": "silence", "H#": "silence", "<SIL>": "silence",
    "NSN": "silence", "+SPN+": "silence", "+NSN+": "silence", "BRTH": "silence",
}  # fmt: skip
_IPA = {
    "p": "lips", "b": "lips", "m": "lips", "β": "lips", "ɸ": "lips", "f": "teeth", "v": "teeth",
    "ʋ": "teeth", "ɱ": "teeth", "w": "w", "ʍ": "w", "ɥ": "w", "ʃ": "sh", "ʒ": "sh", "ɕ": "sh",
    "ʑ": "sh", "ʂ": "sh", "ʐ": "sh", "ɹ": "r", "ɻ": "r", "θ": "th", "ð": "th", "s": "s", "z": "s",
    "t": "t", "d": "t", "n": "t", "ɾ": "t", "ɽ": "t", "r": "t", "ɲ": "j", "l": "l", "ɫ": "l",
    "ɭ": "l",
    "ʎ": "j", "k": "k", "g": "k", "ɡ": "k", "ŋ": "k", "ɴ": "k", "x": "k", "ɣ": "k", "χ": "k",
    "ʁ": "k", "ʀ": "k", "ç": "k", "c": "k", "ɟ": "k", "q": "k", "j": "j", "ʝ": "j", "h": "h",
    "ɦ": "h", "a": "aa", "ɑ": "aa", "ɐ": "ah", "æ": "ae", "ʌ": "ah", "ə": "schwa",
    "ɚ": "er", "ɜ": "er", "ɝ": "er", "e": "eh", "ɛ": "eh", "ɪ": "ih", "ᵻ": "ih", "ɨ": "ih",
    "i": "iy", "ʊ": "uh", "ɯ": "uw", "u": "uw", "ʉ": "uw", "o": "oa", "ɤ": "oa", "ɔ": "ao",
    "ɒ": "ao", "y": "ue", "ʏ": "ue", "ø": "ue", "œ": "ue", "ɘ": "schwa", "ɵ": "oa",
}  # fmt: skip
_FESTIVAL = {  # the sets of Italian, Finnish, Czech and Catalan voices, without length and stress
    "#": "silence", "##": "silence", "_": "silence", "pau": "silence", "p": "lips", "b": "lips",
    "m": "lips", "f": "teeth", "v": "teeth", "w": "w",
    "S": "sh", "Z": "sh", "tS": "sh", "dZ": "sh", "ch": "sh",
    "sh": "sh", "zh": "sh", "c~": "sh", "s~": "sh", "z~": "sh", "r~": "t", "t~": "t", "d~": "t",
    "N": "k", "s": "s", "z": "s",
    "ts": "s", "dz": "s", "c": "s", "t": "t", "d": "t", "n": "t", "r": "t", "rr": "t", "l": "l",
    "L": "j", "J": "j", "n~": "j", "n*": "k", "n1": "k", "k": "k", "g": "k", "x": "k", "ng": "k",
    "j": "j", "y": "j", "h": "h", "a": "aa", "e": "eh", "i": "iy", "o": "oa", "u": "uw", "E": "eh",
    "O": "ao", "ax": "schwa", "ä": "ae",
}  # fmt: skip


def classes_of(labels: Iterable[str]) -> list[list[int]]:
    """For each phone its class, or its two for a diphthong; [] for what is no known phone.

    ARPAbet (CMU, TIMIT, flite; upper or lower case, with or without stress) or IPA (espeak-ng),
    found out from all the labels together. /h/ has no mouth of its own: it gets that of what
    follows.
    """
    labels = list(labels)
    names = _arpabet(labels) if is_arpabet(labels) else [_ipa(label) for label in labels]
    return resolve(names)


def festival_classes(labels: Iterable[str]) -> list[list[int]]:
    """The same for the phones of Festival's Italian, Finnish, Czech and Catalan voices."""
    return resolve([_festival(label) for label in labels])


def resolve(names: list[str]) -> list[list[int]]:
    found: list[list[int]] = []
    following = ""
    for name in reversed(names):
        if name == "h":
            name = following.split(" ")[0] if following else "silence"
        found.append([CLASSES.index(part) for part in name.split()])
        following = name
    return found[::-1]


def is_arpabet(labels: list[str]) -> bool:
    known = [_stripped(label) in _ARPABET for label in labels if label]
    long = sum(len(_stripped(label)) == 2 for label in labels)
    return sum(known) >= 0.95 * max(len(known), 1) and (long > 0 or all(map(str.isupper, labels)))


def _stripped(label: str) -> str:
    return label.strip().rstrip("012").upper()


def _arpabet(labels: list[str]) -> list[str]:
    return [_ARPABET.get(_stripped(label), "") for label in labels]


def _ipa(label: str) -> str:
    if label.strip() in ("", "_", "_:", "sil", "pau", "SIL", "#", "|"):
        return "silence"
    parts = [_IPA[sign] for sign in unicodedata.normalize("NFD", label) if sign in _IPA]
    if not parts:
        return ""
    if parts == ["t", "sh"]:
        return "sh"
    if len(parts) > 1 and _is_vowel(parts[0]) and parts[1] != parts[0]:
        return " ".join(parts[:2])
    return parts[0] if _is_vowel(parts[0]) or len(parts) == 1 else parts[-1]


def _is_vowel(name: str) -> bool:
    return name != "h" and CLASSES.index(name) >= CLASSES.index("aa")


def _festival(label: str) -> str:
    bare = label.rstrip(":1")
    return _FESTIVAL.get(label, _FESTIVAL.get(bare, _FESTIVAL.get(bare.rstrip("*"), "")))
