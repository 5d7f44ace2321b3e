"""A photograph given on the command line joins the show that runs in real time on this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hypermask import paths

FACES = Path(__file__).parents[2].parent / "shared" / "data" / "faces"
PATIENCE_S = 90.0

pytestmark = [
    pytest.mark.skipif(not FACES.is_dir(), reason="../shared/data/faces is absent"),
    pytest.mark.skipif(
        not (paths.models() / "face_landmark.onnx").is_file(),
        reason="the face models are absent: make models",
    ),
]


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "hypermask.cli.main", *arguments]


@pytest.fixture
def running(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[bytes], dict[str, str]]]:
    """A real-time show that has begun, and the environment that finds it."""
    environment = os.environ | {"HYPERMASK_RUN": str(tmp_path / "run")}
    show = subprocess.Popen(
        command(
            *("rehearse", "--realtime", "--no-pictures", "--out", str(tmp_path / "out")),
            *("--set", "character=mean", "--set", "performer.motion=sway"),
            *("--set", "duration_s=12", "--set", "calibration.method=exact"),
        ),
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline_s = time.monotonic() + PATIENCE_S
    while not (tmp_path / "run" / "current" / "scene").exists():
        assert show.poll() is None and time.monotonic() < deadline_s, "the show did not begin"
        time.sleep(0.05)
    yield show, environment
    show.kill()
    show.wait()


def build(photo: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command("face", "build", str(photo), "--name", "guest", "--live"),
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def test_a_photograph_joins_the_running_show(
    tmp_path: Path, running: tuple[subprocess.Popen[bytes], dict[str, str]]
) -> None:
    show, environment = running
    bad = build(Path(__file__), environment)
    assert (bad.returncode, bad.stderr[:13]) == (1, "PHOTO-FORMAT:")
    assert __file__ in bad.stderr
    good = build(sorted(FACES.glob("*.jpg"))[5], environment)
    assert good.returncode == 0, good.stderr
    told = subprocess.run(
        command("status", "--json"), env=environment, capture_output=True, text=True, check=False
    )
    lines = json.loads(told.stdout)["lines"]
    assert set(lines) >= {"tracker", "voice", "stage", "show"}
    assert lines["tracker"]["frames"] > 0 and lines["show"]["characters"]
    assert show.wait(PATIENCE_S) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [e["code"] for e in report["events"]].count("CHAR-JOINS") == 1
    assert (tmp_path / "out" / "characters" / "guest" / "texture.png").is_file()
    assert not (tmp_path / "run" / "current").exists(), "a show that is over is not found"
    after = build(sorted(FACES.glob("*.jpg"))[5], environment)
    assert (after.returncode, after.stderr[:10]) == (1, "SHOW-NONE:")
