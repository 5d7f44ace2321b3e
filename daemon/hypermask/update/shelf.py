"""The packages that are kept: the installed one and the one before it.

Folder /var/lib/hypermask/packages, which belongs to root: `NAME_VERSION_all.deb`, `previous` with
the version that was installed before the last upgrade (written by the package's preinst, whoever
upgrades), `installing` while an upgrade lasts (with the file's name, if known; the next boot ends
an interrupted one), `data-VERSION` with what the user had made until that version went.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path

from hypermask.errors import HypermaskError
from hypermask.storage import write_atomically
from hypermask.update.dpkg import PACKAGE, SIMULATOR, Dpkg, Package

_NEW = ".new.deb"


def shelf_folder() -> Path:
    return Path(os.environ.get("HYPERMASK_PACKAGES") or "/var/lib/hypermask/packages")


class Shelf:
    def __init__(self, folder: Path, dpkg: Dpkg) -> None:
        self.folder, self._dpkg = folder, dpkg

    def path_of(self, name: str, version: str) -> Path:
        return self.folder / f"{name}_{version.replace(':', '%3a')}_all.deb"

    def kept(self, version: str, name: str = PACKAGE) -> Path | None:
        path = self.path_of(name, version)
        return path if path.is_file() else None

    def keep(self, package: Package) -> Path:
        """Copy a package here, as a whole or not at all. Raises `HypermaskError` UPD-KEEP."""
        target = self.path_of(package.name, package.version)
        if not (target.exists() and target.samefile(package.path)):
            self._place(target, lambda new: shutil.copyfile(package.path, new))
        return target

    def keep_installed(self, name: str, version: str) -> None:
        """So that there is a way back, whoever installed it. Raises `HypermaskError` UPD-KEEP."""
        if self.kept(version, name) is None:
            target = self.path_of(name, version)
            self._place(target, lambda new: self._dpkg.repack(name, new))

    def _place(self, target: Path, make: object) -> None:
        assert callable(make)
        new = self.folder / _NEW
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            make(new)
            _sync(new)
            new.chmod(0o644)
            new.replace(target)
            _sync(self.folder)
        except OSError as error:
            raise HypermaskError(
                "UPD-KEEP",
                f"cannot keep {target.name} in {self.folder}: {error.strerror or error}",
                "Free some space; nothing was changed.",
            ) from error
        finally:
            with contextlib.suppress(OSError):
                new.unlink(missing_ok=True)

    @property
    def previous(self) -> str | None:
        """The version before the installed one, None where there was none."""
        try:
            return (self.folder / "previous").read_text("utf-8").strip() or None
        except OSError:
            return None

    def set_previous(self, version: str | None) -> None:
        if version is None:
            (self.folder / "previous").unlink(missing_ok=True)
        else:
            write_atomically(self.folder / "previous", f"{version}\n".encode())

    def begin(self, paths: list[Path]) -> None:
        """From here on a power cut is found by the next boot."""
        write_atomically(self.folder / "installing", "\n".join(map(str, paths)).encode() + b"\n")

    def end(self) -> None:
        with contextlib.suppress(OSError):
            (self.folder / "installing").unlink(missing_ok=True)
            _sync(self.folder)

    @property
    def interrupted(self) -> bool:
        return (self.folder / "installing").exists()

    def data(self, version: str) -> Path:
        return self.folder / f"data-{version}"

    def prune(self) -> None:
        """Only what is installed and what was before it."""
        wanted = {self._dpkg.version(), self._dpkg.version(SIMULATOR), self.previous} - {None}
        names = {
            self.path_of(name, str(version)).name
            for name in (PACKAGE, SIMULATOR)
            for version in wanted
        }
        for path in self.folder.glob("*.deb"):
            if path.name not in names:
                path.unlink(missing_ok=True)
        for path in self.folder.glob("data-*"):
            if path.name.removeprefix("data-") not in wanted:
                shutil.rmtree(path, ignore_errors=True)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
