"""`python3 -m hypermask.update.keep [FILE.deb...]`: the way back, before anybody installs.

Called by apt's hook (which gives the files on standard input) and by the packages' preinst, so that
a rollback works however the package came: the given packages and the installed one are kept, and
what the user made until now is put aside. Never a reason for an upgrade to fail.

`--replaced NAME VERSION`, from the preinst: its package's files are all there still, but dpkg has
already written down that it is only half installed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from hypermask.errors import HypermaskError
from hypermask.update import userdata
from hypermask.update.dpkg import PACKAGE, SIMULATOR, Dpkg
from hypermask.update.shelf import Shelf, shelf_folder


def keep(
    shelf: Shelf, dpkg: Dpkg, files: Iterable[Path], replaced: tuple[str, str] | None = None
) -> None:
    """replaced: name and version of what is there, whatever dpkg says of it.

    Raises `HypermaskError` UPD-*, OSError."""
    there: dict[str, str | None] = dict([replaced] if replaced else [])
    for name in (PACKAGE, SIMULATOR):
        version = there.setdefault(name, dpkg.version(name))
        if version is not None:
            shelf.keep_installed(name, version)
    version = there[PACKAGE]
    if version is not None:
        userdata.put_aside(shelf.data(version))
    for path in files:
        package = dpkg.package(path)
        if package.name in (PACKAGE, SIMULATOR):
            shelf.keep(package)


def main(arguments: list[str]) -> int:
    replaced = None
    if arguments[:1] == ["--replaced"]:
        replaced, arguments = (arguments[1], arguments[2]), arguments[3:]
    given = "" if arguments or sys.stdin.isatty() else sys.stdin.read()
    named = arguments or given.split()
    files = [Path(name) for name in named if Path(name).name.startswith(PACKAGE)]
    dpkg = Dpkg()
    shelf = Shelf(shelf_folder(), dpkg)
    if named and not files:
        return 0  # apt installs something else
    try:
        keep(shelf, dpkg, files, replaced)
    except (HypermaskError, OSError) as error:
        print(error, file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
