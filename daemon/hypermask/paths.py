"""Where the program finds its own files and keeps the user's."""

from __future__ import annotations

import os
from pathlib import Path

_REPOSITORY = Path(__file__).resolve().parents[2]
APPLIANCE_HOME = Path("/var/lib/hypermask")
APPLIANCE_RUN = Path("/run/hypermask")


def share() -> Path:
    """The folder with `configs/` that came with the program: a checkout or /usr/share/hypermask."""
    override = os.environ.get("HYPERMASK_SHARE")
    if override:
        return Path(override)
    if (_REPOSITORY / "configs").is_dir():
        return _REPOSITORY
    return Path("/usr/share/hypermask")


def configs() -> Path:
    return share() / "configs"


def models() -> Path:
    """The folder with the converted face models (`make models`)."""
    override = os.environ.get("HYPERMASK_MODELS")
    if override:
        return Path(override)
    built = share() / "build" / "models"
    return built if built.is_dir() else share() / "models"


def is_file(path: Path) -> bool:
    """Whether there is such a file and it may be looked at; no impossible name is an error."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_folder(path: Path) -> bool:
    """As `is_file`."""
    try:
        return path.is_dir()
    except OSError:
        return False


def hint(name: str) -> str:
    """A sentence for whoever named a place that the appliance's services never see."""
    if not name.startswith(("/home/", "/root/", "/tmp/", "/var/tmp/")):
        return ""
    return " The show's services see nothing of /home, /root, /tmp: put it into /var/lib/hypermask."


def home() -> Path:
    """The folder that holds what the user makes: characters, calibrations, voices, shows."""
    override = os.environ.get("HYPERMASK_HOME")
    if override:
        return Path(override)
    if is_folder(APPLIANCE_HOME) and _is_ours(APPLIANCE_HOME):
        return APPLIANCE_HOME
    base = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(base) / "hypermask"


def run() -> Path:
    """The folder of what lives as long as a show: /run/hypermask on the appliance."""
    override = os.environ.get("HYPERMASK_RUN")
    if override:
        return Path(override)
    if is_folder(APPLIANCE_RUN) and _is_ours(APPLIANCE_RUN):
        return APPLIANCE_RUN
    base = os.environ.get("XDG_RUNTIME_DIR")
    return Path(base) / "hypermask" if base else Path(f"/tmp/hypermask-{os.getuid()}")


def run_folders() -> tuple[Path, ...]:
    """Where a show that runs on this machine may be found: `run()`, and the appliance's folder also
    for somebody who may not enter it, so that he is told so."""
    if os.environ.get("HYPERMASK_RUN") or not is_folder(APPLIANCE_RUN):
        return (run(),)
    return tuple(dict.fromkeys((run(), APPLIANCE_RUN)))


def _is_ours(folder: Path) -> bool:
    """Whether one may work there. A disk that went read-only does not make it another's."""
    if os.access(folder, os.W_OK):
        return True
    read_only = os.statvfs(folder).f_flag & os.ST_RDONLY
    return bool(read_only) and os.access(folder, os.R_OK | os.X_OK)
