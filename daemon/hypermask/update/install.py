"""Installing a package over a running show, and going back."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from hypermask.errors import HypermaskError, UsageError
from hypermask.update.dpkg import PACKAGE, SIMULATOR, Dpkg, Package
from hypermask.update.keep import keep
from hypermask.update.shelf import Shelf

SHARE = Path("/usr/share/hypermask")
_TIMES = 4
"""Free space as a multiple of the package's size: the kept copy, the files, and dpkg's new ones."""

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Installed:
    """before: None on a first installation."""

    version: str
    before: str | None


def install(paths: Sequence[Path], shelf: Shelf, dpkg: Dpkg, tell: Tell) -> Installed:
    """Raises `UsageError` UPD-ROOT, UPD-OTHER; `DataError` UPD-FILE, UPD-DAMAGED; `HypermaskError`
    UPD-SPACE, UPD-KEEP, UPD-FAILED. The version that was there is there after any of them."""
    _check_rights(dpkg)
    packages = [dpkg.package(path) for path in paths]
    main = _main(packages)
    _check_space(packages, shelf)
    before = dpkg.version()
    earlier = shelf.previous
    keep(shelf, dpkg, [])
    kept = [shelf.keep(package) for package in packages]
    _hold_on()
    tell(f"Installing {main.name} {main.version} over {before or 'nothing'} ...")
    shelf.begin(kept)
    done, said = dpkg.install(kept)
    if not done or dpkg.version() != main.version:
        shelf.set_previous(earlier)
        _put_back(before, shelf, dpkg, said)
    shelf.end()
    if before is not None and before != main.version:
        shelf.set_previous(before)
    shelf.prune()
    return Installed(main.version, before)


def rollback(shelf: Shelf, dpkg: Dpkg, tell: Tell) -> Installed:
    """To the version before the installed one; a second one comes back to the newer.

    Raises what `install` does, and `HypermaskError` UPD-NONE.
    """
    _check_rights(dpkg)
    version = shelf.previous
    path = shelf.kept(version) if version else None
    if version is None or path is None:
        raise HypermaskError(
            "UPD-NONE",
            "there is no earlier version to go back to",
            "Give its package: hypermask update install FILE.deb",
        )
    files = [path]
    simulator = shelf.kept(version, SIMULATOR)
    if simulator is not None and dpkg.version(SIMULATOR) is not None:
        files.append(simulator)
    done = install(files, shelf, dpkg, tell)
    _mend(shelf.data(version), tell)
    return done


def _mend(before: Path, tell: Tell) -> None:
    """By the code that is installed now: it knows best what it can read."""
    if not before.is_dir() or not SHARE.is_dir():
        return
    asked = subprocess.run(
        [sys.executable, "-m", "hypermask.update.userdata", "--mend", str(before)],
        env={**os.environ, "PYTHONPATH": str(SHARE / "python"), "PYTHONSAFEPATH": "1"},
        capture_output=True,
        text=True,
    )
    try:
        left = json.loads(asked.stdout)
    except ValueError:
        tell(f"UPD-DATA: what the user made could not be checked: {asked.stderr.strip()[-200:]}")
        return
    for finding in left:
        tell(f"UPD-DATA: {finding['path']} cannot be read by this version: {finding['problem']}")


def _put_back(before: str | None, shelf: Shelf, dpkg: Dpkg, said: str) -> None:
    """The version that was there, if it went; then the error."""
    back = ""
    path = shelf.kept(before) if before else None
    if before is not None and not (dpkg.version() == before and dpkg.whole()):
        done = path is not None and dpkg.install([path])[0]
        back = f" Version {before} is back." if done else f" Version {before} could not come back."
        if not done:
            raise HypermaskError(
                "UPD-FAILED",
                f"the installation failed: {said}.{back}",
                "Start the machine anew: it tries again by itself.",
            )
    shelf.end()
    raise HypermaskError(
        "UPD-FAILED", f"the installation failed: {said}.{back}", "Nothing else was changed."
    )


def _main(packages: Sequence[Package]) -> Package:
    strangers = [one.name for one in packages if one.name not in (PACKAGE, SIMULATOR)]
    found = [one for one in packages if one.name == PACKAGE]
    if strangers or len(found) != 1:
        raise UsageError(
            "UPD-OTHER",
            f"{strangers[0]} is not hypermask" if strangers else "one hypermask_*.deb is needed",
            "Give a hypermask_*.deb, and a hypermask-sim_*.deb with it if that is installed.",
        )
    return found[0]


def _check_rights(dpkg: Dpkg) -> None:
    if os.geteuid() != 0 and not dpkg.elsewhere:
        raise UsageError("UPD-ROOT", "installing needs the rights of root", "Use sudo.")


def _check_space(packages: Sequence[Package], shelf: Shelf) -> None:
    needed = _TIMES * sum(package.path.stat().st_size for package in packages) + (4 << 20)
    for folder in (shelf.folder, SHARE):
        while not folder.exists():
            folder = folder.parent
        free = shutil.disk_usage(folder).free
        if free < needed:
            raise HypermaskError(
                "UPD-SPACE",
                f"{folder} has {free >> 20} MB left, {needed >> 20} MB are needed",
                "Free some space; nothing was changed.",
            )


def _hold_on() -> None:
    """A technician who hangs up does not stop an installation half-way."""
    for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
