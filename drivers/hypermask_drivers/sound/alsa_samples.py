"""From the bytes of a sound card to mono float samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Samples = NDArray[np.float32]

Channel = int | Literal["mix"]

FORMATS = ("S16_LE", "S32_LE", "S24_3LE", "S24_LE", "FLOAT_LE")
"""What can be read, the best first: 16 bits are enough for a voice and cost least."""


def sample_bytes(form: str) -> int:
    """Bytes of one sample of one channel."""
    return {"S16_LE": 2, "S24_3LE": 3}.get(form, 4)


def mono(raw: bytes, form: str, channels: int, channel: Channel = "mix") -> tuple[Samples, int]:
    """Interleaved frames to samples (n,) at full scale 1.0, and how many had to be mended.

    channel: which one counts, from 0; "mix": their mean. A channel that the card has not is its
    last one. Only float samples can be broken: those not finite become 0.
    """
    frames = len(raw) // (sample_bytes(form) * channels)
    data = raw[: frames * sample_bytes(form) * channels]
    samples = _DECODERS[form](data).reshape(frames, channels)
    if channels == 1 or channel != "mix":
        picked = samples[:, 0 if channel == "mix" else min(channel, channels - 1)]
    else:
        picked = None
    broken = 0
    if form == "FLOAT_LE":
        seen = samples if picked is None else picked
        finite = np.isfinite(seen)
        broken = int(np.size(finite) - np.count_nonzero(finite))
        if broken:
            seen = np.where(finite, seen, np.float32(0))
        # The sum of channels may not overflow into what was just taken out.
        seen = np.clip(seen, -_LARGEST, _LARGEST)
        samples, picked = (seen, None) if picked is None else (samples, seen)
    result = samples.mean(axis=1, dtype=np.float32) if picked is None else picked
    return np.ascontiguousarray(result, np.float32), broken


def _from_s16(raw: bytes) -> Samples:
    return (np.frombuffer(raw, "<i2") / 2.0**15).astype(np.float32)


def _from_s24_3(raw: bytes) -> Samples:
    """Each 3-byte sample becomes the upper bytes of a 32-bit one, which keeps its sign."""
    wide = np.zeros((len(raw) // 3, 4), np.uint8)
    wide[:, 1:] = np.frombuffer(raw, np.uint8).reshape(-1, 3)
    return (wide.view("<i4")[:, 0] / 2.0**31).astype(np.float32)


def _from_s24(raw: bytes) -> Samples:
    """The upper byte of each 32-bit word is not defined: it is shifted out."""
    whole = np.left_shift(np.frombuffer(raw, "<i4"), 8)
    return np.asarray(whole / 2.0**31, np.float32)


def _from_s32(raw: bytes) -> Samples:
    return (np.frombuffer(raw, "<i4") / 2.0**31).astype(np.float32)


def _from_float(raw: bytes) -> Samples:
    return np.frombuffer(raw, "<f4").astype(np.float32)


_LARGEST = np.float32(1e6)
_DECODERS: dict[str, Callable[[bytes], Samples]] = {
    "S16_LE": _from_s16,
    "S24_3LE": _from_s24_3,
    "S24_LE": _from_s24,
    "S32_LE": _from_s32,
    "FLOAT_LE": _from_float,
}
