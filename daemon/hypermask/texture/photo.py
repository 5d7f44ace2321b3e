"""A photograph from a file: refused before it is decoded where it is broken or absurd.

Anything OpenCV or, where it is installed, Pillow opens; the EXIF rotation is honoured; large
photographs are scaled down.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask.errors import DataError
from hypermask.texture.pillow import pillow_decode, pillow_size

MAX_FILE_BYTES = 150_000_000
MAX_PIXELS = 120_000_000
"""Of a JPEG; other files take several times the memory a pixel while they are decoded."""
MAX_OTHER_PIXELS = 50_000_000
MAX_COSTLY_PIXELS = 25_000_000
MAX_SIDE = 30_000
WORKING_SIDE = 1600
"""Longer photographs are scaled down to this: the texture has no more detail than that."""

_RADIANCE = (b"#?RADIANCE", b"#?RGBE")
_DAMAGED = ("Premature end", "premature end", "bad Huffman code", "Read Error", "CRC error")
"""Words of libjpeg, libpng and others about pictures that they fill up with grey."""

Image = NDArray[np.uint8]
Size = tuple[int, int]


def load_photo(path: Path) -> Image:
    """The photograph, (h, w, 3) BGR, its longer side at most `WORKING_SIDE`.

    Raises `DataError` PHOTO-ABSENT, PHOTO-FORMAT, PHOTO-SIZE.
    """
    return read_photo(path)[0]


def read_photo(path: Path) -> tuple[Image, bytes, int]:
    """(what `load_photo` gives, the file's bytes, the longer side that it has)."""
    data = photo_bytes(path)
    return decode_photo(data, path), data, max(_header_size(data) or pillow_size(data) or (0,))


def decode_photo(data: bytes, path: Path) -> Image:
    """As `load_photo`, from a file's bytes; path: what to call it."""
    known = _header_size(data)
    size = known or pillow_size(data)
    if size is None:
        raise _format(path, "is not a picture of a known kind")
    _check_size(path, size, _most_pixels(data, known is not None))
    if _cut_short(data):
        raise _format(path, "is cut short: the end of the picture is missing")
    image = _decode(data, size) if known else None
    if image is None and not data.startswith(b"\xff\xd8"):
        _check_size(path, size, MAX_COSTLY_PIXELS)
        image = pillow_decode(data)
    if image is None or 0 in image.shape:
        raise _format(path, "is damaged and cannot be decoded")
    return _scaled_down(image)


def _most_pixels(data: bytes, known: bool) -> int:
    """What keeps building a character within 1 GiB of memory."""
    if data.startswith(b"\xff\xd8"):
        return MAX_PIXELS
    costly = not known or any(magic.match(data) for magic in _COSTLY)
    return MAX_COSTLY_PIXELS if costly else MAX_OTHER_PIXELS


def _scaled_down(image: Image) -> Image:
    scale = WORKING_SIDE / max(image.shape[:2])
    return image if scale >= 1 else scaled(image, scale)


def scaled(image: Image, factor: float) -> Image:
    """Smaller by a factor below 1, a pixel wide and high at least."""
    width, height = (max(round(n * factor), 1) for n in (image.shape[1], image.shape[0]))
    return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def photo_bytes(path: Path) -> bytes:
    """A photograph's file as it is. Raises `DataError` PHOTO-ABSENT, PHOTO-FORMAT, PHOTO-SIZE."""
    try:
        facts = path.stat()
        if not stat.S_ISREG(facts.st_mode):  # a pipe would be waited for without end
            raise DataError(
                "PHOTO-ABSENT",
                f"{path} is not a file",
                "Give the path of a picture file that you may read.",
            )
        if facts.st_size > MAX_FILE_BYTES:
            raise DataError(
                "PHOTO-SIZE",
                f"the photograph {path} is larger than {MAX_FILE_BYTES // 1_000_000} MB",
                "Save it as a JPEG of ordinary size.",
            )
        return path.read_bytes()
    except FileNotFoundError:
        raise DataError(
            "PHOTO-ABSENT", f"there is no photograph {path}", "Check the path."
        ) from None
    except OSError as error:
        raise DataError(
            "PHOTO-ABSENT",
            f"the photograph {path} cannot be read: {error.strerror or error}",
            "Give the path of a picture file that you may read.",
        ) from error


def _format(path: Path, what: str) -> DataError:
    return DataError(
        "PHOTO-FORMAT", f"{path} {what}", "Save the photograph again as JPEG or PNG and try it."
    )


def _check_size(path: Path, size: Size, most: int) -> None:
    width, height = size
    if width < 1 or height < 1:
        raise _format(path, "says that it has no pixels")
    if max(size) > MAX_SIDE or width * height > most:
        raise DataError(
            "PHOTO-SIZE",
            f"{path} says that it has {width} x {height} pixels",
            f"Scale it down to less than {most // 1_000_000} million pixels, or save it as JPEG.",
        )


def _decode(data: bytes, size: Size) -> Image | None:
    flags = cv2.IMREAD_COLOR
    if data.startswith(b"\xff\xd8") and max(size) >= 4 * WORKING_SIDE:
        flags = cv2.IMREAD_REDUCED_COLOR_4
    elif data.startswith(b"\xff\xd8") and max(size) >= 2 * WORKING_SIDE:
        flags = cv2.IMREAD_REDUCED_COLOR_2
    if data.startswith(_RADIANCE):
        return _developed(data)
    with _overheard() as said:
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
        except (cv2.error, MemoryError):
            image = None
    if image is None or any(words in line for line in said for words in _DAMAGED):
        return None
    return np.asarray(image, np.uint8)


def _developed(data: bytes) -> Image | None:
    """Light of a high dynamic range as an ordinary picture; its brightest percent is white."""
    try:
        light = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except (cv2.error, MemoryError):
        return None
    if light is None or light.ndim != 3 or light.shape[2] != 3:
        return None
    light = np.nan_to_num(np.asarray(light, np.float32), posinf=0, neginf=0)
    white = max(float(np.percentile(light, 99)), 1e-6)
    return np.asarray(255 * np.clip(light / white, 0, 1) ** (1 / 2.2), np.uint8)


@contextlib.contextmanager
def _overheard() -> Iterator[list[str]]:
    """What the decoders' C code writes to the error output: kept back and collected."""
    said: list[str] = []
    try:
        before = os.dup(2)
    except OSError:  # there is no error output
        yield said
        return
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(before, 2)
            os.close(before)
            file.seek(0)
            said += file.read(100_000).decode("utf-8", "replace").splitlines()


def _cut_short(data: bytes) -> bool:
    """Whether the end mark of a JPEG or PNG is missing; OpenCV would fill up with grey."""
    if data.startswith(b"\xff\xd8"):
        start = data.rfind(b"\xff\xda")  # a thumbnail has an end of its own before it
        return data.find(b"\xff\xd9", max(start, 0)) < 0
    if data.startswith(b"\x89PNG"):
        return b"IEND" not in data[-65536:]
    return False


def _header_size(data: bytes) -> Size | None:
    """(width, height) from the file's header, or None for a broken or unknown file."""
    try:
        for magic, reader in _READERS:
            if magic.match(data):
                return reader(data)
    except (struct.error, IndexError, ValueError, KeyError):
        pass
    return None


def _pair(layout: str, data: bytes, offset: int) -> Size:
    width, height = struct.unpack_from(layout, data, offset)
    return int(width), int(height)


def _png(data: bytes) -> Size | None:
    return _pair(">II", data, 16) if data[12:16] == b"IHDR" else None


def _jpeg(data: bytes) -> Size | None:
    position = 2
    while True:
        if data[position] != 0xFF:
            return None
        marker = data[position + 1]
        if marker == 0xFF:
            position += 1
            continue
        if 0xD0 <= marker <= 0xD8 or marker == 0x01:
            position += 2
            continue
        if marker in (0xD9, 0xDA):
            return None
        (length,) = struct.unpack_from(">H", data, position + 2)
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, position + 5)
            return width, height
        position += 2 + length


