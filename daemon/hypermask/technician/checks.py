"""Checks that make sense on every machine. Each returns words, or raises `HypermaskError`."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

from hypermask import paths
from hypermask.errors import HypermaskError

LEAST_FREE = 200_000_000
"""Bytes below which a character or a package may not fit any more."""
FOLDERS = ("calibration", "characters", "expressions", "machine", "shows", "voices")


def program(name: str, why: str) -> Callable[[], str]:
    def check() -> str:
        found = shutil.which(name)
        if found is None:
            raise HypermaskError("DOC-PROGRAM", f"{name} is absent, {why}", f"apt install {name}.")
        return found

    return check


def graphics() -> str:
    from hypermask_drivers.projector.gles import create_context

    context = create_context()
    name = f"{context.info['GL_RENDERER']}, {context.info['GL_VERSION']}"
    context.release()
    return name


def models() -> str:
    from hypermask.texture.landmarks import FaceFinder

    FaceFinder()
    return "both load"


def characters() -> str:
    from hypermask.face.character import find_character, known_characters, load_character

    for name in known_characters():
        load_character(find_character(name))
    return ", ".join(known_characters())


def show() -> str:
    """The show of this machine's files, or the default one."""
    from hypermask.machine.files import load
    from hypermask.services.playbill import checked_show

    try:
        name = load().machine.show
    except HypermaskError:  # said by the check of the configuration
        name = "default"
    found = checked_show(name)
    return f"{found.name}, {len(found.cues)} cues, {len(found.keys)} keys"


def configuration() -> str:
    from hypermask.machine.files import complaint, layer_paths, load

    loaded = load()
    if loaded.problem is not None:
        raise HypermaskError(
            "CFG-LASTGOOD", complaint(loaded).rstrip("."), "Mend it, then hypermask config check."
        )
    files = ", ".join(path.name for path in layer_paths()) or "the packaged file alone"
    return f"machine '{loaded.machine.name}' ({files})"


def calibration() -> str:
    from hypermask.calibration import storage

    if not storage.history():
        return "none yet: a rehearsal makes its own, a cart is calibrated with the keypad"
    _, warning = storage.load_current()
    if warning is not None:
        raise HypermaskError("DOC-CALIBRATION", warning.rstrip("."), "Calibrate again.")
    return f"{len(storage.history())} stored, the newest is good"


def folders() -> str:
    """Where the user's things and the running show live."""
    missing = [str(path) for path in _folders() if not path.is_dir()]
    if missing:
        raise HypermaskError(
            "DOC-FOLDER", f"missing: {', '.join(missing)}", "hypermask doctor --fix makes them."
        )
    locked = [str(path) for path in _folders() if not os.access(path, os.W_OK | os.X_OK)]
    if locked:
        raise HypermaskError(
            "DOC-FOLDER-RIGHTS",
            f"you may not write into {', '.join(locked)}",
            "Join the group hypermask, or use sudo.",
        )
    return f"{paths.home()} and {paths.run()}"


def _folders() -> list[Path]:
    return [paths.home(), *(paths.home() / name for name in FOLDERS), paths.run()]


def make_folders() -> str:
    """Only those that are missing; they get the owner and rights of the folder they are in."""
    made = []
    for path in _folders():
        if path.is_dir():
            continue
        try:
            path.mkdir(parents=True)
            above = path.parent.stat()
            if os.geteuid() == 0:
                os.chown(path, above.st_uid, above.st_gid)
            path.chmod(above.st_mode & 0o2777 & ~0o002)
        except OSError as error:
            raise HypermaskError(
                "DOC-FOLDER", f"cannot make {path}: {error.strerror or error}", "Use sudo."
            ) from error
        made.append(str(path))
    return f"made {', '.join(made)}" if made else "nothing to make"


def disk() -> str:
    folder = paths.home()
    while not folder.exists():
        folder = folder.parent
    usage = shutil.disk_usage(folder)
    free = f"{usage.free / 1e9:.2f} GB free of {usage.total / 1e9:.1f}"
    if usage.free < LEAST_FREE:
        raise HypermaskError(
            "DOC-DISK",
            f"the disk is almost full: {free}",
            f"Delete what is not needed in {folder}.",
        )
    if os.statvfs(folder).f_flag & os.ST_RDONLY:
        raise HypermaskError(
            "DOC-READONLY",
            "the disk is read-only: nothing is kept",
            "The kernel does so after errors of the disk: look at dmesg, replace the card.",
        )
    return free


def blackboard() -> str:
    """One that an older version left keeps a new show from starting."""
    from hypermask.workers.board import Board

    folder = paths.run() / "board"
    if not folder.is_dir():
        return "none: no show is running"
    Board.reading(folder)
    return "readable"


def remove_blackboard() -> str:
    """Only while no worker uses it."""
    from hypermask.technician.crew import alive
    from hypermask.workers.health import Healths

    folder = paths.run() / "board"
    living = [
        name
        for name, record in Healths(folder).all().items()
        if alive(int(record["pid"])) and time.monotonic() - float(record["time_s"]) < 60
    ]
    if living:
        raise HypermaskError(
            "DOC-BOARD",
            f"the blackboard is in use by {', '.join(living)}",
            "Stop the show first: systemctl stop hypermask.target.",
        )
    try:
        shutil.rmtree(folder)
    except OSError as error:
        raise HypermaskError(
            "DOC-BOARD", f"cannot remove {folder}: {error.strerror or error}", "Use sudo."
        ) from error
    return f"removed {folder}"


def heat(sysfs: Path = Path("/sys")) -> str:
    from hypermask.workers.thermal import HOT_C, read_heat, words_of

    found = read_heat(sysfs)
    degrees = (
        "temperature unknown"
        if found.temperature_c != found.temperature_c
        else (f"{found.temperature_c:.0f} degrees C")
    )
    words = words_of(found.flags) if found.known else "throttling unknown"
    if found.now or found.temperature_c >= HOT_C:
        raise HypermaskError(
            "DOC-HEAT", f"{degrees}, {words}", "Free the vents, look at the fan and the supply."
        )
    return f"{degrees}, {words}"
