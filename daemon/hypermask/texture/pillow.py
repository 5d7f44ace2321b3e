"""What OpenCV does not open and Pillow does (where it is installed): ICO, TGA, PCX, PSD, others."""

from __future__ import annotations

import io
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Size = tuple[int, int]

_FORMATS = (
    *("AVIF", "BMP", "DIB", "GIF", "ICNS", "ICO", "JPEG", "JPEG2000", "PCX", "PNG", "PPM"),
    *("PSD", "QOI", "SGI", "SUN", "TGA", "TIFF", "WEBP", "XBM", "XPM"),
)
"""Pictures of pixels only: nothing that runs a program or holds drawings."""


def pillow_size(data: bytes) -> Size | None:
    """(width, height) from the header, or None: unknown, broken, or no Pillow."""
    image = _opened(data)
    return None if image is None else (int(image.size[0]), int(image.size[1]))


def pillow_decode(data: bytes) -> Image | None:
    """(h, w, 3) BGR upright, the first picture of several, or None where it is damaged."""
    image = _opened(data)
    if image is None:
        return None
    from PIL import ImageOps

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            upright: Any = ImageOps.exif_transpose(image)
            rgb = np.asarray(upright.convert("RGB"))
    except Exception:  # Pillow's plug-ins raise whatever a broken file makes them raise
        return None
    return np.ascontiguousarray(rgb[..., ::-1], np.uint8)


def _opened(data: bytes) -> Any:
    try:
        from PIL import Image as Pictures
    except ImportError:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return Pictures.open(io.BytesIO(data), formats=_FORMATS)
    except Exception:  # as above
        return None
