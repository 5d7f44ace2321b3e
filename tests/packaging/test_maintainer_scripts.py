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


@pytest.mark.parametrize(
    "arguments",
    [("configure", ""), ("configure", "0.0.9")],
    ids=["first", "upgraded or removed before"],
)
def test_devices_that_are_there_get_names_and_rights(
    tmp_path: Path, arguments: tuple[str, str]
) -> None:
    """Removing takes names and rights away, and dpkg then tells the old version at the next
    installation as at an upgrade."""
    text = (DEBIAN / "hypermask.postinst").read_text("utf-8")
    script = tmp_path / "postinst"
    for path in ("/run/udev", "/usr/libexec", "/var/lib/hypermask"):
        text = text.replace(path, f"{tmp_path}{path}")
    script.write_text(text, "utf-8")
    (tmp_path / "run/udev").mkdir(parents=True)
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    end.bind(str(tmp_path / "run/udev/control"))
    udevadm = tmp_path / "bin/udevadm"
    udevadm.parent.mkdir()
    udevadm.write_text(f"#!/bin/sh\necho $* >>{tmp_path}/said\n", "utf-8")
    udevadm.chmod(0o755)
    done = subprocess.run(
        ["sh", str(script), *arguments],
        env={"PATH": f"{udevadm.parent}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    reload, trigger = (tmp_path / "said").read_text("utf-8").splitlines()
    assert reload == "control --reload"
    # Not "add" or "remove": what is in use stays plugged in.
    assert trigger.startswith("trigger --action=change --subsystem-match=video4linux")


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
