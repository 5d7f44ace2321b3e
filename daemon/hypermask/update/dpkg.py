"""The package manager, as far as an upgrade needs it."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hypermask.errors import DataError, HypermaskError

PACKAGE, SIMULATOR = "hypermask", "hypermask-sim"
_QUIET = {"DEBIAN_FRONTEND": "noninteractive", "LC_ALL": "C.UTF-8"}
# A changed configuration file is the owner's; a new one comes without a question.
_FILES_STAY = ("--force-confdef", "--force-confold")
_PROGRAM = ("/usr/bin/", "/usr/lib", "/usr/share/hypermask/")
_AS_SHIPPED = "usr/share/hypermask/as-shipped"
"""The configuration files again, for a package that has to be packed from what is installed."""
_NOT_IN_A_PACKAGE = ("Status", "Conffiles", "Config-Version")


@dataclass(frozen=True)
class Package:
    """What a .deb says of itself."""

    name: str
    version: str
    path: Path


class Dpkg:
    """options: given to every dpkg call; another root than this machine's, for tests."""

    def __init__(self, options: Sequence[str] = ()) -> None:
        self._options = tuple(options)
        self._root = tuple(option for option in options if option.startswith("--root="))

    @property
    def elsewhere(self) -> bool:
        return bool(self._options)

    def package(self, path: Path) -> Package:
        """Reads a .deb to its end. Raises `DataError` UPD-FILE, UPD-DAMAGED."""
        asked = _run("dpkg-deb", "-f", str(path), "Package", "Version")
        fields = dict(line.split(": ", 1) for line in asked.stdout.splitlines() if ": " in line)
        if asked.returncode or len(fields) < 2:
            raise DataError("UPD-FILE", f"{path} is no Debian package", "Give a hypermask_*.deb.")
        with Path(os.devnull).open("wb") as nowhere:
            whole = subprocess.run(
                ["dpkg-deb", "--fsys-tarfile", str(path)], stdout=nowhere, stderr=subprocess.DEVNULL
            )
        if whole.returncode:
            raise DataError("UPD-DAMAGED", f"{path} is damaged", "Copy it again.")
        return Package(fields["Package"], fields["Version"], path)

    def version(self, name: str = PACKAGE) -> str | None:
        """Of what is installed as a whole; None for anything else."""
        form = "${db:Status-Status} ${db:Status-Eflag} ${Version}"
        words = self._query("-W", f"-f={form}", name).split()
        return words[2] if words[:2] == ["installed", "ok"] else None

    def whole(self, name: str = PACKAGE) -> bool:
        """Installed, and no file of the program is missing or changed. Configuration files may be;
        manuals are left out on some machines."""
        if self.version(name) is None:
            return False
        told = _run("dpkg", *self._options, "--verify", name).stdout.splitlines()
        return not [line for line in told if line.split()[-1].startswith(_PROGRAM)]

    def install(self, paths: Sequence[Path]) -> tuple[bool, str]:
        """Whether it went well, and the last words of whoever did it. Never asks anything."""
        files = [str(path) for path in paths]
        if not self.elsewhere and shutil.which("apt-get"):
            done = _run(
                "apt-get", "install", "--yes", "--quiet", "--no-remove", "--allow-downgrades",
                "--reinstall", "--no-install-recommends", "-o", "DPkg::Lock::Timeout=60",
                *(f"-oDpkg::Options::={option}" for option in _FILES_STAY), *files,
            )  # fmt: skip
        else:
            done = _run("dpkg", *_FILES_STAY, *self._options, "--install", *files)
        said = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
        faults = [line for line in said if line.startswith(("E:", "dpkg: error"))]
        return done.returncode == 0, "; ".join((faults or said)[-3:])

    def repack(self, name: str, target: Path) -> None:
        """The installed package as a .deb again, for one that nobody kept.

        Raises `HypermaskError` UPD-KEEP.
        """
        tree = Path(tempfile.mkdtemp(dir=target.parent, prefix=".repack."))
        try:
            tree.chmod(0o755)
            self._files(name, tree)
            self._control(name, tree / "DEBIAN")
            self._configuration(name, tree)
            done = _run(
                "dpkg-deb", "--root-owner-group", "-Zgzip", "-z1", "--build", str(tree), str(target)
            )
            if done.returncode:
                raise OSError(done.stderr.strip() or "dpkg-deb failed")
        except OSError as error:
            raise HypermaskError(
                "UPD-KEEP", f"the installed version cannot be kept: {error}", "Free some space."
            ) from error
        finally:
            shutil.rmtree(tree, ignore_errors=True)

    def _files(self, name: str, tree: Path) -> None:
        root = Path(self._query_root())
        for line in self._query("-L", name).splitlines():
            source, copy = root / line.lstrip("/"), tree / line.lstrip("/")
            if source.is_symlink():
                copy.parent.mkdir(parents=True, exist_ok=True)
                copy.symlink_to(source.readlink())
            elif source.is_dir():
                copy.mkdir(parents=True, exist_ok=True)
            elif source.is_file():
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source, copy)

    def _control(self, name: str, folder: Path) -> None:
        folder.mkdir()
        for line in self._query("--control-list", name).split():
            path = Path(self._query("--control-path", name, line).strip())
            shutil.copy2(path, folder / line)
        stanza = self._query("-s", name)
        (folder / "control").write_text(_without(stanza, _NOT_IN_A_PACKAGE), "utf-8")

    def _configuration(self, name: str, tree: Path) -> None:
        """As shipped, not as the owner has made them: else dpkg would take the owner's for ours."""
        root, listed = Path(self._query_root()), []
        for line in self._query("-W", "-f=${Conffiles}", name).splitlines():
            words = line.split()
            if len(words) != 2:  # the last line, or one of a file that is no longer shipped
                continue
            inner, digest = words[0].lstrip("/"), words[1]
            shipped = [root / inner, root / _AS_SHIPPED / inner]
            source = next((path for path in shipped if _md5(path) == digest), None)
            if source is not None:
                (tree / inner).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source, tree / inner)
            if (tree / inner).exists():
                listed.append(f"{words[0]}\n")
        (tree / "DEBIAN" / "conffiles").write_text("".join(listed), "utf-8")

    def _query(self, *arguments: str) -> str:
        return _run("dpkg-query", *self._root, *arguments).stdout

    def _query_root(self) -> str:
        return self._root[-1].removeprefix("--root=") if self._root else "/"


def newer(one: str, other: str) -> bool:
    return not _run("dpkg", "--compare-versions", one, "gt", other).returncode


def _md5(path: Path) -> str:
    """As dpkg writes it down; empty for a file that is not there."""
    try:
        return hashlib.md5(path.read_bytes(), usedforsecurity=False).hexdigest()
    except FileNotFoundError:
        return ""


def _without(stanza: str, names: Sequence[str]) -> str:
    kept, keep = [], True
    for line in stanza.splitlines():
        if not line.startswith(" "):
            keep = line.split(":")[0] not in names
        if keep and line:
            kept.append(line)
    return "\n".join(kept) + "\n"


def _run(*command: str) -> subprocess.CompletedProcess[str]:
    """In a session of its own: whoever hangs up in the middle does not stop it half-way."""
    try:
        return subprocess.run(
            command,
            text=True,
            capture_output=True,
            stdin=subprocess.DEVNULL,
            env={**os.environ, **_QUIET},
            start_new_session=True,
        )
    except FileNotFoundError:
        raise HypermaskError(
            "UPD-DPKG", f"{command[0]} is absent: this is no Debian", "Install by other means."
        ) from None
