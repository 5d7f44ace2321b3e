"""Four mouths in a row, 13 parameters each, in about 15 bytes.

The mouths of speech lie close to what five vowels span and change little within 80 ms. So: an
orthogonal turn of the 13 parameters, whose first five axes the vowels span, a cosine transform over
the four moments, equal steps, and a code that is short for what is near 0. Any mouth can be sent;
one unlike speech costs more bits, or comes in coarser steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.stream.bits import BitReader, BitWriter, OutOfBits

Array = NDArray[np.float64]

PARAMETERS = 13
MOUTHS = 4
"""Mouths of one block."""
_STEP = 0.02
_COARSEST = 3
_LIMIT = 1.5

# Part of the format, version 1: another table is another version. Rows a, i, u, e, o.
_VOWELS = np.array(
    [
        [0.08, 0.0, 0.18, 0.0, -0.96, 0.0, -0.86, 0.02, -0.72, -0.14, -0.10, 0.0, 0.50],
        [0.07, -0.04, 0.12, -0.04, -0.24, -0.04, -0.20, -0.04, -0.10, 0.06, 0.18, -0.06, 0.38],
        [0.02, 0.34, -0.02, 0.36, -0.22, 0.36, -0.20, 0.34, -0.16, -0.02, -0.40, 0.16, 0.02],
        [0.07, -0.02, 0.14, -0.02, -0.44, -0.02, -0.38, -0.02, -0.28, 0.0, 0.10, -0.04, 0.42],
        [0.06, 0.24, 0.06, 0.26, -0.58, 0.26, -0.52, 0.24, -0.42, -0.08, -0.34, 0.12, 0.16],
    ]
)


def _turn() -> Array:
    """(13, 13) orthonormal rows, the same on every machine (Gram and Schmidt, in this order)."""
    rows: list[Array] = []
    for candidate in (*_VOWELS, *np.eye(PARAMETERS)):
        rest = candidate.copy()
        for row in (*rows, *rows):  # twice, for exactness
            rest -= (rest @ row) * row
        length = float(np.linalg.norm(rest))
        if length > 0.02 and len(rows) < PARAMETERS:
            rows.append(rest / length)
    return np.array(rows)


def _cosines() -> Array:
    """(4, 4) orthonormal cosine transform (DCT-II)."""
    moment = (np.arange(MOUTHS) + 0.5) * np.pi / MOUTHS
    table = np.cos(np.outer(np.arange(MOUTHS), moment)) * np.sqrt(2 / MOUTHS)
    table[0] /= np.sqrt(2)
    return np.asarray(table)


_TURN, _COSINES = _turn(), _cosines()
_ORDER = [(f, d) for f in range(MOUTHS) for d in range(5)] + [
    (f, d) for f in range(MOUTHS) for d in range(5, PARAMETERS)
]
_ROWS, _COLUMNS = (np.array(index) for index in zip(*_ORDER, strict=True))


def encode(mouths: ArrayLike, bits: int, finest: int = 0, details: int = MOUTHS) -> BitWriter:
    """Four mouths (4, 13) in at most `bits` bits (at least 8).

    finest: doublings of the step to begin with; details: how many of the four cosines are kept.
    """
    values = np.clip(np.nan_to_num(np.asarray(mouths, float)), -_LIMIT, _LIMIT)
    spectrum = _COSINES @ values @ _TURN.T
    spectrum[details:] = 0
    for doublings in range(finest, _COARSEST + 1):
        writer = _write(np.rint(spectrum / (_STEP * 2**doublings)).astype(int), doublings)
        if len(writer) <= bits:
            return writer
    return _fewer(spectrum, bits)


def decode(reader: BitReader) -> Array:
    """The four mouths (4, 13). Raises `OutOfBits`."""
    doublings, count = reader.get(2), reader.get(6)
    flat = np.zeros(len(_ORDER))
    at = -1
    for _ in range(count):
        at += 1 + reader.golomb(0)
        if at >= len(flat):
            raise OutOfBits("a mouth has more than 13 parameters")
        sign = -1 if reader.get(1) else 1
        flat[at] = sign * (1 + reader.golomb(1))
    spectrum = np.zeros((MOUTHS, PARAMETERS))
    spectrum[_ROWS, _COLUMNS] = flat * (_STEP * 2**doublings)
    return np.clip(_COSINES.T @ spectrum @ _TURN, -_LIMIT, _LIMIT)


def _write(steps: NDArray[np.int_], doublings: int) -> BitWriter:
    flat = steps[_ROWS, _COLUMNS]
    places = np.flatnonzero(flat)
    writer = BitWriter()
    writer.put(doublings, 2)
    writer.put(len(places), 6)
    before = -1
    for place in places.tolist():
        writer.golomb(place - before - 1, 0)
        writer.put(int(flat[place] < 0), 1)
        writer.golomb(abs(int(flat[place])) - 1, 1)
        before = place
    return writer


def _fewer(spectrum: Array, bits: int) -> BitWriter:
    """The coarsest steps, and only so many of the largest parts as fit."""
    steps = np.rint(spectrum / (_STEP * 2**_COARSEST)).astype(int)
    for least in sorted({*np.abs(steps).ravel().tolist(), 10**6}):
        writer = _write(np.where(np.abs(steps) >= least, steps, 0), _COARSEST)
        if len(writer) <= bits:
            return writer
    raise ValueError("a mouth needs 8 bits at least")
