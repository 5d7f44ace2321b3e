"""Where the show that runs on this machine can be found: a link to its blackboard's folder."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from hypermask import paths
from hypermask.errors import DataError

_LINK = "current"


@contextlib.contextmanager
def announced(board: Path) -> Iterator[None]:
    """While this lasts, `running_board` finds `board`. Of several shows the last one is found."""
    link = paths.run() / _LINK
    with contextlib.suppress(OSError):  # a show can do without being found
        link.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        new = link.with_name(f".{_LINK}.{os.getpid()}")
        new.unlink(missing_ok=True)
        new.symlink_to(board.resolve())
        new.replace(link)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            if link.readlink() == board.resolve():
                link.unlink()


def running_board() -> Path:
    """The blackboard's folder of the running show: of a rehearsal, else of the services, also when
    they have died. Raises `DataError` SHOW-NONE."""
    for folder in (run / name for run in paths.run_folders() for name in (_LINK, "board")):
        try:
            (folder / "scene").stat()
        except PermissionError as error:
            raise DataError(
                "BOARD-RIGHTS",
                f"{folder} may not be looked at",
                "Join the group hypermask (adduser YOU hypermask, and log in again), or use sudo.",
            ) from error
        except OSError:
            continue
        return folder.resolve()
    raise DataError("SHOW-NONE", "no show is running on this machine", "Start one.")
