"""What calibration learnt of one actor: kept on disk, used by every show after it.

Folder `paths.home()/voices`: `0003.npz` each with a format version and a check sum, `current` with
the name of the one in use. Numbers give the order, not dates: a board without a battery clock may
boot in 1970.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.errors import DataError
from hypermask.storage import write_atomically
from hypermask.voice import recurrent
from hypermask.voice.recurrent import LOOKAHEADS, UNITS, Recurrent
from hypermask.voice.visemes import CLASSES

VERSION = 2  # of the network that a correction belongs to, too
CURRENT = "current"

_SHAPE = (UNITS + 1, len(CLASSES))


@dataclass(frozen=True)
class Speaker:
    """name: as the actor is called; paper_net: the best of the data base for paper mode.

    correction: (UNITS + 1, classes), added to the output layer's weights (last row: bias) of the
    default network; zeros where calibration could not better it.
    """

    name: str
    paper_net: str | None
    correction: NDArray[np.float32]

    def adapted(self, network: Recurrent) -> Recurrent:
        return replace(
            network,
            output=network.output + np.tile(self.correction[:-1], (1, LOOKAHEADS)),
            output_bias=network.output_bias + np.tile(self.correction[-1], LOOKAHEADS),
        )


def unknown(name: str = "") -> Speaker:
    return Speaker(name, None, np.zeros(_SHAPE, np.float32))


def folder() -> Path:
    return paths.home() / "voices"


def save(speaker: Speaker) -> Path:
    """Keep a speaker and make him the current one. Raises `HypermaskError` DISK-WRITE."""
    number = max((int(path.stem) for path in _files()), default=0) + 1
    path = folder() / f"{number:04d}.npz"
    correction = speaker.correction.astype(np.float32)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        version=np.int64(VERSION),
        name=np.array(speaker.name),
        paper_net=np.array(speaker.paper_net or ""),
        correction=correction,
        sha256=np.array(_digest(correction)),
        network=np.array(_network()),
    )
    write_atomically(path, buffer.getvalue())
    write_atomically(folder() / CURRENT, f"{path.name}\n".encode())
    return path


def load(path: Path) -> Speaker:
    """Raises `DataError` VOICE-SPEAKER: absent, damaged, or of another version."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            version, correction = int(stored["version"]), stored["correction"]
            speaker = Speaker(str(stored["name"]), str(stored["paper_net"]) or None, correction)
            sound = str(stored["sha256"]) == _digest(correction)
            network = str(stored["network"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise _unusable(path, f"it cannot be read ({error})") from error
    if version != VERSION or correction.shape != _SHAPE:
        raise _unusable(path, "it is of another version of the program")
    if not sound or not np.isfinite(correction).all():
        raise _unusable(path, "its check sum is wrong")
    if network != _network():
        raise _unusable(path, "it was learnt with another voice network")
    return speaker


def load_current() -> tuple[Speaker | None, str | None]:
    """The speaker in use, None where nobody was calibrated; a warning where he cannot be used.

    A damaged current file is replaced by the newest good one, and the warning says so.
    """
    files = sorted(_files(), reverse=True)
    wanted = _pointed()
    if wanted == "none" or not files:
        return None, None
    files.sort(key=lambda path: path.name != wanted)
    problem: DataError | None = None
    for path in files:
        try:
            speaker = load(path)
        except DataError as error:
            problem = problem or error
            continue
        if problem is None:
            return speaker, None
        return speaker, f"{problem.code}: {problem.what}. {path.name} is used."
    assert problem is not None
    return None, f"{problem.code}: {problem.what}. The voice is followed without calibration."


def forget() -> None:
    """From now on nobody's calibration is used; the files stay. Raises DISK-WRITE."""
    write_atomically(folder() / CURRENT, b"none\n")


def _pointed() -> str:
    try:
        return (folder() / CURRENT).read_text("utf-8").strip()
    except (OSError, UnicodeDecodeError):
        return ""


def _files() -> list[Path]:
    return [path for path in folder().glob("*.npz") if path.stem.isascii() and path.stem.isdigit()]


def _digest(correction: NDArray[np.float32]) -> str:
    return hashlib.sha256(correction.astype(np.float32).tobytes()).hexdigest()


def _network() -> str:
    """Of the network as shipped: a correction fits that one only."""
    data = Path(recurrent.__file__).parent / "data" / "default.npz"
    return hashlib.sha256(data.read_bytes()).hexdigest()


def _unusable(path: Path, why: str) -> DataError:
    return DataError(
        "VOICE-SPEAKER",
        f"the voice calibration {path} cannot be used: {why}",
        "Calibrate the voice again (hypermask voice calibrate).",
    )
