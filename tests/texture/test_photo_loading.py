"""A photograph is refused with a clear code before it is decoded, or it arrives upright."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.texture.photo import WORKING_SIDE, load_photo


def _picture(width: int = 120, height: int = 80) -> np.ndarray:
    picture = np.full((height, width, 3), 90, np.uint8)
    picture[: height // 2, : width // 2] = (20, 40, 220)
    return picture


def _png_header(width: int, height: int) -> bytes:
    chunk = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return b"\x89PNG\r\n\x1a\n" + body + b"\0\0\0\0IEND\xaeB`\x82"


def _code(path: Path) -> str:
    with pytest.raises(DataError) as caught:
        load_photo(path)
    return caught.value.code


@pytest.mark.parametrize("ending", ["png", "jpg", "bmp", "webp", "tiff", "ppm"])
def test_every_common_format_is_read(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"photo.{ending}"
    cv2.imwrite(str(path), _picture())
    assert load_photo(path).shape == (80, 120, 3)


def test_an_absent_file_is_named(tmp_path: Path) -> None:
    assert _code(tmp_path / "nothing.jpg") == "PHOTO-ABSENT"
    assert _code(tmp_path) == "PHOTO-ABSENT"


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"hello, this is no picture",
        b"\xff\xd8\xff",
        b"\xff\xd8\xff\xe0\x00\x10JFIF" + bytes(20),
        b"\x89PNG\r\n\x1a\n",
        b"BM\x00\x00",
        b"RIFF\x00\x00\x00\x00WEBPVP8X",
        b"II*\0\xff\xff\xff\xff",
        b"GIF89a",
        _png_header(100, 100),
        _png_header(0, 100),
    ],
)
def test_a_broken_file_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "broken.jpg"
    path.write_bytes(data)
    assert _code(path) == "PHOTO-FORMAT"


@pytest.mark.parametrize("ending", ["png", "jpg"])
def test_a_picture_that_is_cut_short_is_refused(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"photo.{ending}"
    noise = np.random.default_rng(1).integers(0, 255, (300, 300, 3), np.uint8)
    cv2.imwrite(str(path), noise)
    path.write_bytes(path.read_bytes()[:-3000])
    assert _code(path) == "PHOTO-FORMAT"


def test_absurd_sizes_are_refused_from_the_header_alone(tmp_path: Path) -> None:
    path = tmp_path / "bomb.png"
    for size in ((100_000, 100_000), (200_000, 10), (20_000, 20_000)):
        path.write_bytes(_png_header(*size))
        assert _code(path) == "PHOTO-SIZE"
    jpeg = bytearray(cv2.imencode(".jpg", _picture())[1].tobytes())
    place = jpeg.index(b"\xff\xc0")
    jpeg[place + 5 : place + 9] = struct.pack(">HH", 60_000, 60_000)
    path.write_bytes(jpeg)
    assert _code(path) == "PHOTO-SIZE"


def test_a_large_photograph_is_scaled_down(tmp_path: Path) -> None:
    for ending in ("jpg", "png"):
        path = tmp_path / f"large.{ending}"
        cv2.imwrite(str(path), _picture(8000, 4000))
        assert load_photo(path).shape == (WORKING_SIDE // 2, WORKING_SIDE, 3)


def test_the_exif_rotation_is_honoured(tmp_path: Path) -> None:
    """Orientation 6: the camera was turned; the red corner must come to the upper right."""
    jpeg = cv2.imencode(".jpg", _picture())[1].tobytes()
    ifd = struct.pack("<HHHIHHI", 1, 0x0112, 3, 1, 6, 0, 0)
    exif = b"Exif\0\0II*\0\x08\0\0\0" + ifd
    path = tmp_path / "turned.jpg"
    path.write_bytes(jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg[2:])
    photo = load_photo(path)
    assert photo.shape == (120, 80, 3)
    assert photo[10, 70, 2] > 180 and photo[10, 10, 2] < 120
