"""Which show plays: the one of the machine file, or the default one where that cannot be played."""

from __future__ import annotations

from pathlib import Path

from hypermask import paths
from hypermask.errors import ConfigError, HypermaskError
from hypermask.show.expressions import expressions_of
from hypermask.show.showfile import ShowFile, load_show
from hypermask.workers.retry import Report

DEFAULT = "default"
LAST_RESORT = "mean"
"""The character that plays where no show file at all can be read."""


def show_path(name: str) -> Path:
    """A path as it is, or a show of that name, the user's first. Raises `ConfigError` SHOW-NAME."""
    given = Path(name)
    candidates = [given] if given.suffix == ".toml" else []
    candidates += [folder / f"{name}.toml" for folder in _shelves()] if "/" not in name else []
    for path in candidates:
        if paths.is_file(path):
            return path
    known = sorted({path.stem for folder in _shelves() for path in folder.glob("*.toml")})
    raise ConfigError(
        "SHOW-NAME",
        f"there is no show '{name}'",
        f"Known: {', '.join(known) or 'none'}.{paths.hint(name)}",
    )


def _shelves() -> tuple[Path, Path]:
    return paths.home() / "shows", paths.configs() / "shows"


def checked_show(name: str) -> ShowFile:
    """A show all of whose cues can be played. Raises `ConfigError` CFG-*, SHOW-*, EXPR-READ."""
    path = show_path(name)
    show = load_show(path)
    expressions_of(show, str(path))
    return show


def playable_show(name: str, report: Report, now_s: float) -> ShowFile:
    """`checked_show`, or what can be played in its place, said loudly: the show must go on."""
    for choice in dict.fromkeys((name, DEFAULT)):
        try:
            return checked_show(choice)
        except HypermaskError as error:
            instead = "the default show" if choice != DEFAULT else f"'{LAST_RESORT}' alone"
            report(
                now_s,
                "SHOW-FALLBACK",
                f"SHOW-FALLBACK: the show '{choice}' cannot be played ({error}) "
                f"Now {instead} plays.",
            )
    return ShowFile(version=1, name="last resort", characters=(LAST_RESORT,))
