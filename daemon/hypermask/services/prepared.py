"""What a stage prepared for its next start: all that the first face needs, as plain arrays.

A file of one line of JSON and then the arrays. It is made by a stage that plays, in its spare
time, and believed only while every file that it was made from is as it was then.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hypermask import paths
from hypermask.errors import HypermaskError

VERSION = 1
Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Prepared:
    """table: what is not an array; arrays: by their names, read-only."""

    table: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


def path() -> Path:
    return paths.home() / "cache" / "overture"


def state_of(files: Iterable[Path]) -> list[list[Any]]:
    """What tells whether files, or folders' lists of them, have changed."""
    found: list[list[Any]] = []
    for file in files:
        try:
            stat = file.stat()
            mark = [stat.st_mtime_ns, stat.st_size, stat.st_ino]
        except OSError:
            mark = []
        found.append([str(file), mark])
    return found


def still_true(states: Iterable[list[Any]]) -> bool:
    """Whether `state_of` would say the same again."""
    return all(state_of([Path(file)])[0][1] == mark for file, mark in states)


def description(dtype: np.dtype[Any]) -> list[Any]:
    """A record's layout as JSON can hold it; `layout` is the way back."""
    found: list[Any] = json.loads(json.dumps(dtype.descr))
    return found


def layout(descr: list[Any]) -> np.dtype[Any]:
    def field(entry: list[Any]) -> tuple[Any, ...]:
        name, kind, *shape = entry
        inner = kind if isinstance(kind, str) else [field(part) for part in kind]
        return (name, inner, *(tuple(size) for size in shape))

    return np.dtype([field(entry) for entry in descr])


def write(file: Path, table: Mapping[str, Any], arrays: Arrays) -> None:
    """Raises `HypermaskError` DISK-WRITE."""
    from hypermask.storage import write_atomically

    whole = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    head = {
        "overture": VERSION,
        "table": table,
        "arrays": [[name, array.dtype.str, array.shape] for name, array in whole.items()],
    }
    parts = [array.tobytes() for array in whole.values()]
    write_atomically(file, b"".join([json.dumps(head).encode(), b"\n", *parts]))


def read(file: Path) -> Prepared | None:
    """None where there is none that can be used: then the stage starts the long way."""
    try:
        data = file.read_bytes()
        end = data.index(b"\n")
        head = json.loads(data[:end])
        if head["overture"] != VERSION:
            return None
        arrays, offset = {}, end + 1
        for name, kind, shape in head["arrays"]:
            count = int(np.prod(shape, dtype=int))
            arrays[name] = np.frombuffer(data, kind, count, offset).reshape(shape)
            offset += arrays[name].nbytes
        return Prepared(head["table"], arrays)
    except (OSError, ValueError, KeyError, TypeError, HypermaskError):
        return None
