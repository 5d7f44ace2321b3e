"""Where the program finds its own files and keeps the user's."""

from __future__ import annotations

import os
from pathlib import Path

_REPOSITORY = Path(__file__).resolve().parents[2]


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


def home() -> Path:
    """The folder that holds what the user makes: characters, calibrations, voices, shows."""
    override = os.environ.get("HYPERMASK_HOME")
    if override:
        return Path(override)
    appliance = Path("/var/lib/hypermask")
    if appliance.is_dir() and os.access(appliance, os.W_OK):
        return appliance
    base = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(base) / "hypermask"


def run() -> Path:
    """The folder of what lives as long as a show: /run/hypermask on the appliance."""
    override = os.environ.get("HYPERMASK_RUN")
    if override:
        return Path(override)
    appliance = Path("/run/hypermask")
    if appliance.is_dir() and os.access(appliance, os.W_OK):
        return appliance
    base = os.environ.get("XDG_RUNTIME_DIR")
    return Path(base) / "hypermask" if base else Path(f"/tmp/hypermask-{os.getuid()}")
