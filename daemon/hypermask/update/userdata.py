"""What the user made, over upgrades and back.

Formats carry a version, and a program reads what older ones wrote. The other way round an old
program can promise nothing about formats that did not exist. So before a version goes, what it
could read is put aside (hard links: no copy, and every writer here replaces files instead of
changing them); after a rollback whatever the old version cannot read comes back from there, and
the newer file is kept beside it as NAME.newer. Root does this, in folders of the show's user: a
link there is copied as a link, and what lies behind one is neither kept nor replaced.

`python3 -m hypermask.update.userdata [--mend FOLDER]` is how one version asks another one's code.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from hypermask import paths
from hypermask.errors import HypermaskError

KINDS = ("calibration", "characters", "expressions", "machine", "shows", "voices")
NEWER = ".newer"


@dataclass(frozen=True)
class Finding:
    """path: of a file or a character's folder, from `paths.home()` on. problem: why it cannot be
    read, None where it can."""

    path: str
    problem: str | None


def put_aside(folder: Path) -> None:
    """Links to everything there is now, as a whole or not at all. Raises OSError."""
    new = folder.with_name(f".{folder.name}.new")
    shutil.rmtree(new, ignore_errors=True)
    for kind in KINDS:
        source = paths.home() / kind
        if source.is_dir() and not source.is_symlink():
            shutil.copytree(source, new / kind, symlinks=True, copy_function=_link, ignore=_hidden)
    new.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(folder, ignore_errors=True)
    new.replace(folder)


def _link(source: str, copy: str) -> None:
    try:
        os.link(source, copy, follow_symlinks=False)
    except OSError:
        shutil.copy2(source, copy, follow_symlinks=False)


def _hidden(folder: str, names: list[str]) -> list[str]:
    return [name for name in names if name.startswith(".") or name.endswith(NEWER)]


def look() -> list[Finding]:
    """Everything of the user's, opened by this program."""
    return [Finding(name, _problem(read)) for name, read in _things()]


def mend(before: Path) -> list[Finding]:
    """Put back from `before` what this program cannot read; tells what it could not mend."""
    left = []
    for finding in look():
        if finding.problem is None:
            continue
        old, now = before / finding.path, paths.home() / finding.path
        if not old.exists() or _linked(old, before) or _linked(now.parent, paths.home()):
            left.append(finding)
            continue
        with contextlib.suppress(OSError):
            newer = now.with_name(now.name + NEWER)
            shutil.rmtree(newer, ignore_errors=True)
            newer.unlink(missing_ok=True)
            now.replace(newer)
            _copy(old, now)
    return left + [finding for finding in look() if finding.problem and finding not in left]


def _linked(path: Path, root: Path) -> bool:
    """Whether something below `root` on the way to `path` is a link."""
    return any(step.is_symlink() for step in (path, *path.parents) if root in step.parents)


def _copy(old: Path, now: Path) -> None:
    """In the owner's name, whoever mends."""
    owner = now.parent.stat(follow_symlinks=False)
    if old.is_dir():
        shutil.copytree(old, now, symlinks=True)
    else:
        shutil.copy2(old, now, follow_symlinks=False)
    for path in (now, *now.rglob("*")):
        with contextlib.suppress(PermissionError):
            os.chown(path, owner.st_uid, owner.st_gid, follow_symlinks=False)


def _problem(read: Callable[[], object]) -> str | None:
    try:
        read()
    except HypermaskError as error:
        return str(error)
    except Exception as error:  # whatever an old reader makes of a new file
        return f"{type(error).__name__}: {error}"
    return None


def _things() -> Iterator[tuple[str, Callable[[], object]]]:
    from hypermask.calibration import storage
    from hypermask.config import read_toml
    from hypermask.face.character import load_character
    from hypermask.face.expressions import load_expression
    from hypermask.machine.files import validated
    from hypermask.show.showfile import load_show
    from hypermask.voice import speaker

    def good_machine(path: Path) -> object:
        return validated(read_toml(path), str(path))

    readers: dict[str, tuple[str, Callable[[Path], object]]] = {
        "calibration": ("[0-9]*.json", storage.read),
        "characters": ("*/character.toml", lambda path: load_character(path.parent)),
        "expressions": ("*.toml", load_expression),
        "machine": ("last-good.toml", good_machine),
        "shows": ("*.toml", load_show),
        "voices": ("[0-9]*.npz", speaker.load),
    }
    for kind in KINDS:
        pattern, read = readers[kind]
        for path in sorted((paths.home() / kind).glob(pattern)):
            thing = path.parent if kind == "characters" else path
            hidden = thing.name.startswith(".") or thing.name.endswith(NEWER)
            if not hidden:
                name = str(thing.relative_to(paths.home()))
                yield name, lambda path=path, read=read: read(path)  # type: ignore[misc]


def main(arguments: list[str]) -> int:
    """Prints JSON; exit code 1 when something cannot be read."""
    parser = argparse.ArgumentParser(prog="hypermask.update.userdata")
    parser.add_argument("--mend", type=Path, help="folder with what was put aside")
    options = parser.parse_args(arguments)
    found = mend(options.mend) if options.mend else [one for one in look() if one.problem]
    print(json.dumps([asdict(finding) for finding in found]))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
