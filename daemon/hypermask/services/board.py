"""The blackboard of the services, made anew where another version of the program left its own."""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from hypermask import paths
from hypermask.errors import HypermaskError
from hypermask.workers.board import Board


def board_folder() -> Path:
    return paths.run() / "board"


def open_board() -> Board:
    """Raises `HypermaskError` DISK-WRITE where there is no room for it."""
    folder = board_folder()
    with _alone():
        try:
            return Board.shared(folder)
        except HypermaskError as error:
            if error.code != "BOARD-LAYOUT":
                raise
            _put_aside(folder)
            return Board.shared(folder)


def number_of(folder: Path) -> int | None:
    """Tells one blackboard from the next of the same name; None while there is none."""
    try:
        return folder.stat().st_ino
    except OSError:
        return None


@contextlib.contextmanager
def _alone() -> Iterator[None]:
    """Two services that start together do not make the folder twice."""
    folder = paths.run()
    folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(folder / ".board.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o660)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


def _put_aside(folder: Path) -> None:
    """Out of the way in one step; those who still have it open keep what they have."""
    old = folder.with_name(f".board.old.{os.getpid()}")
    shutil.rmtree(old, ignore_errors=True)
    folder.rename(old)
    shutil.rmtree(old, ignore_errors=True)
