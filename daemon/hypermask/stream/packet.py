"""The datagram: 9 bytes of header, the parameters, and 8 bytes of authentication if there is a key.

| bytes | what |
|---|---|
| 1 | 0xA7 |
| 1 | version (upper 4 bits); bit 0: authenticated |
| 4 | session: larger at each start of the sender |
| 3 | number of the block of 80 ms in the session; it is also its time |
| n | bits: level, this block's mouths, 1 + head, 1 + the block before's mouths, 1 + expression |
| 8 | HMAC-SHA-256 of all before, cut (RFC 2104) |
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.geometry import Pose
from hypermask.stream import face_code, mouth_code
from hypermask.stream.bits import BitReader, BitWriter, OutOfBits

Array = NDArray[np.float64]

BLOCK_S = 0.08
MOUTH_S = BLOCK_S / mouth_code.MOUTHS
VERSION = 1
LARGEST = 68
"""Bytes of a datagram: with 28 of IPv4 and UDP, 13 times in any second, 9984 bit/s."""
LARGEST_IPV6 = 48
TAG_BYTES = 8
LAST_BLOCK = 2**24 - 1
_MAGIC = 0xA7
_HEADER = struct.Struct(">BBIBH")
_COARSE, _COARSE_DETAILS = 1, 4


@dataclass(frozen=True)
class Block:
    """80 ms of a performance. mouths: (4, 13); before: those of the block before, less exact;
    units: (88,) at the block's end, None if not sent; head: camera_from_mask at its end.
    """

    session: int
    number: int
    mouths: Array
    before: Array | None = None
    units: Array | None = None
    head: Pose | None = None
    level_db: float = -100.0


class Refused(ValueError):
    """A datagram that is not for us. why: "foreign", "version", "key" or "garbled"."""

    def __init__(self, why: str) -> None:
        super().__init__(why)
        self.why = why


def encode(block: Block, key: bytes | None = None, largest: int = LARGEST) -> bytes:
    """At most `largest` bytes: what matters least is left out first."""
    room = 8 * (largest - _HEADER.size - (TAG_BYTES if key else 0))
    head = face_code.encode_head(block.head) if block.head is not None else None
    body = BitWriter()
    body.put(round(min(max(block.level_db, -93.0), 0.0) / 3 + 31), 5)
    fixed = len(body) + 3 + (len(head) if head else 0)
    body.append(mouth_code.encode(block.mouths, room - fixed))
    _optional(body, head, room - 2)
    before = None
    if block.before is not None:
        spare = room - len(body) - 2
        before = mouth_code.encode(block.before, max(spare, 8), _COARSE, _COARSE_DETAILS)
    _optional(body, before, room - 1)
    units = None
    if block.units is not None and room - len(body) - 1 >= 4:
        units = face_code.encode_units(block.units, room - len(body) - 1)
    _optional(body, units, room)
    return _sealed(block, body.bytes(), key)


def decode(data: bytes, key: bytes | None = None) -> Block:
    """Raises `Refused`."""
    if not _HEADER.size < len(data) <= LARGEST or data[0] != _MAGIC:
        raise Refused("foreign")
    _, version, session, high, low = _HEADER.unpack_from(data)
    if version >> 4 != VERSION:
        raise Refused("version")
    if (version & 1) != int(key is not None):
        raise Refused("key")
    body = data[_HEADER.size :]
    if key is not None:
        if not hmac.compare_digest(_tag(data[:-TAG_BYTES], key), data[-TAG_BYTES:]):
            raise Refused("key")
        body = data[_HEADER.size : -TAG_BYTES]
    try:
        return _body(session, (high << 16) | low, BitReader(body))
    except OutOfBits:
        raise Refused("garbled") from None


def _body(session: int, number: int, reader: BitReader) -> Block:
    level_db = 3.0 * (reader.get(5) - 31)
    mouths = mouth_code.decode(reader)
    head = face_code.decode_head(reader) if reader.get(1) else None
    before = mouth_code.decode(reader) if reader.get(1) else None
    units = face_code.decode_units(reader) if reader.get(1) else None
    if reader.left >= 8 or reader.get(reader.left):
        raise OutOfBits("the datagram is too long")
    return Block(session, number, mouths, before, units, head, level_db)


def _optional(body: BitWriter, part: BitWriter | None, room: int) -> None:
    """One bit, and the part where there is one and it fits."""
    fits = part is not None and len(body) + 1 + len(part) <= room
    body.put(int(fits), 1)
    if part is not None and fits:
        body.append(part)


def _sealed(block: Block, body: bytes, key: bytes | None) -> bytes:
    high, low = block.number >> 16, block.number & 0xFFFF
    flags = (VERSION << 4) | int(key is not None)
    data = _HEADER.pack(_MAGIC, flags, block.session, high, low) + body
    return data if key is None else data + _tag(data, key)


def _tag(data: bytes, key: bytes) -> bytes:
    return hmac.digest(key, data, hashlib.sha256)[:TAG_BYTES]
