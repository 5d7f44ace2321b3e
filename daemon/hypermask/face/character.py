"""A character on disk: a folder that is either whole or not there.

character.toml   version, name, source, date
texture.png      512 x 512, the mask seen from the front (`hypermask.face.mesh.to_uv`)
eyes.png         320 x 112, the left and the right eyeball (`hypermask.texture.eyes`)
landmarks.json   the 468 points on the photograph, for characters made from one
photo.jpg        that photograph, as it was used
source.json      how the character was made from it (`hypermask.texture.source`)
fit.json         what was corrected by hand, and of which photo.* beside it (`hypermask.fitting`)
"""

from __future__ import annotations

import json
import re
import shutil
import tempfile
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.config import Settings, load
from hypermask.errors import DataError, HypermaskError, UsageError
from hypermask.face.exchange import clear, exchange, prefix
from hypermask.storage import write_atomically

Image = NDArray[np.uint8]

VERSION = 1
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_SIDES = (512, 1024)


class CharacterSettings(Settings):
    version: int
    name: str
    source: str = ""
    date: str = ""


@dataclass(frozen=True)
class Character:
    """texture: (512 or 1024, same, 3) RGB; eyes: (112, 320, 3) RGB; landmarks: (468, 3) or None;
    photo: the JPEG file that it was made from; record: how, as plain data; None where not known.
    """

    name: str
    source: str
    date: str
    texture: Image
    eyes: Image
    landmarks: NDArray[np.float64] | None = None
    photo: bytes | None = None
    record: Mapping[str, Any] | None = None


_RESERVED = ("dots",)


def check_name(name: str) -> str:
    """Raises `UsageError` CHAR-NAME."""
    if not _NAME.fullmatch(name) or name in _RESERVED:
        raise UsageError(
            "CHAR-NAME",
            f"'{name}' cannot be a character's name",
            "Use letters, digits, '-' and '_', at most 64, the first a letter or digit; 'dots' is "
            "the test picture.",
        )
    return name


def save_character(
    character: Character,
    folder: Path,
    compression: int = 3,
    encoded: Mapping[str, bytes] | None = None,
) -> None:
    """Write the whole folder or nothing; a character of that name is replaced.

    compression: PNG's, 1 to 9; 9 is smallest and takes most of a second; encoded: files by name
    that are encoded already.

    Raises `UsageError` CHAR-NAME, `HypermaskError` DISK-WRITE.
    """
    _write(character, folder, compression, encoded or {}, keep=False)


def update_character(
    character: Character, folder: Path, files: Mapping[str, bytes], compression: int = 3
) -> None:
    """Write a character and more files into its folder, all or nothing; other files stay.

    files: contents by name. Raises `UsageError` CHAR-NAME, `HypermaskError` DISK-WRITE.
    """
    _write(character, folder, compression, files, keep=True)


def _write(
    character: Character, folder: Path, compression: int, files: Mapping[str, bytes], keep: bool
) -> None:
    check_name(character.name)
    temporary = ""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        clear(folder)
        temporary = tempfile.mkdtemp(dir=folder.parent, prefix=prefix(folder))
        if keep and folder.is_dir():
            shutil.copytree(folder, temporary, dirs_exist_ok=True)
        _write_all(Path(temporary), _files(character, compression, files))
        Path(temporary).chmod(0o755)
        exchange(Path(temporary), folder)
    except OSError as error:
        raise HypermaskError(
            "DISK-WRITE",
            f"cannot write the character {folder}: {error.strerror or error}",
            "Free some space or check the folder's rights; the previous character is unharmed.",
        ) from error
    finally:
        if temporary:
            shutil.rmtree(temporary, ignore_errors=True)


def _write_all(folder: Path, files: Mapping[str, bytes]) -> None:
    """Together, because each waits for the disk."""
    with ThreadPoolExecutor(len(files)) as pool:
        list(pool.map(write_atomically, [folder / name for name in files], files.values()))


def _files(character: Character, compression: int, given: Mapping[str, bytes]) -> dict[str, bytes]:
    fields = {"name": character.name, "source": character.source, "date": character.date}
    lines = [f"version = {VERSION}"]
    lines += [f"{key} = {json.dumps(value)}" for key, value in fields.items()]
    pictures = {"texture.png": character.texture, "eyes.png": character.eyes}
    files = {
        **{n: encode_picture(p, compression) for n, p in pictures.items() if n not in given},
        "character.toml": ("\n".join(lines) + "\n").encode(),
    }
    if character.landmarks is not None:
        points = np.round(character.landmarks, 2).tolist()
        files["landmarks.json"] = json.dumps({"version": 1, "points_px": points}).encode()
    if character.photo is not None:
        files["photo.jpg"] = character.photo
    if character.record is not None:
        record = {"version": VERSION, **character.record}
        files["source.json"] = (json.dumps(record, indent=1) + "\n").encode()
    return {**files, **given}


