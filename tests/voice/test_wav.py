"""Recordings in every common kind of WAV file."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.voice.wav import read_wav

SAMPLES = np.array([0.0, 0.5, -0.5, -1.0, 0.25, 0.75])
EXTENSIBLE = 0xFFFE


def encoded(samples: np.ndarray, bits: int, code: int) -> bytes:
    if code == 3:
        return samples.astype("<f4" if bits == 32 else "<f8").tobytes()
    whole = np.round(samples * 2 ** (bits - 1)).astype(np.int64)
    if bits == 8:
        return (whole + 128).astype(np.uint8).tobytes()
    return b"".join(int(n).to_bytes(bits // 8, "little", signed=True) for n in whole)


def chunk(name: bytes, body: bytes) -> bytes:
    return name + struct.pack("<I", len(body)) + body + b"\0" * (len(body) % 2)


def form(code: int, channels: int, rate: int, bits: int, sub: int | None = None) -> bytes:
    width = channels * bits // 8
    plain = struct.pack("<HHIIHH", code, channels, rate, rate * width, width, bits)
    if sub is None:
        return chunk(b"fmt ", plain)
    guid = struct.pack("<H", sub) + bytes.fromhex("000000001000800000aa00389b71")
    return chunk(b"fmt ", plain + struct.pack("<HHI", 22, bits, 0) + guid)


def wav(path: Path, *chunks: bytes) -> Path:
    body = b"WAVE" + b"".join(chunks)
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)
    return path


@pytest.mark.parametrize(
    ("code", "bits", "tolerance"),
    [(1, 8, 0), (1, 16, 0), (1, 24, 0), (1, 32, 0), (3, 32, 0), (3, 64, 0)],
)
@pytest.mark.parametrize("extensible", [False, True])
def test_each_kind_of_sample_is_read(tmp_path, code, bits, tolerance, extensible):
    head = form(EXTENSIBLE if extensible else code, 1, 44_100, bits, code if extensible else None)
    path = wav(tmp_path / "a.wav", head, chunk(b"data", encoded(SAMPLES, bits, code)))
    samples, rate_hz = read_wav(path)
    assert samples.dtype == np.float32
    assert rate_hz == 44_100
    np.testing.assert_allclose(samples, SAMPLES, atol=tolerance)


def test_channels_are_averaged(tmp_path):
    both = np.stack([SAMPLES, np.zeros(6)], axis=1).ravel()
    path = wav(tmp_path / "a.wav", form(1, 2, 48_000, 16), chunk(b"data", encoded(both, 16, 1)))
    np.testing.assert_allclose(read_wav(path)[0], SAMPLES / 2)


def test_other_chunks_are_passed_over_even_odd_ones(tmp_path):
    path = wav(
        tmp_path / "a.wav",
        chunk(b"LIST", b"abc"),
        form(1, 1, 16_000, 16),
        chunk(b"fact", b"1234"),
        chunk(b"data", encoded(SAMPLES, 16, 1)),
        chunk(b"LIST", b"the end"),
    )
    assert len(read_wav(path)[0]) == 6


def test_a_recording_whose_length_was_never_written_is_read_to_its_end(tmp_path):
    for size in (0xFFFFFFFF, 0x7FFFFFFF, 0):
        body = b"WAVE" + form(1, 1, 16_000, 16) + b"data" + struct.pack("<I", size)
        riff = b"RIFF" + struct.pack("<I", len(body) if size == 0 else 0xFFFFFFFF)
        (tmp_path / "a.wav").write_bytes(riff + body + encoded(SAMPLES, 16, 1))
        assert len(read_wav(tmp_path / "a.wav")[0]) == 6


def test_float_samples_are_passed_on_as_they_are(tmp_path):
    wild = np.array([np.nan, np.inf, 3.0])
    path = wav(tmp_path / "a.wav", form(3, 1, 16_000, 32), chunk(b"data", encoded(wild, 32, 3)))
    np.testing.assert_array_equal(read_wav(path)[0], wild.astype(np.float32))


def test_a_file_that_does_not_exist():
    with pytest.raises(DataError, match=r"VOICE-ABSENT: there is no recording .*nowhere\.wav"):
        read_wav(Path("nowhere.wav"))


def test_a_folder_in_place_of_a_file(tmp_path):
    with pytest.raises(DataError, match="VOICE-READ"):
        read_wav(tmp_path)


def sound() -> bytes:
    return chunk(b"data", encoded(SAMPLES, 16, 1))


@pytest.mark.parametrize(
    ("chunks", "why"),
    [
        ([], "truncated"),
        ([form(1, 1, 16_000, 16)], "no samples"),
        ([form(1, 1, 16_000, 16)[:14]], "truncated"),
        ([form(1, 1, 16_000, 16), sound()[:-4]], "8 of 12 bytes"),
        ([form(1, 1, 16_000, 16), chunk(b"data", b"")], "no samples"),
        ([sound(), form(1, 1, 16_000, 16)], "before their format"),
        ([form(1, 0, 16_000, 16), sound()], "contradicts"),
        ([form(1, 1, 0, 16), sound()], "contradicts"),
        ([form(7, 1, 8_000, 8), sound()], "unknown kind"),
        ([form(EXTENSIBLE, 1, 16_000, 16), sound()], "truncated"),
    ],
)
def test_a_broken_file_is_told_apart(tmp_path, chunks, why):
    with pytest.raises(DataError, match=f"VOICE-FORMAT.*{why}"):
        read_wav(wav(tmp_path / "a.wav", *chunks))


@pytest.mark.parametrize("data", [b"", b"RIFF", b"ID3\x04 this is an mp3 file"])
def test_what_is_no_wav_file(tmp_path, data):
    (tmp_path / "a.wav").write_bytes(data)
    with pytest.raises(DataError, match=r"VOICE-FORMAT.*is not a WAV file"):
        read_wav(tmp_path / "a.wav")
