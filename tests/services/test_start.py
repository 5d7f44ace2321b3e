"""What a worker's process reads in before it works: the shorter, the sooner it is back."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("name", "needs_it"),
    [("tracker", True), ("stage", True), ("voice", False), ("pantilt", False), ("show", False)],
)
def test_only_who_sees_pictures_loads_opencv(name: str, needs_it: bool) -> None:
    """Debian's brings a hundred libraries with it, half of such a process's start."""
    program = f"import hypermask.services.{name}, sys; print('cv2' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert told.stdout.strip() == str(needs_it), told.stderr
