"""Fixed-layout records that one process writes and many read, without locks or waiting.

A record is a memory-mapped file (under /run on the appliance) with a sequence lock: the writer
makes the sequence number odd, copies the record, makes it even; a reader copies and looks whether
the number stayed the same and even. Plain files rather than `multiprocessing.shared_memory`, whose
segments Python 3.11 unlinks when any attached process exits.
"""

from __future__ import annotations

import mmap
import os
import time
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hypermask.errors import HypermaskError

Record = NDArray[np.void]

_MAGIC = b"HYPRMASK"
_HEADER = np.dtype([("magic", "S8"), ("layout", "<u8"), ("sequence", "<u8")])
_ATTEMPTS = 200
_PATIENCE, _PAUSE_S = 20, 0.002
"""Of an onlooker, who has time."""


class Topic(Protocol):
    """A place for the newest record of one kind."""

    def publish(self, record: Record) -> None:
        """Replace the record (a structured scalar of the topic's dtype)."""
        ...

    def latest(self) -> Record | None:
        """A copy of the newest record, or None when nothing was published yet."""
        ...


class LocalTopic:
    """A topic inside one process, for lock-step runs."""

    def __init__(self) -> None:
        self._record: Record | None = None

    def publish(self, record: Record) -> None:
        self._record = record.copy()

    def latest(self) -> Record | None:
        return self._record


class SharedTopic:
    """A topic in a memory-mapped file; one writer process, any number of readers.

    mode: of the file where it is made. Raises `HypermaskError` BOARD-LAYOUT when the file was made
    by another version of the program, BOARD-RIGHTS, DISK-WRITE when there is no room for it.
    """

    def __init__(self, path: Path, dtype: np.dtype[np.void], mode: int = 0o640) -> None:
        self._dtype = dtype
        size = _HEADER.itemsize + dtype.itemsize
        try:
            self._map = _mapped(path, size, mode)
        except PermissionError as error:
            raise HypermaskError(
                "BOARD-RIGHTS", f"{path} may not be written", "Become root (sudo)."
            ) from error
        except OSError as error:
            raise HypermaskError(
                "DISK-WRITE",
                f"cannot make {path}: {error.strerror or error}",
                "Free some space there or check the folder's rights.",
            ) from error
        self._header = np.frombuffer(self._map, _HEADER, count=1)
        self._body = np.frombuffer(self._map, dtype, count=1, offset=_HEADER.itemsize)
        self._claim(path)

    def _claim(self, path: Path) -> None:
        layout = _layout_number(self._dtype)
        if self._header["magic"][0] == b"":
            self._header["layout"][0] = layout
            self._header["magic"][0] = _MAGIC
        elif self._header["magic"][0] != _MAGIC or self._header["layout"][0] != layout:
            raise _other_version(path)

    def publish(self, record: Record) -> None:
        sequence = self._header["sequence"]
        # A writer that died in the middle left an odd number: the next one stays odd while writing.
        sequence[0] = sequence[0] | np.uint64(1)
        self._body[0] = record
        sequence[0] += np.uint64(1)

    def latest(self) -> Record | None:
        return _newest(self._header, self._body)


class ReadTopic:
    """A `SharedTopic` for somebody who only looks: a file that is not there is nothing published.

    Raises `HypermaskError` BOARD-LAYOUT, BOARD-RIGHTS.
    """

    def __init__(self, path: Path, dtype: np.dtype[np.void]) -> None:
        self._path, self._dtype = path, dtype
        self._map: tuple[Record, Record] | None = None
        self._attach()

    def _attach(self) -> None:
        size = _HEADER.itemsize + self._dtype.itemsize
        try:
            with self._path.open("rb") as file:
                if os.fstat(file.fileno()).st_size < size:
                    return
                mapped = mmap.mmap(file.fileno(), size, prot=mmap.PROT_READ)
        except FileNotFoundError:
            return
        except PermissionError as error:
            raise HypermaskError(
                "BOARD-RIGHTS", f"{self._path} may not be read", "Join the group hypermask."
            ) from error
        header = np.frombuffer(mapped, _HEADER, count=1)
        if header["magic"][0] == b"":
            return
        if header["magic"][0] != _MAGIC or header["layout"][0] != _layout_number(self._dtype):
            raise _other_version(self._path)
        self._map = header, np.frombuffer(mapped, self._dtype, 1, _HEADER.itemsize)

    def publish(self, record: Record) -> None:
        raise TypeError("this topic is open for reading only")

    def latest(self) -> Record | None:
        if self._map is None:
            self._attach()
        if self._map is None:
            return None
        for _ in range(_PATIENCE):
            found = _newest(*self._map)
            if found is not None or not self._map[0]["sequence"][0]:
                return found
            time.sleep(_PAUSE_S)  # a writer lost its processor in the middle of writing
        return None


def _newest(header: Record, body: Record) -> Record | None:
    """A copy that no writer was in the middle of, None where there is none."""
    sequence = header["sequence"]
    for _ in range(_ATTEMPTS):
        before = int(sequence[0])
        if before == 0:
            return None
        if before % 2:
            continue
        copy: Record = body[0].copy()
        if int(sequence[0]) == before:
            return copy
    return None


def _other_version(path: Path) -> HypermaskError:
    return HypermaskError(
        "BOARD-LAYOUT",
        f"{path} was made by another version of the program",
        "Stop every hypermask process and remove the file.",
    )


def _mapped(path: Path, size: int, mode: int) -> mmap.mmap:
    """A file of at least `size` bytes in memory. Its pages are there: on a full disk, writing to
    one that is not would kill the process (SIGBUS)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, mode)
    try:
        os.posix_fallocate(descriptor, 0, size)
        return mmap.mmap(descriptor, size)
    finally:
        os.close(descriptor)


def _layout_number(dtype: np.dtype[np.void]) -> int:
    """A number that differs between record layouts (FNV-1a of the dtype's description)."""
    number = 0xCBF29CE484222325
    for byte in repr(dtype.descr).encode():
        number = ((number ^ byte) * 0x100000001B3) % 2**64
    return number
