"""The packages' scripts, run with folders in the place of the machine's."""

from __future__ import annotations

import os
import socket
import subprocess
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
