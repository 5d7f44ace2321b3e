"""Bad photographs, kind by kind: each a clear message or advice, none a crash, in 1 GiB of memory.

All of them are built by one process of its own, whose greatest memory is read at the end.
"""

import json
import os
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hypermask import paths
from hypermask.texture.landmarks import FaceFinder, Landmarks
from hypermask.texture.models import MODELS
from hypermask.texture.photo import load_photo
from hypermask.texture.turned_head import head

FACES = sorted((Path(__file__).parents[2].parent / "shared" / "data" / "faces").glob("*.jpg"))
pytestmark = pytest.mark.skipif(
    not FACES or not all((paths.models() / model.file).is_file() for model in MODELS),
    reason="../shared/data/faces or the face models are absent",
)
Picture = np.ndarray[Any, Any]
Maker = Callable[[Path, Picture, Landmarks], None]
GIBIBYTE_KB = 1024 * 1024


def _bytes(data: bytes) -> Maker:
    return lambda path, image, face: path.write_bytes(data) and None


def _encoded(kind: str, change: Callable[[Picture], Picture] = lambda image: image) -> Maker:
    def make(path: Path, image: Picture, face: Landmarks) -> None:
        path.write_bytes(cv2.imencode(kind, change(image))[1].tobytes())

    return make


def _cut(kind: str) -> Maker:
    def make(path: Path, image: Picture, face: Landmarks) -> None:
        data = cv2.imencode(kind, image)[1].tobytes()
        path.write_bytes(data[: len(data) * 2 // 3])

    return make


def _spoilt_jpeg(path: Path, image: Picture, face: Landmarks) -> None:
    """Cut short, and closed with an end mark as if it were whole."""
    data = cv2.imencode(".jpg", image)[1].tobytes()
    path.write_bytes(data[: len(data) // 2] + b"\xff\xd9")


def _png(width: int, height: int, pixels: bytes = b"") -> bytes:
    def chunk(name: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", pixels), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def _pillow(kind: str, mode: str = "RGB", **options: Any) -> Maker:
    def make(path: Path, image: Picture, face: Landmarks) -> None:
        pictures = pytest.importorskip("PIL.Image")
        picture = pictures.fromarray(np.ascontiguousarray(image[..., ::-1])).convert(mode)
        if kind in ("GIF", "TIFF"):
            options.update(save_all=True, append_images=[picture.rotate(180)])
        picture.save(path, kind, **options)

    return make


def _exif(orientation: int) -> Maker:
    def make(path: Path, image: Picture, face: Landmarks) -> None:
        jpeg = cv2.imencode(".jpg", _as_stored(image, orientation))[1].tobytes()
        ifd = struct.pack("<HHHIHHI", 1, 0x0112, 3, 1, orientation, 0, 0)
        exif = b"Exif\0\0II*\0\x08\0\0\0" + ifd
        app1 = b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif
        path.write_bytes(jpeg[:2] + app1 + jpeg[2:])

    return make


def _as_stored(image: Picture, orientation: int) -> Picture:
    """What a camera that notes this orientation has in its file for the upright `image`."""
    turned = {
        2: image[:, ::-1],
        3: image[::-1, ::-1],
        4: image[::-1],
        5: image.transpose(1, 0, 2),
        6: np.rot90(image, 1),
        7: image[::-1, ::-1].transpose(1, 0, 2),
        8: np.rot90(image, -1),
    }
    return np.ascontiguousarray(turned.get(orientation, image))


def _pipe(path: Path, image: Picture, face: Landmarks) -> None:
    os.mkfifo(path)


def _unreadable(path: Path, image: Picture, face: Landmarks) -> None:
    path.symlink_to(path)  # rights would not keep an administrator out


def _painted(change: Callable[[Picture, Landmarks], Picture]) -> Maker:
    return lambda path, image, face: (
        cv2.imwrite(str(path.with_suffix(".png")), change(image.copy(), face))
        and path.with_suffix(".png").rename(path)
        and None
    )


def _turned(yaw: float) -> Callable[[Picture, Landmarks], Picture]:
    return lambda image, face: head(image, face.points, face.pupils).turned(yaw)


def _tiny(image: Picture, face: Landmarks) -> Picture:
    small = cv2.resize(image, None, fx=0.08, fy=0.08, interpolation=cv2.INTER_AREA)
    canvas = np.full((400, 400, 3), 200, np.uint8)
    canvas[100 : 100 + small.shape[0], 100 : 100 + small.shape[1]] = small
    return canvas


def _cut_face(image: Picture, face: Landmarks) -> Picture:
    return image[:, int(face.points[4, 0]) + 10 :]


def _hand(image: Picture, face: Landmarks) -> Picture:
    """Four fingers over nose and mouth."""
    unit, (x, y) = face.eye_distance, face.points[0, :2]
    for finger in range(4):
        start = int(x - 0.9 * unit), int(y + (0.26 * finger - 0.5) * unit)
        end = int(x + 0.45 * unit), int(y + (0.26 * finger - 0.6) * unit)
        cv2.line(image, start, end, (110, 140, 190), int(0.24 * unit))
        shade = int(0.12 * unit)
        low = [(a, b + shade) for a, b in (start, end)]
        cv2.line(image, *low, (70, 90, 130), 4)
    return image


def _sunglasses(image: Picture, face: Landmarks) -> Picture:
    unit = face.eye_distance
    for eye in face.pupils:
        size = int(0.36 * unit), int(0.27 * unit)
        cv2.ellipse(image, (int(eye[0]), int(eye[1])), size, 0, 0, 360, (15, 15, 15), -1)
    return image


def _wide_mouth(image: Picture, face: Landmarks) -> Picture:
    unit, (x, y) = face.eye_distance, face.points[14, :2]
    lower = image[int(y) :].copy()
    drop = int(0.35 * unit)
    image[int(y) + drop :] = lower[: lower.shape[0] - drop]
    image[int(y) : int(y) + drop] = image[int(y)]
    centre = int(x), int(y) + drop // 2
    cv2.ellipse(image, centre, (int(0.36 * unit), drop // 2 + 6), 0, 0, 360, (25, 15, 50), -1)
    return image


def _drawing(image: Picture, face: Landmarks) -> Picture:
    canvas = np.full((500, 500, 3), 255, np.uint8)
    cv2.circle(canvas, (250, 250), 180, (0, 220, 255), -1)
    for x in (190, 310):
        cv2.circle(canvas, (x, 200), 22, (0, 0, 0), -1)
    cv2.ellipse(canvas, (250, 300), (90, 60), 0, 0, 180, (0, 0, 0), 10)
    return canvas


def _two(image: Picture, face: Landmarks) -> Picture:
    return np.hstack([image, image[:, ::-1]])


def _large(kind: str, width: int, height: int, *options: int) -> Maker:
    def make(path: Path, image: Picture, face: Landmarks) -> None:
        big = cv2.resize(image, (width, height), interpolation=cv2.INTER_NEAREST)
        path.write_bytes(cv2.imencode(kind, big, list(options))[1].tobytes())

    return make


_FILE = {"PHOTO-FORMAT"}
_BUILT: set[str] = set()
KINDS: dict[str, tuple[Maker, set[str], str]] = {
    # files that are no photograph: (what is made, the codes allowed or none if it is built, advice)
    "empty file": (_bytes(b""), _FILE, ""),
    "text": (_bytes(b"Dear Sir or Madam,\n" * 40), _FILE, ""),
    "SVG drawing": (
        _bytes(b'<svg xmlns="http://www.w3.org/2000/svg"><circle r="9"/></svg>'),
        _FILE,
        "",
    ),
    "PDF": (_bytes(b"%PDF-1.7\n1 0 obj << >> endobj\n%%EOF"), _FILE, ""),
    "PostScript, which would be run": (
        _bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n"),
        _FILE,
        "",
    ),
    "video": (_bytes(b"\0\0\0\x18ftypmp42" + bytes(4000)), _FILE, ""),
    "zeros": (_bytes(bytes(10_000)), _FILE, ""),
    "JPEG cut short": (_cut(".jpg"), _FILE, ""),
    "JPEG with half its data": (_spoilt_jpeg, _FILE, ""),
    "PNG cut short": (_cut(".png"), _FILE, ""),
    "WebP cut short": (_cut(".webp"), _FILE, ""),
    "PNG of which only the head is there": (_bytes(_png(800, 800)), _FILE, ""),
    "PNG that claims 60000 x 60000": (_bytes(_png(60_000, 60_000)), {"PHOTO-SIZE"}, ""),
    "PNG of 10000 x 10000 in 300 kB": (
        _bytes(_png(10_000, 10_000, zlib.compress(bytes(300_010_000)))),
        {"PHOTO-SIZE"},
        "",
    ),
    "GIF that claims 65535 x 65535": (
        _bytes(b"GIF89a" + b"\xff" * 4 + bytes(100)),
        {"PHOTO-SIZE"},
        "",
    ),
    "one pixel": (_encoded(".png", lambda image: image[:1, :1]), {"FACE-NONE"}, ""),
    "one row": (_encoded(".png", lambda image: image[300:301]), {"FACE-NONE"}, ""),
    "folder": (lambda path, image, face: path.mkdir(), {"PHOTO-ABSENT"}, ""),
    "pipe that nobody writes to": (_pipe, {"PHOTO-ABSENT"}, ""),
    "device": (lambda path, image, face: path.symlink_to("/dev/zero"), {"PHOTO-ABSENT"}, ""),
    "file that cannot be read": (_unreadable, {"PHOTO-ABSENT"}, ""),
    # unusual files with a good photograph in them
    "16-bit PNG": (_encoded(".png", lambda image: image.astype(np.uint16) * 257), _BUILT, ""),
    "grey JPEG": (
        _encoded(".jpg", lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)),
        _BUILT,
        "",
    ),
    "PNG with transparency": (
        _encoded(".png", lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2BGRA)),
        _BUILT,
        "",
    ),
    "CMYK JPEG": (_pillow("JPEG", "CMYK"), _BUILT, ""),
    "PNG of 256 colours": (_pillow("PNG", "P"), _BUILT, ""),
    "GIF that moves": (_pillow("GIF", "P"), _BUILT, ""),
    "TIFF of two pages": (_pillow("TIFF"), _BUILT, ""),
    "progressive JPEG": (_encoded(".jpg"), _BUILT, ""),
    "JPEG 2000": (_encoded(".jp2"), _BUILT, ""),
    "AVIF": (_pillow("AVIF"), _BUILT, ""),
    "TGA": (_pillow("TGA"), _BUILT, ""),
    "PCX": (_pillow("PCX"), _BUILT, ""),
    "ICO": (_pillow("ICO", sizes=[(256, 256)]), {"", "FACE-SMALL", "PHOTO-FORMAT"}, ""),
    "HDR": (_encoded(".hdr", lambda image: (image / 255.0).astype(np.float32) ** 2.2), _BUILT, ""),
    "TIFF of numbers that are none": (
        _encoded(".tiff", lambda image: np.full(image.shape, np.nan, np.float32)),
        {"FACE-NONE", "PHOTO-FORMAT"},
        "",
    ),
    **{f"EXIF orientation {n}": (_exif(n), _BUILT, "") for n in (0, 1, 2, 3, 4, 5, 6, 7, 8, 9)},
    # photographs that are no good
    "no face": (_painted(lambda image, face: np.full_like(image, 128)), {"FACE-NONE"}, ""),
    "noise": (
        _painted(
            lambda image, face: np.random.default_rng(1).integers(0, 255, image.shape, np.uint8)
        ),
        {"FACE-NONE"},
        "",
    ),
    "a drawing of a face": (_painted(_drawing), {"FACE-NONE"}, ""),
    "two faces": (_painted(_two), {"FACE-MANY"}, ""),
    "tiny face": (_painted(_tiny), {"FACE-SMALL", "FACE-NONE"}, ""),
    "face cut by the edge": (
        _painted(_cut_face),
        {"FACE-CUT", "FACE-NONE", "FACE-TURNED", "FACE-HIDDEN"},
        "",
    ),
    "upside down": (_painted(lambda image, face: image[::-1, ::-1]), {"FACE-TURNED"}, ""),
    "profile": (_painted(_turned(65)), {"FACE-TURNED", "FACE-NONE"}, ""),
    "turned by 30 degrees": (_painted(_turned(30)), _BUILT, "turned"),
    "strongly blurred": (
        _painted(lambda image, face: cv2.GaussianBlur(image, (0, 0), face.eye_distance / 30)),
        _BUILT,
        "blurred",
    ),
    "dark": (_painted(lambda image, face: (image * 0.2).astype(np.uint8)), _BUILT, "dark"),
    "nearly black": (
        _painted(lambda image, face: (image * 0.04).astype(np.uint8)),
        {"FACE-DARK", "FACE-NONE"},
        "",
    ),
    "over-exposed": (
        _painted(
            lambda image, face: np.clip(image.astype(float) * 2.6 + 40, 0, 255).astype(np.uint8)
        ),
        _BUILT,
        "bright",
    ),
    "mouth wide open": (_painted(_wide_mouth), _BUILT, "mouth"),
    "hand before the face": (_painted(_hand), _BUILT, "hidden"),
    "sunglasses": (_painted(_sunglasses), _BUILT, "hidden"),
    # the largest that are taken
    "JPEG of 120 million pixels": (_large(".jpg", 10_000, 11_900), _BUILT, ""),
    "progressive JPEG of 120 million pixels": (
        _large(".jpg", 10_000, 11_900, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        _BUILT,
        "",
    ),
    "PNG of 50 million pixels": (
        _large(".png", 6400, 7700, cv2.IMWRITE_PNG_COMPRESSION, 1),
        _BUILT,
        "",
    ),
    "JPEG 2000 beyond its limit": (
        _bytes(
            b"\0\0\0\x0cjP  \r\n\x87\n"
            + b"\0\0\0\x16ihdr"
            + struct.pack(">II", 9000, 9000)
            + bytes(99)
        ),
        {"PHOTO-SIZE"},
        "",
    ),
}

_BUILDER = """
import json, sys, traceback
from pathlib import Path
from hypermask.errors import HypermaskError
from hypermask.texture.build import build_character
def peak_kb():  # not ru_maxrss: that one counts what the parent process held as well
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0])
folder, found = Path(sys.argv[1]), {}
for path in sorted(folder.iterdir()):
    told = []
    try:
        build_character(path, "x", folder.parent / "out", tell=told.append)
        found[path.name] = ["", " ".join(told), ""]
    except HypermaskError as error:
        found[path.name] = [error.code, str(error), error.remedy]
    except BaseException:
        found[path.name] = ["CRASH", traceback.format_exc(), ""]
    print(path.name, peak_kb() // 1024, file=sys.stderr)
found["peak"] = peak_kb()
Path(sys.argv[2]).write_text(json.dumps(found))
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """By number of the kind: [code or "" if built, what was said, remedy]; "peak": kB; "log"."""
    folder = tmp_path_factory.mktemp("bad")
    (folder / "in").mkdir()
    image = load_photo(FACES[len(FACES) // 3])
    face = FaceFinder().find(image)
    for number, (make, _, _) in enumerate(KINDS.values()):
        try:
            make(folder / "in" / f"{number:02d}", image, face)
        except (pytest.skip.Exception, KeyError, OSError, cv2.error):
            (folder / "in" / f"{number:02d}").unlink(missing_ok=True)  # nothing here writes it
    command = [sys.executable, "-c", _BUILDER, str(folder / "in"), str(folder / "found.json")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    found: dict[str, Any] = json.loads((folder / "found.json").read_text())
    return {**found, "log": done.stderr}


def test_there_are_more_than_twenty_kinds() -> None:
    assert len(KINDS) > 20


@pytest.mark.parametrize("kind", KINDS)
def test_a_clear_message_or_a_character(results: dict[str, Any], kind: str) -> None:
    _, codes, advice = KINDS[kind]
    number = f"{list(KINDS).index(kind):02d}"
    if number not in results:
        pytest.skip("no program here writes such a file")
    code, said, remedy = results[number]
    assert code in (codes or {""}), said
    assert advice in said
    if code:
        assert said and remedy and "Traceback" not in said


def test_the_memory_stays_within_one_gibibyte(results: dict[str, Any]) -> None:
    assert results["peak"] <= GIBIBYTE_KB, results["log"]


def test_no_decoder_writes_lines_of_its_own(results: dict[str, Any]) -> None:
    lines = results["log"].splitlines()
    assert [line for line in lines if not line[:2].isdecimal()] == []
