"""Expression and head in few bits: intensities of action units, and a rigid pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.geometry import (
    FACING,
    Pose,
    rotation_from_vector,
    vector_from_rotation,
)
from hypermask.stream.bits import BitReader, BitWriter, OutOfBits

Array = NDArray[np.float64]

UNITS = 88
"""Halves of action units, left and right in turn (`face.action_units.NAMES`, format version 1)."""
_LEVELS = 31
_MOST = 15
_LEFT, _RIGHT, _BOTH = 1, 2, 3
_EMPTY = np.zeros(UNITS)

_TURN_RAD, _ACROSS_M, _FAR_M = np.pi, 4.0, 8.0
_BITS = 13


def encode_units(units: ArrayLike, bits: int) -> BitWriter:
    """(88,) intensities 0 to 1 in steps of 1/31; when `bits` (at least 4) do not hold all, the
    strongest."""
    levels = np.rint(np.clip(np.nan_to_num(np.asarray(units, float)), 0, 1) * _LEVELS).astype(int)
    pairs = levels.reshape(-1, 2)
    strongest = np.argsort(-pairs.max(axis=1), kind="stable")[:_MOST]
    wanted = [int(k) for k in strongest if pairs[k].any()]
    while True:
        writer = BitWriter()
        writer.put(len(wanted), 4)
        for number in sorted(wanted):
            left, right = pairs[number].tolist()
            sides = _BOTH if left == right else (_LEFT * (left > 0)) | (_RIGHT * (right > 0))
            writer.put(number, 6)
            writer.put(0 if sides == _BOTH and left != right else sides, 2)
            if left:
                writer.put(left, 5)
            if right and left != right:
                writer.put(right, 5)
        if len(writer) <= bits or not wanted:
            return writer
        wanted.pop()


def decode_units(reader: BitReader) -> Array:
    """(88,). Raises `OutOfBits`."""
    levels = np.zeros((UNITS // 2, 2))
    for _ in range(reader.get(4)):
        number, sides = reader.get(6), reader.get(2)
        if number >= len(levels):
            raise OutOfBits("there is no such action unit")
        if sides == _BOTH:
            levels[number] = reader.get(5)
        elif sides == 0:  # both, and different
            levels[number] = reader.get(5), reader.get(5)
        else:
            levels[number, sides - 1] = reader.get(5)
    return levels.ravel() / _LEVELS


def encode_head(pose: Pose) -> BitWriter:
    """camera_from_mask in 78 bits: 0.8 mrad, 1 mm; beyond 4 m to a side or 8 m away it stops."""
    writer = BitWriter()
    turn = vector_from_rotation(pose.rotation @ FACING.T)
    ranges = ((-_TURN_RAD, _TURN_RAD),) * 3 + ((-_ACROSS_M, _ACROSS_M),) * 2 + ((0.0, _FAR_M),)
    for value, (low, high) in zip((*turn, *pose.translation), ranges, strict=True):
        share = (float(value) - low) / (high - low)
        share = min(max(share, 0.0), 1.0) if np.isfinite(share) else 0.5
        writer.put(round(share * (2**_BITS - 1)), _BITS)
    return writer


def decode_head(reader: BitReader) -> Pose:
    """Raises `OutOfBits`."""
    shares = np.array([reader.get(_BITS) for _ in range(6)]) / (2**_BITS - 1)
    turn = (2 * shares[:3] - 1) * _TURN_RAD
    place = np.array(
        [(2 * shares[3] - 1) * _ACROSS_M, (2 * shares[4] - 1) * _ACROSS_M, shares[5] * _FAR_M]
    )
    return Pose(rotation_from_vector(turn) @ FACING, place)


def between(first: Pose, second: Pose, share: float) -> Pose:
    """The pose that share of the way from one to the other, the short way round."""
    step = vector_from_rotation(second.rotation @ first.rotation.T)
    rotation = rotation_from_vector(step * share) @ first.rotation
    return Pose(rotation, first.translation + share * (second.translation - first.translation))
