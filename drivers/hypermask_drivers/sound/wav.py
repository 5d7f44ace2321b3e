"""Reads WAV files as mono float32: integer and float samples, any rate, any number of channels.

Microsoft "Multimedia Programming Interface and Data Specifications 1.0" (RIFF WAVE) and
"Multiple channel audio data and WAVE files" (WAVE_FORMAT_EXTENSIBLE).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.errors import DataError

_PCM, _FLOAT, _EXTENSIBLE = 0x0001, 0x0003, 0xFFFE
# Recorders that write to a pipe, or were killed, leave a size from here up (or 0): "to the end".
_UNKNOWN_SIZE = 0x7FFF0000
_RATES_HZ = (1000, 768000)

_Samples = NDArray[np.float32]


@dataclass(frozen=True)
class _Format:
    code: int
    channels: int
    rate_hz: float
    frame_bytes: int
    bits: int


def read_wav(path: Path) -> tuple[_Samples, float]:
    """Samples (n,) float32 at full scale 1.0, channels averaged, and the rate in Hz.

    Integer samples of 8, 16, 24 and 32 bits and float samples of 32 and 64 bits are read; float
    samples are passed on as they are, beyond full scale and NaN included.

    Raises `DataError` VOICE-ABSENT (no file), VOICE-READ (cannot be read) or VOICE-FORMAT (not a
    WAV file of these kinds, truncated, or without samples).
    """
    data = _load(path)
    form, body = _chunks(path, data)
    decode = _decoder(path, form)
    frames = len(body) // form.frame_bytes
    if frames == 0:
        raise _bad(path, "holds no samples")
    samples = decode(body[: frames * form.frame_bytes]).reshape(frames, form.channels)
    mono = samples[:, 0] if form.channels == 1 else samples.mean(axis=1)
    return np.ascontiguousarray(mono, dtype=np.float32), form.rate_hz


def _load(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise DataError(
            "VOICE-ABSENT", f"there is no recording {path}", "Check the path."
        ) from None
    except OSError as error:
        raise DataError(
            "VOICE-READ",
            f"cannot read the recording {path}: {error.strerror or error}",
            "Check the file and its rights.",
        ) from error


def _bad(path: Path, why: str) -> DataError:
    return DataError(
        "VOICE-FORMAT",
        f"the recording {path} {why}",
        "Save it as WAV with 16 bit integer samples and try again.",
    )


def _chunks(path: Path, data: bytes) -> tuple[_Format, bytes]:
    """The format and the bytes of the data chunk."""
    if data[:4] != b"RIFF" or data[8:12] != b"WAVE":
        raise _bad(path, "is not a WAV file")
    form: _Format | None = None
    at = 12
    while at + 8 <= len(data):
        name, size = data[at : at + 4], struct.unpack_from("<I", data, at + 4)[0]
        at += 8
        if name == b"fmt ":
            form = _format(path, data[at : at + size])
        elif name == b"data":
            if form is None:
                raise _bad(path, "has its samples before their format")
            return form, _body(path, data, at, size)
        at += size + size % 2  # chunks are padded to even lengths
    raise _bad(path, "is truncated: it has no samples" if form else "is truncated")


def _body(path: Path, data: bytes, at: int, size: int) -> bytes:
    available = len(data) - at
    riff_size = struct.unpack_from("<I", data, 4)[0]
    if size >= _UNKNOWN_SIZE or (size == 0 and riff_size in (0, at - 8)):
        return data[at:]
    if size > available:
        raise _bad(path, f"is truncated: {available} of {size} bytes of sound are there")
    return data[at : at + size]


def _format(path: Path, chunk: bytes) -> _Format:
    if len(chunk) < 16:
        raise _bad(path, "is truncated inside its format")
    code, channels, rate, _, frame_bytes, bits = struct.unpack_from("<HHIIHH", chunk)
    if code == _EXTENSIBLE:
        if len(chunk) < 26:
            raise _bad(path, "is truncated inside its format")
        code = struct.unpack_from("<H", chunk, 24)[0]  # the sub-format's GUID begins with it
    if channels == 0 or rate == 0 or frame_bytes != channels * ((bits + 7) // 8):
        raise _bad(path, "contradicts itself in its format")
    if not _RATES_HZ[0] <= rate <= _RATES_HZ[1]:
        raise _bad(path, f"has an impossible rate of {rate} Hz")
    return _Format(code, channels, float(rate), frame_bytes, bits)


def _decoder(path: Path, form: _Format) -> Callable[[bytes], _Samples]:
    sample_bytes = form.frame_bytes // form.channels
    decoders: dict[tuple[int, int], Callable[[bytes], _Samples]] = {
        (_PCM, 1): _from_8,
        (_PCM, 2): lambda raw: np.frombuffer(raw, "<i2").astype(np.float32) / np.float32(2**15),
        (_PCM, 3): _from_24,
        (_PCM, 4): lambda raw: (np.frombuffer(raw, "<i4") / 2.0**31).astype(np.float32),
        (_FLOAT, 4): lambda raw: np.frombuffer(raw, "<f4").astype(np.float32),
        (_FLOAT, 8): _from_double,
    }
    decode = decoders.get((form.code, sample_bytes))
    if decode is None:
        raise _bad(path, f"has samples of an unknown kind (format {form.code}, {form.bits} bit)")
    return decode


def _from_8(raw: bytes) -> _Samples:
    """Eight-bit samples, alone among them, are unsigned."""
    return (np.frombuffer(raw, np.uint8).astype(np.float32) - 128.0) / np.float32(128.0)


def _from_24(raw: bytes) -> _Samples:
    """Each 3-byte sample becomes the upper bytes of a 32-bit one, which keeps its sign."""
    wide = np.zeros((len(raw) // 3, 4), np.uint8)
    wide[:, 1:] = np.frombuffer(raw, np.uint8).reshape(-1, 3)
    return (wide.view("<i4")[:, 0] / 2.0**31).astype(np.float32)


def _from_double(raw: bytes) -> _Samples:
    with np.errstate(over="ignore"):
        return np.frombuffer(raw, "<f8").astype(np.float32)
