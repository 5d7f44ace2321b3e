"""The packages' scripts, run with folders in the place of the machine's."""

from __future__ import annotations

import os
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

DEBIAN = Path(__file__).parents[2] / "debian"


TOLD = "#!/bin/sh\necho ${0##*/} $* >>%s\n"


class Configured:
    """What udev is told while the package is configured on a machine in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._said = folder, folder / "said"
        for name in ("run/udev", "run/systemd/system", "bin", "usr/libexec/hypermask"):
            (folder / name).mkdir(parents=True)
        self._end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._end.bind(str(folder / "run/udev/control"))
        self._program("bin/udevadm", TOLD % self._said)
        self._program("usr/libexec/hypermask/upgraded", "#!/bin/sh\n")
        for name in ("devices", "plays"):
            text = (DEBIAN / "libexec" / name).read_text("utf-8")
            self._program(f"usr/libexec/hypermask/{name}", text)

    def _program(self, name: str, text: str) -> Path:
        path = self._folder / name
        for place in ("/run/", "/usr/libexec/", "/var/lib/"):
            text = text.replace(f" {place}", f" {self._folder}{place}")
        path.write_text(text, "utf-8")
        path.chmod(0o755)
        return path

    def run(self, before: str, plays: bool) -> list[str]:
        self._program("bin/systemctl", f"#!/bin/sh\nexit {0 if plays else 3}\n")
        script = self._program("postinst", (DEBIAN / "hypermask.postinst").read_text("utf-8"))
        done = subprocess.run(
            ["sh", str(script), "configure", before],
            env={"PATH": f"{self._folder}/bin:{os.environ['PATH']}"},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        self._end.close()
        return self._said.read_text("utf-8").splitlines() if self._said.exists() else []


@pytest.mark.parametrize("before", ["", "0.0.9"], ids=["first", "upgraded or removed before"])
def test_devices_that_are_there_get_names_and_rights(tmp_path: Path, before: str) -> None:
    """Removing takes names and rights away, and dpkg then tells the old version at the next
    installation as at an upgrade."""
    reload, trigger = Configured(tmp_path).run(before, plays=False)
    assert reload == "udevadm control --reload"
    # Not "add" or "remove": what is in use stays plugged in.
    assert trigger.startswith("udevadm trigger --action=change --subsystem-match=video4linux")


def test_a_show_that_plays_keeps_its_devices_through_an_upgrade(tmp_path: Path) -> None:
    assert Configured(tmp_path).run("0.0.9", plays=True) == []


def test_the_takeover_gives_them_what_the_new_version_knows() -> None:
    lines = (DEBIAN / "libexec/takeover").read_text("utf-8").splitlines()
    devices = lines.index("/usr/libexec/hypermask/devices")
    assert lines.index("systemctl restart hypermask-code.service || exit 1") < devices
    assert devices < lines.index("systemctl start hypermask.target || exit 1")


# --- the command ---------------------------------------------------------------------------------


PYTHON = "/usr/bin/python3"


def command(folder: Path, run: Path, user: int = 0) -> str:
    """Which code the installed command takes, and where it reads ALSA's configuration."""
    text = (DEBIAN / "bin/hypermask").read_text("utf-8")
    text = text.replace("/usr/share/hypermask", f"{folder}/share").replace(
        "/run/hypermask", str(run)
    )
    script = folder / "command.py"
    script.write_text(text, "utf-8")
    for root, name in ((folder / "share", "installed"), (folder / "live", "running")):
        cli = root / "python/hypermask/cli/main.py"
        cli.parent.mkdir(parents=True, exist_ok=True)
        for package in cli.parents[:2]:
            (package / "__init__.py").touch()
        cli.write_text(
            f"def main():\n import os\n print({name!r}, os.environ.get('ALSA_CONFIG_PATH'))\n",
            "utf-8",
        )
    done = subprocess.run(
        [PYTHON, "-I", str(script), "status"],
        capture_output=True, text=True, user=user or None,
        env={"PATH": os.environ["PATH"]},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture
def folder() -> Iterator[Path]:
    """Where every folder on the way is root's, as /run is; and anybody may go in."""
    with tempfile.TemporaryDirectory(dir="/run") as name:
        Path(name).chmod(0o755)
        yield Path(name)


as_root = pytest.mark.skipif(
    os.geteuid() != 0 or not Path(PYTHON).exists(),
    reason="only root can give files away, and only Debian's Python is everybody's",
)
SHOW = 12345


@as_root
def test_the_command_runs_the_shows_code_only_if_it_is_roots(folder: Path) -> None:
    run = folder / "run"
    run.mkdir()
    (run / "code").symlink_to(folder / "live")
    assert command(folder, run).startswith("running")
    os.chown(run / "code", SHOW, -1, follow_symlinks=False)
    assert command(folder, run).startswith("installed")
    os.chown(run / "code", 0, -1, follow_symlinks=False)
    os.chown(folder / "live", SHOW, -1)
    assert command(folder, run).startswith("installed")


@as_root
def test_root_reads_no_alsa_configuration_of_the_shows_user(folder: Path) -> None:
    sound = folder / "run/sound/asound.conf"
    sound.parent.mkdir(parents=True)
    sound.touch()
    assert command(folder, folder / "run").endswith("None")
    assert command(folder, folder / "run", SHOW).endswith(f":{sound}")