def _bmp(data: bytes) -> Size | None:
    (header,) = struct.unpack_from("<I", data, 14)
    layout = "<HH" if header == 12 else "<ii"
    width, height = struct.unpack_from(layout, data, 18)
    return width, abs(height)


def _webp(data: bytes) -> Size | None:
    kind = data[12:16]
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8X":
        return (
            int.from_bytes(data[24:27], "little") + 1,
            int.from_bytes(data[27:30], "little") + 1,
        )
    return None


def _tiff(data: bytes) -> Size | None:
    order = "<" if data[:2] == b"II" else ">"
    (offset,) = struct.unpack_from(order + "I", data, 4)
    (entries,) = struct.unpack_from(order + "H", data, offset)
    found = {}
    for number in range(entries):
        entry = offset + 2 + 12 * number
        tag, kind = struct.unpack_from(order + "HH", data, entry)
        if tag in (256, 257):
            layout = {3: "H", 4: "I"}[kind]
            (found[tag],) = struct.unpack_from(order + layout, data, entry + 8)
    return found[256], found[257]


def _pnm(data: bytes) -> Size | None:
    fields = re.sub(rb"#[^\n]*\n", b"\n", data[:4096])[2:].split()
    return int(fields[0]), int(fields[1])


def _radiance(data: bytes) -> Size | None:
    found = re.search(rb"\n[-+]Y (\d{1,9}) [-+]X (\d{1,9})\n", data[:65536])
    return (int(found[2]), int(found[1])) if found else None


def _gif(data: bytes) -> Size | None:
    return _pair("<HH", data, 6)


def _jpeg2000(data: bytes) -> Size | None:
    place = data.index(b"ihdr", 0, 65536)
    height, width = struct.unpack_from(">II", data, place + 4)
    return width, height


def _avif(data: bytes) -> Size | None:
    place = data.index(b"ispe", 0, 65536)
    return _pair(">II", data, place + 8)


_READERS = tuple(
    (re.compile(magic, re.DOTALL), reader)
    for magic, reader in (
        (rb"\x89PNG\r\n\x1a\n", _png),
        (rb"\xff\xd8\xff", _jpeg),
        (rb"BM", _bmp),
        (rb"RIFF....WEBP", _webp),
        (rb"II\*\0|MM\0\*", _tiff),
        (rb"P[1-6]\s", _pnm),
        (rb"#\?(RADIANCE|RGBE)", _radiance),
        (rb"GIF8[79]a", _gif),
        (rb"\0\0\0\x0cjP", _jpeg2000),
        (rb"....ftyp(avif|avis)", _avif),
    )
)

_COSTLY = tuple(
    re.compile(magic, re.DOTALL)
    for magic in (rb"#\?", rb"GIF8", rb"\0\0\0\x0cjP", rb"....ftyp", rb"II\*\0|MM\0\*")
)
