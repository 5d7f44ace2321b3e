"""What a datagram holds, how exactly, and that no garbage harms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_rig import Pair, speech

from hypermask.face.action_units import COUNT
from hypermask.geometry import FACING, Pose, rotation_from_vector
from hypermask.stream import face_code, mouth_code
from hypermask.stream.bits import BitReader, BitWriter, OutOfBits
from hypermask.stream.packet import LARGEST, Block, Refused, decode, encode

KEY = b"sixteen bytes !!"
units = st.lists(st.floats(0, 1), min_size=88, max_size=88).map(np.array)
mouths = st.lists(st.floats(-1.5, 1.5), min_size=52, max_size=52).map(
    lambda values: np.array(values).reshape(4, 13)
)
poses = st.lists(st.floats(-1, 1), min_size=6, max_size=6).map(
    lambda v: Pose(rotation_from_vector(v[:3]) @ FACING, np.array([v[3], v[4], 3 + v[5]]))
)


@given(st.lists(st.tuples(st.integers(0, 3000), st.integers(0, 4)), max_size=30))
def test_numbers_come_back(numbers: list[tuple[int, int]]) -> None:
    writer = BitWriter()
    for value, order in numbers:
        writer.golomb(value, order)
    reader = BitReader(writer.bytes())
    assert [reader.golomb(order) for _, order in numbers] == [value for value, _ in numbers]


def test_the_turn_of_the_mouth_is_orthonormal() -> None:
    np.testing.assert_allclose(mouth_code._TURN @ mouth_code._TURN.T, np.eye(13), atol=1e-12)
    np.testing.assert_allclose(mouth_code._COSINES @ mouth_code._COSINES.T, np.eye(4), atol=1e-12)


def test_speech_takes_15_bytes_at_most_and_is_exact() -> None:
    sizes, errors = [], []
    for start_s in np.arange(0, 60, 0.08):
        block = np.array([speech(start_s + 0.02 * k) for k in range(4)])
        writer = mouth_code.encode(block, 500)
        sizes.append(len(writer) / 8)
        errors.append(mouth_code.decode(BitReader(writer.bytes())) - block)
    assert np.mean(sizes) < 13 and max(sizes) <= 20
    assert np.sqrt(np.mean(np.square(errors))) < 0.005


@given(mouths, st.integers(8, 500))
@settings(max_examples=60)
def test_any_mouth_fits_into_any_room(block: np.ndarray, bits: int) -> None:
    writer = mouth_code.encode(block, bits)
    assert len(writer) <= bits
    decoded = mouth_code.decode(BitReader(writer.bytes()))
    assert np.isfinite(decoded).all() and np.abs(decoded).max() <= 1.5
    if bits >= 500:
        assert np.abs(decoded - block).max() < 0.5


@given(units, st.integers(4, 400))
@settings(max_examples=60)
def test_units_come_back_the_strongest_first(values: np.ndarray, bits: int) -> None:
    writer = face_code.encode_units(values, bits)
    assert len(writer) <= bits
    decoded = face_code.decode_units(BitReader(writer.bytes()))
    sent = decoded > 0
    assert np.abs(decoded - values)[sent].max(initial=0) < 0.02
    if len(writer) < 200 and sent.any():
        pairs = values.reshape(-1, 2).max(axis=1)
        left_out = ~sent.reshape(-1, 2).any(axis=1)
        assert pairs[left_out].max() <= pairs[~left_out].min() + 0.04


def test_there_are_as_many_units_as_the_face_has() -> None:
    assert face_code.UNITS == COUNT


@given(poses)
def test_a_head_comes_back_to_a_millimetre(pose: Pose) -> None:
    writer = face_code.encode_head(pose)
    decoded = face_code.decode_head(BitReader(writer.bytes()))
    assert np.abs(decoded.translation - pose.translation).max() < 1e-3
    assert np.abs(decoded.rotation - pose.rotation).max() < 2e-3


@given(mouths, mouths, units, poses, st.sampled_from([None, KEY]), st.sampled_from([48, 68]))
@settings(max_examples=60)
def test_a_datagram_is_never_too_large_and_always_readable(
    now: np.ndarray,
    before: np.ndarray,
    face: np.ndarray,
    pose: Pose,
    key: bytes | None,
    largest: int,
) -> None:
    data = encode(Block(3, 70000, now, before, face, pose, -30), key, largest)
    assert len(data) <= largest
    block = decode(data, key)
    assert (block.session, block.number, block.level_db) == (3, 70000, -30)
    assert block.head is not None


@given(st.binary(max_size=LARGEST + 20), st.booleans())
@settings(max_examples=300)
def test_garbage_is_refused_or_harmless(data: bytes, disguised: bool) -> None:
    if disguised and len(data) >= 2:
        data = b"\xa7\x10" + data[2:]
    try:
        block = decode(data)
    except Refused:
        return
    assert np.isfinite(block.mouths).all() and np.abs(block.mouths).max() <= 1.5
    if block.head is not None:
        assert np.isfinite(block.head.matrix()).all()


@given(st.lists(st.binary(max_size=120), max_size=20), st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_a_playing_stream_is_not_disturbed_by_garbage(junk: list[bytes], seed: int) -> None:
    pair = Pair(key=KEY)
    pair.run(0.6)
    random = np.random.default_rng(seed)
    for data in junk:
        real = bytearray(pair.network.tapped[-1][1])
        real[int(random.integers(len(real)))] ^= 1 << int(random.integers(8))
        pair.network.inject(data, "203.0.113.5")
        pair.network.inject(bytes(real), "203.0.113.5")
    times, found = pair.run(0.4)
    assert pair.receiver.status()["state"] == "playing"
    assert pair.rms(times, found) < 0.05


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "foreign"),
        (b"GET / HTTP/1.1\r\n\r\n", "foreign"),
        (b"\xa7" * 3, "foreign"),
        (b"\xa7\x20" + bytes(30), "version"),
        (b"\xa7\x11" + bytes(30), "key"),
        (b"\xa7\x10" + bytes(7) + b"\x00\xff\xff\xff", "garbled"),
        (b"\xa7\x10" + bytes(LARGEST), "foreign"),
    ],
)
def test_what_is_not_for_us_is_told_apart(data: bytes, why: str) -> None:
    with pytest.raises(Refused) as caught:
        decode(data)
    assert caught.value.why == why


def test_a_reader_at_its_end_says_so() -> None:
    with pytest.raises(OutOfBits):
        BitReader(b"\x00\x00\x00\x00").golomb(0)
