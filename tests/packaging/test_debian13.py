"""The packages in a real Debian 13: install, use, upgrade, roll back, purge; lintian.

Run as root with ``pytest -m appliance tests/packaging``. Needs mmdebstrap; the root is made once,
in build/trixie (HYPERMASK_TRIXIE names another folder).
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TRIXIE = Path(os.environ.get("HYPERMASK_TRIXIE") or ROOT / "build" / "trixie")
EXTRA = ("apt", "lintian", "systemd", "udev", "init", "libcap2-bin")
LARGEST_BYTES = 30e6

pytestmark = [
    pytest.mark.appliance,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(os.geteuid() != 0, reason="chroot needs root"),
    pytest.mark.skipif(not shutil.which("mmdebstrap"), reason="mmdebstrap is not installed"),
]


def depends() -> list[str]:
    control = (ROOT / "debian" / "control").read_text("utf-8")
    found = re.search(r"^Package: hypermask\n.*?^Depends:\n(.*?)^\S", control, re.S | re.M)
    assert found is not None
    return re.findall(r"^ ([a-z0-9.+-]+)(?: \([^)]*\))?,", found[1], re.MULTILINE)


class Debian:
    """An overlay over the root, so that the root stays as it was made."""

    def __init__(self, folder: Path) -> None:
        self._mounts: list[Path] = []
        self._mount("tmpfs", folder, "tmpfs", "size=2G")
        for name in ("upper", "work", "root"):
            (folder / name).mkdir()
        layers = f"lowerdir={TRIXIE},upperdir={folder}/upper,workdir={folder}/work"
        self.root = folder / "root"
        self._mount("overlay", self.root, "overlay", layers)
        self._mount("proc", self.root / "proc", "proc")
        self._mount("tmpfs", self.root / "dev", "tmpfs")
        for name, minor in (("null", 3), ("zero", 5), ("urandom", 9)):
            os.mknod(self.root / "dev" / name, 0o020666, os.makedev(1, minor))
            (self.root / "dev" / name).chmod(0o666)
        (self.root / "dev" / "shm").mkdir(mode=0o1777)
        (self.root / "dev" / "fd").symlink_to("/proc/self/fd")

    def _mount(self, kind: str, where: Path, source: str, options: str = "") -> None:
        where.mkdir(parents=True, exist_ok=True)
        extra = ["-o", options] if options else []
        subprocess.run(["mount", "-t", kind, *extra, source, where], check=True)
        self._mounts.append(where)

    def close(self) -> None:
        for where in reversed(self._mounts):
            subprocess.run(["umount", "-l", where], check=True)

    def bring(self, path: Path) -> str:
        shutil.copy(path, self.root / "root")
        return f"/root/{path.name}"

    def run(self, command: str, check: bool = True) -> str:
        done = subprocess.run(
            ["nice", "chroot", self.root, "env", "-i", "PATH=/usr/sbin:/usr/bin:/sbin:/bin",
             "HOME=/root", "LC_ALL=C.UTF-8", "TERM=dumb", "DEBIAN_FRONTEND=noninteractive",
             "bash", "-c", command],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        assert done.returncode == 0 or not check, done.stdout[-4000:]
        return done.stdout


def made(suffix: str = "") -> list[Path]:
    """The packages of the working tree."""
    subprocess.run(
        ["bash", ".ci/deb"],
        cwd=ROOT,
        check=True,
        env={**os.environ, "DEB_SUFFIX": suffix},
        stdout=subprocess.DEVNULL,
    )
    return sorted((ROOT / "build" / "deb").glob("*.deb"))


@pytest.fixture(scope="module")
def debian(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Debian]:
    """With this version in /root, and an older one of the same code."""
    if not (TRIXIE / "etc" / "debian_version").exists():
        packages = ",".join([*depends(), *EXTRA])
        subprocess.run(
            ["nice", "mmdebstrap", "--quiet", "--variant=minbase", f"--include={packages}",
             '--aptopt=Apt::Install-Recommends "false"', "trixie", TRIXIE],
            check=True,
        )  # fmt: skip
    debian = Debian(tmp_path_factory.mktemp("debian"))
    try:
        for suffix in ("~old", ""):
            for path in made(suffix):
                debian.bring(path)
        yield debian
    finally:
        debian.close()


@pytest.fixture(scope="module")
def installed(debian: Debian) -> Debian:
    debian.run("apt-get install -y --no-install-recommends /root/*~old_all.deb")
    return debian


def files(debian: Debian, *arguments: str) -> set[str]:
    """Everything in the root that has to do with the package, by name or owner."""
    found = debian.run(
        "find / -xdev \\( -name '*hypermask*' -o -group hypermask -o -user hypermask \\) "
        "-not -path '/proc/*' -not -path '/root/*' -not -path '/tmp/*' 2>/dev/null || true"
        if "hypermask" in debian.run("cut -d: -f1 /etc/passwd")
        else "find / -xdev -name '*hypermask*' -not -path '/proc/*' -not -path '/root/*' || true"
    )
    return set(found.split())


def test_lintian_has_no_errors(debian: Debian) -> None:
    said = debian.run("cd /root && lintian --fail-on none hypermask*[0-9]_all.deb", check=False)
    assert not [line for line in said.splitlines() if line.startswith(("E:", "W:"))], said


def test_our_own_files_are_at_most_30_mb(installed: Debian) -> None:
    listed = installed.run("dpkg-query -L hypermask hypermask-sim").splitlines()
    paths = {installed.root / line.lstrip("/") for line in listed}
    size = sum(p.stat().st_size for p in paths if p.is_file() and not p.is_symlink())
    cached = sum(
        p.stat().st_size for p in (installed.root / "usr/share/hypermask").rglob("__pycache__/*")
    )
    assert size + cached <= LARGEST_BYTES, (size, cached)


def test_the_packages_own_test_passes(installed: Debian) -> None:
    """debian/tests/smoke: face models, a short show, units, exposure, user."""
    installed.bring(ROOT / "debian" / "tests" / "smoke")
    assert "all is well" in installed.run("sh /root/smoke")


def test_without_the_simulator_a_rehearsal_says_what_to_install(installed: Debian) -> None:
    installed.run("dpkg --remove hypermask-sim")
    try:
        said = installed.run("cd /tmp; hypermask rehearse", check=False)
    finally:
        installed.run("dpkg -i /root/hypermask-sim*~old_all.deb")
    assert "SIM-ABSENT" in said or "CFG-" in said, said
    assert "Traceback" not in said


def test_an_upgrade_keeps_the_owners_files_and_a_rollback_returns(installed: Debian) -> None:
    installed.run(
        "hypermask config set camera.exposure_ms=0.8;"
        "echo '// mine' >> /etc/apt/apt.conf.d/60hypermask;"
        "mkdir -p /var/lib/hypermask/characters/anna; echo hello > /var/lib/hypermask/characters/x"
    )
    old = installed.run("dpkg-query -W -f='${Version}' hypermask")
    installed.run("hypermask update install /root/hypermask*[0-9]_all.deb")
    new = installed.run("dpkg-query -W -f='${Version}' hypermask")
    assert old == f"{new}~old"

    def kept() -> None:
        assert "0.8" in installed.run("cat /etc/hypermask/90-set.toml")
        assert "// mine" in installed.run("cat /etc/apt/apt.conf.d/60hypermask")
        assert installed.run("cat /var/lib/hypermask/characters/x") == "hello\n"

    kept()
    assert f'"previous": "{old}"' in installed.run("hypermask update status --json")
    installed.run("hypermask update rollback")
    assert installed.run("dpkg-query -W -f='${Version}' hypermask") == old
    kept()
    assert installed.run("dpkg --audit") == ""


def test_apt_and_dpkg_keep_a_way_back_too(installed: Debian) -> None:
    installed.run("rm -r /var/lib/hypermask/packages/*")
    installed.run("dpkg -i /root/hypermask*[0-9]_all.deb")
    assert "~old" in installed.run("hypermask update status --json").split('"previous"')[1]
    installed.run("test -d /var/lib/hypermask/packages/data-*~old")
    installed.run("hypermask update rollback")
    assert "~old" in installed.run("dpkg-query -W -f='${Version}' hypermask")


def test_removing_keeps_what_the_user_made_and_purging_leaves_nothing(installed: Debian) -> None:
    installed.run("apt-get remove -y hypermask hypermask-sim")
    assert installed.run("cat /var/lib/hypermask/characters/x") == "hello\n"
    assert "0.8" in installed.run("cat /etc/hypermask/90-set.toml")
    installed.run("apt-get purge -y hypermask hypermask-sim")
    assert files(installed) == set()
    assert "hypermask" not in installed.run("cat /etc/passwd /etc/group")
