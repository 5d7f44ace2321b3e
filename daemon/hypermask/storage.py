"""Writing what a user made: a power cut leaves the old or the new file, never half of one."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path

from hypermask.errors import HypermaskError


def write_atomically(path: Path, data: bytes) -> None:
    """Temporary file, fsync, rename, fsync of the directory.

    Raises `HypermaskError` DISK-WRITE (full, read-only, no rights); the old file is then unharmed.
    """
    temporary = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
        _fsync_folder(path.parent)
    except BaseException as error:
        if temporary:
            with contextlib.suppress(OSError):
                Path(temporary).unlink()
        if not isinstance(error, OSError):
            raise
        raise HypermaskError(
            "DISK-WRITE",
            f"cannot write {path}: {error.strerror or error}",
            "Free some space or check the folder's rights; the previous file is unharmed.",
        ) from error


def _fsync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
