"""What the user sees of a mistake: one clear line with a code, an exit code, never a traceback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask import paths

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
SHORT = ("--no-pictures", "--set", "duration_s=0.3", "--set", "calibration.method=exact")


def hypermask(*arguments: str, home: Path | None = None) -> subprocess.CompletedProcess[str]:
    environment = os.environ | ({"HYPERMASK_HOME": str(home)} if home else {})
    return subprocess.run(
        [sys.executable, "-m", "hypermask.cli.main", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=environment,
    )


def assert_one_clear_line(done: subprocess.CompletedProcess[str], code: str, status: int) -> None:
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    assert len(lines) == 1 and lines[0].startswith(f"{code}: "), done.stderr


@pytest.mark.parametrize(
    ("assignment", "code", "status"),
    [
        ("performer.motoin=walk", "CFG-KEY", 2),
        ("performer.distance_m=near", "CFG-VALUE", 2),
        ("performer.distance_m=1e9", "CFG-VALUE", 2),
        ("performer.voice=absent.wav", "VOICE-ABSENT", 2),
        ("performer.motion=absent.csv", "MOTION-ABSENT", 2),
        ("character=nobody", "CHAR-ABSENT", 1),
        ("show=absent.toml", "CFG-ABSENT", 2),
        ("calibration.file=absent.json", "CAL-READ", 1),
        ("mask=nothing", "MASK-ABSENT", 2),
        ("nonsense", "SET-FORM", 2),
    ],
)
def test_a_wrong_key_or_file_is_one_line(
    tmp_path: Path, assignment: str, code: str, status: int
) -> None:
    done = hypermask("rehearse", "--set", assignment, "--out", str(tmp_path / "out"))
    assert_one_clear_line(done, code, status)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "content",
    [
        "t_s,x_m,y_m,z_m,qw,qx,qy,qz\n0.0,0,0,0,1,0,0,0\n0.1,0,0",
        "t_s,x_m,y_m,z_m,qw,qx,qy,qz\n0.1,0,0,0,1,0,0,0\n0.0,0,0,0,1,0,0,0\n",
        "t_s,x_m,y_m,z_m,qw,qx,qy,qz\n0.0,nan,0,0,1,0,0,0\n0.1,0,0,0,1,0,0,0\n",
        "\x00\x01\x02",
        "",
    ],
)
def test_a_truncated_or_garbled_clip_is_one_line(tmp_path: Path, content: str) -> None:
    clip = tmp_path / "clip.csv"
    clip.write_text(content)
    done = hypermask("rehearse", "--set", f"performer.motion={clip}")
    assert_one_clear_line(done, "MOTION-FORMAT", 1)


def test_an_unreadable_calibration_is_one_line(tmp_path: Path) -> None:
    made = hypermask("calibrate", "rehearse", "--json", home=tmp_path)
    stored = Path(json.loads(made.stdout)["file"])
    stored.write_bytes(stored.read_bytes()[:-200])
    done = hypermask("rehearse", "--set", f"calibration.file={stored}")
    assert_one_clear_line(done, "CAL-READ", 1)
    done = hypermask("rehearse", "--set", "calibration.method=stored", home=tmp_path)
    assert_one_clear_line(done, "CAL-READ", 1)


FACES = sorted((SHARED / "faces").glob("*.jpg"))
needs_faces = pytest.mark.skipif(not FACES, reason="the photographs of ../shared are absent")
needs_models = pytest.mark.skipif(
    not paths.models().is_dir(), reason="the face models are absent: make models"
)


def photo(tmp_path: Path, picture: np.ndarray) -> Path:
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), picture)
    return path


@needs_models
@needs_faces
def test_a_photo_of_two_faces_is_one_line(tmp_path: Path) -> None:
    pair = [cv2.resize(cv2.imread(str(path)), (500, 500)) for path in FACES[:2]]
    done = hypermask(
        "face", "build", str(photo(tmp_path, np.hstack(pair))), "--name", "pair", home=tmp_path
    )
    assert_one_clear_line(done, "FACE-MANY", 1)


@needs_models
def test_a_photo_without_a_face_is_one_line(tmp_path: Path) -> None:
    grey = np.random.default_rng(0).integers(90, 110, (400, 400, 3), dtype=np.uint8)
    done = hypermask("face", "build", str(photo(tmp_path, grey)), "--name", "nobody", home=tmp_path)
    assert_one_clear_line(done, "FACE-NONE", 1)
    assert not (tmp_path / "characters").exists()


@pytest.mark.parametrize(
    ("content", "code"),
    [(None, "PHOTO-ABSENT"), (b"", "PHOTO-FORMAT"), (b"\xff\xd8\xff\xe0", "PHOTO-FORMAT")],
)
def test_a_photo_that_is_none_is_one_line(tmp_path: Path, content: bytes | None, code: str) -> None:
    path = tmp_path / "photo.jpg"
    if content is not None:
        path.write_bytes(content)
    done = hypermask("face", "build", str(path), "--name", "x", home=tmp_path)
    assert_one_clear_line(done, code, 1)


@needs_models
@needs_faces
def test_a_photo_becomes_a_character_that_plays(tmp_path: Path) -> None:
    shelf = tmp_path / "made"
    done = hypermask(
        "face", "build", str(FACES[0]), "--name", "anna", "--out", str(shelf), "--json"
    )
    folder = json.loads(done.stdout)["folder"]
    for character in (folder, str(shelf)):
        played = hypermask(
            "rehearse", "--json", *SHORT, "--set", f"character={character}",
            "--out", str(tmp_path / "out"),
        )  # fmt: skip
        assert played.returncode == 0, played.stderr
        assert json.loads(played.stdout)["registration_mm"]["rms"] < 2


def test_an_error_is_json_for_programs() -> None:
    done = hypermask("rehearse", "--json", "--set", "performer.motoin=walk")
    assert done.returncode == 2
    assert json.loads(done.stdout)["error"]["code"] == "CFG-KEY"


def test_a_report_is_json_for_programs(tmp_path: Path) -> None:
    done = hypermask("rehearse", "--json", *SHORT, "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads((tmp_path / "report.json").read_text())


def test_an_unknown_option_is_wrong_usage() -> None:
    assert hypermask("rehearse", "--wrong").returncode == 2


@pytest.mark.parametrize("command", ["rehearse", "bench", "doctor", "face", "voice", "calibrate"])
def test_every_command_explains_itself(command: str) -> None:
    done = hypermask(command, "--help")
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) > 5


def test_a_full_disk_is_one_line() -> None:
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full")
    done = hypermask("rehearse", *SHORT, "--out", "/dev/full/out")
    assert_one_clear_line_among_progress(done, "DISK-WRITE")


def assert_one_clear_line_among_progress(done: subprocess.CompletedProcess[str], code: str) -> None:
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert any(line.startswith(f"{code}: ") for line in done.stderr.splitlines())
