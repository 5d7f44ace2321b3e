"""From a camera's pixel formats to 8-bit grey.

Source: the kernel's documentation of pixel formats (luma-only, packed YUV, MIPI packed).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]

_SHIFTS = {"Y10 ": 2, "Y12 ": 4, "Y14 ": 6, "Y16 ": 8}
_BYTES = {"GREY": (1, 0), "NV12": (1, 0), "YU12": (1, 0), "YUYV": (2, 0), "UYVY": (2, 1)}

FORMATS = ("GREY", "Y10 ", "Y12 ", "Y14 ", "Y16 ", "Y10P", "YUYV", "UYVY", "NV12", "YU12", "MJPG")
"""The formats that `grey` knows, cheapest first (of those with luma at full depth)."""


def grey(data: Any, name: str, width: int, height: int, stride: int) -> Grey | None:
    """A copy (height, width) of a frame's luma; None when the data are too short or no picture.

    data: a readable buffer; name: one of `FORMATS`; stride: bytes from a line to the next.
    """
    if name == "MJPG":
        return _jpeg(data, width, height)
    lines = _lines(data, height, stride, _line_bytes(name, width))
    if lines is None:
        return None
    if name in _BYTES:
        step, first = _BYTES[name]
        return np.array(lines[:, first::step], order="C")  # a copy, also of contiguous lines
    if name in _SHIFTS:
        deep = np.ascontiguousarray(lines).view("<u2")
        return (deep >> _SHIFTS[name]).astype(np.uint8)
    # Y10P: of each five bytes the first four are the upper eight bits of a pixel.
    groups = lines.reshape(height, -1, 5)[:, :, :4]
    return np.ascontiguousarray(groups.reshape(height, -1)[:, :width])


def _line_bytes(name: str, width: int) -> int:
    if name in _BYTES:
        return width * _BYTES[name][0]
    return width * 2 if name in _SHIFTS else -(-width // 4) * 5


def _lines(data: Any, height: int, stride: int, length: int) -> Grey | None:
    """View (height, length) of the lines' bytes; the last line may lack its padding."""
    stride = max(stride, length)
    flat = np.frombuffer(data, np.uint8)
    if flat.size < stride * (height - 1) + length:
        return None
    return np.lib.stride_tricks.as_strided(flat, (height, length), (stride, 1), writeable=False)


def _jpeg(data: Any, width: int, height: int) -> Grey | None:
    import cv2  # not above: every process reads this driver's settings

    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        return None
    if image is None or image.shape != (height, width):
        return None
    return np.asarray(image, np.uint8)