def encode_picture(image: Image, compression: int) -> bytes:
    """RGB (h, w, 3) as PNG."""
    import cv2  # not above: the show looks characters up, but reads none

    options = [cv2.IMWRITE_PNG_COMPRESSION, compression]
    if compression == 1:  # for photographs faster than the usual search, and smaller
        options += [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
        if hasattr(cv2, "IMWRITE_PNG_FILTER"):  # since OpenCV 4.12
            options += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
    done, data = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise OSError("the picture cannot be encoded")
    return data.tobytes()


def load_character(folder: Path) -> Character:
    """Raises `DataError` CHAR-ABSENT, CHAR-READ; `ConfigError` CFG-* for its character.toml."""
    if not paths.is_file(folder / "character.toml"):
        raise _absent(str(folder))
    settings = load(CharacterSettings, folder / "character.toml")
    if settings.version != VERSION:
        raise _other_version(folder, "", settings.version)
    texture = _read_image(folder / "texture.png")
    eyes = _read_image(folder / "eyes.png")
    if texture.shape[0] != texture.shape[1] or texture.shape[0] not in _SIDES:
        raise _unreadable(folder, f"texture.png is {texture.shape[1]} x {texture.shape[0]}")
    if eyes.shape[1] != 320 or eyes.shape[0] != 112:
        raise _unreadable(folder, f"eyes.png is {eyes.shape[1]} x {eyes.shape[0]}")
    landmarks = _read_landmarks(folder)
    photo, record = _read_photo(folder), _read_record(folder)
    described = settings.name, settings.source, settings.date
    return Character(*described, texture, eyes, landmarks, photo, record)


def _read_image(path: Path) -> Image:
    import cv2

    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    except (OSError, cv2.error):
        image = None
    if image is None:
        raise _unreadable(path.parent, f"{path.name} is not a picture")
    return np.ascontiguousarray(image[..., ::-1], np.uint8)


def _read_landmarks(folder: Path) -> NDArray[np.float64] | None:
    path = folder / "landmarks.json"
    if not path.exists():
        return None
    try:
        points = np.array(json.loads(path.read_text("utf-8"))["points_px"], float)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _unreadable(folder, f"landmarks.json: {error}") from error
    if points.shape != (468, 3) or not np.isfinite(points).all():
        raise _unreadable(folder, "landmarks.json does not hold 468 points")
    return points


def _read_photo(folder: Path) -> bytes | None:
    path = folder / "photo.jpg"
    try:
        return path.read_bytes() if path.exists() else None
    except OSError as error:
        raise _unreadable(folder, f"photo.jpg: {error.strerror or error}") from error


def _read_record(folder: Path) -> Mapping[str, Any] | None:
    path = folder / "source.json"
    if not path.exists():
        return None
    try:
        record = json.loads(path.read_text("utf-8"))
        version = record.pop("version")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise _unreadable(folder, f"source.json: {error}") from error
    if version != VERSION:
        raise _other_version(folder, "source.json: ", version)
    return dict(record)


def _other_version(folder: Path, part: str, version: object) -> DataError:
    return DataError(
        "CHAR-READ",
        f"the character {folder} cannot be read: {part}its version is {version}, known is "
        f"{VERSION}",
        "It was made by a newer program: use that one, or build the character again.",
    )


def _unreadable(folder: Path, why: str) -> DataError:
    return DataError(
        "CHAR-READ", f"the character {folder} cannot be read: {why}", "Build it again."
    )


def _absent(name: str) -> DataError:
    known = ", ".join(known_characters()) or "none"
    return DataError(
        "CHAR-ABSENT",
        f"there is no character '{name}'",
        f"Known: {known}. Make one with 'hypermask face build PHOTO --name NAME'.",
    )


def _shelves() -> tuple[Path, Path]:
    return paths.home() / "characters", paths.configs() / "characters"


def known_characters() -> list[str]:
    """Names of all characters, the user's and the built-in ones."""
    return sorted(
        {file.parent.name for shelf in _shelves() for file in shelf.glob("*/character.toml")}
    )


def find_character(name: str | Path) -> Path:
    """The folder of a character by its name (the user's before the built-in ones) or its path.

    Raises `DataError` CHAR-ABSENT, which names the known ones.
    """
    given = Path(name)
    candidates = [given] if given.name != str(name) else []
    candidates += [shelf / str(name) for shelf in _shelves() if _NAME.fullmatch(str(name))]
    candidates.append(given)
    # A folder into which one character was built stands for that character.
    inner = given.glob("*/character.toml") if paths.is_folder(given) else ()
    within = [file.parent for file in inner]
    candidates += within if len(within) == 1 else []
    for folder in candidates:
        if paths.is_file(folder / "character.toml"):
            return folder
    raise _absent(str(name))
