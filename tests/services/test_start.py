"""What a worker's process reads in before it works: the shorter, the sooner it is back."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    ("name", "needs_it"),
    [("tracker", True), ("stage", True), ("voice", False), ("pantilt", False), ("show", False)],
)
def test_only_who_sees_pictures_loads_opencv(name: str, needs_it: bool, tmp_path: Path) -> None:
    """Debian's brings a hundred libraries with it, half of such a process's start."""
    (tmp_path / "machine.toml").write_text('machine = "cart"\n', "utf-8")
    program = (
        f"import hypermask.services.{name}, sys; from hypermask.machine.files import load;"
        "assert load().machine.camera.driver == 'v4l2'; print('cv2' in sys.modules)"
    )
    told = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "HYPERMASK_ETC": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert told.stdout.strip() == str(needs_it), told.stderr


def test_face_prepare_makes_what_is_missing_once(tmp_path: Path) -> None:
    """What it makes is what the stage looks for."""
    told = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-m", "hypermask.cli.main", "face", "prepare", "--json"],
            env={**os.environ, "HYPERMASK_HOME": str(tmp_path)},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        told.append(json.loads(done.stdout))
    assert told[0]["made"] == told[0]["characters"] == told[1]["characters"]
    assert told[1]["made"] == [] and len(list((tmp_path / "cache" / "costumes").iterdir())) >= 4
