"""The film: what goes in comes out, sound in its true place, nothing half done left behind."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hypermask_sim.film import FilmError, FilmWriter, shifted

SIZE = (160, 120)
needs_ffmpeg = pytest.mark.skipif(shutil.which("ffprobe") is None, reason="ffmpeg is not installed")


def frame(level: int) -> NDArray[np.uint8]:
    return np.full((SIZE[1], SIZE[0], 3), (level, 40, 200 - level // 2), np.uint8)


def probe(path: Path) -> dict[str, dict[str, str]]:
    command = ["ffprobe", "-v", "error", "-show_streams", "-of", "json", str(path)]
    streams = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    return {stream["codec_type"]: stream for stream in streams["streams"]}


def decoded_sound(path: Path) -> NDArray[np.float64]:
    command = ["ffmpeg", "-v", "error", "-i", str(path), "-vn", "-f", "s16le", "-ar", "16000", "-"]
    data = subprocess.run(command, check=True, capture_output=True).stdout
    return np.frombuffer(data, "<i2") / 32767


def decoded_frames(path: Path) -> NDArray[np.uint8]:
    command = ["ffmpeg", "-v", "error", "-i", str(path), "-an", "-f", "rawvideo"]
    command += ["-pix_fmt", "rgb24", "-"]
    data = subprocess.run(command, check=True, capture_output=True).stdout
    return np.frombuffer(data, np.uint8).reshape(-1, SIZE[1], SIZE[0], 3)


@needs_ffmpeg
def test_frames_and_sound_come_out_as_they_went_in(tmp_path: Path) -> None:
    path = tmp_path / "out/show.mp4"
    levels = [0, 60, 120, 180, 240] * 12
    with FilmWriter(path, SIZE, 60.0, (np.zeros(16000), 16000)) as film:
        for level in levels:
            film.write(frame(level))
        assert not path.exists()
    streams = probe(path)
    assert streams["video"]["codec_name"] == "h264"
    assert streams["video"]["pix_fmt"] == "yuv420p"
    assert streams["video"]["nb_frames"] == str(film.frames) == "60"
    assert streams["video"]["r_frame_rate"] == "60/1"
    assert streams["audio"]["codec_name"] == "aac"
    assert float(streams["audio"]["duration"]) == pytest.approx(1.0, abs=0.06)
    middle = decoded_frames(path)[:, 60, 80, 0].astype(int)
    assert np.abs(middle - levels).max() <= 12
    assert [entry.name for entry in path.parent.iterdir()] == ["show.mp4"]
    head = path.read_bytes()[: 64 * 1024]
    assert head.find(b"moov") < head.find(b"mdat") or b"mdat" not in head


@needs_ffmpeg
@pytest.mark.parametrize("offset_s", [0.25, 0.0, -0.2])
def test_a_click_is_heard_when_it_happened(tmp_path: Path, offset_s: float) -> None:
    sound = np.zeros(16000)
    sound[8000:8080] = 0.9  # 0.5 s after the sound's beginning
    path = tmp_path / "click.mp4"
    with FilmWriter(path, SIZE, 30.0, (sound, 16000), sound_offset_s=offset_s) as film:
        for _ in range(36):
            film.write(frame(90))
    heard = np.argmax(np.abs(decoded_sound(path)) > 0.3) / 16000
    assert heard == pytest.approx(0.5 + offset_s, abs=0.004)


def test_shifting_keeps_every_sample() -> None:
    sound = np.arange(1, 101) / 200
    later, earlier = shifted(sound, 100, 0.3), shifted(sound, 100, -0.3)
    assert later.size == 130 and not later[:30].any()
    np.testing.assert_array_equal(later[30:], sound.astype(np.float32))
    np.testing.assert_array_equal(earlier, sound[30:].astype(np.float32))


@needs_ffmpeg
def test_odd_sizes_and_silent_films_work(tmp_path: Path) -> None:
    path = tmp_path / "odd.mp4"
    with FilmWriter(path, (161, 91), 25.0) as film:
        film.write(np.zeros((91, 161, 3), np.uint8))
    streams = probe(path)
    assert [int(streams["video"][key]) for key in ("width", "height")] == [162, 92]
    assert "audio" not in streams


def test_without_ffmpeg_the_remedy_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(FilmError, match=r"FILM-FFMPEG: .*not installed\. .*apt install ffmpeg"):
        FilmWriter(tmp_path / "show.mp4", SIZE, 60.0)
    assert not any(tmp_path.iterdir())


def fake_ffmpeg(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    folder.mkdir()
    program = folder / "ffmpeg"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")


def test_a_full_disk_ends_in_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_ffmpeg(tmp_path / "bin", monkeypatch, "echo 'pipe: No space left on device' >&2; exit 1")
    out = tmp_path / "out"
    with pytest.raises(FilmError, match=r"FILM-FFMPEG: .*No space left on device\. Free") as caught:  # noqa: SIM117
        with FilmWriter(out / "show.mp4", SIZE, 60.0) as film:
            for _ in range(200):
                film.write(frame(0))
    assert caught.value.exit_code == 1
    assert not any(out.iterdir())


def test_an_ffmpeg_that_fails_at_the_end_leaves_the_old_film(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_ffmpeg(tmp_path / "bin", monkeypatch, "cat > /dev/null; echo 'no libx264' >&2; exit 1")
    path = tmp_path / "out/show.mp4"
    path.parent.mkdir()
    path.write_bytes(b"the old film")
    with pytest.raises(FilmError, match=r"FILM-FFMPEG: .*no libx264"):  # noqa: SIM117
        with FilmWriter(path, SIZE, 60.0) as film:
            film.write(frame(0))
    assert path.read_bytes() == b"the old film"
    assert [entry.name for entry in path.parent.iterdir()] == ["show.mp4"]


@needs_ffmpeg
def test_an_exception_in_the_show_discards_the_film(tmp_path: Path) -> None:
    with pytest.raises(KeyError), FilmWriter(tmp_path / "show.mp4", SIZE, 60.0) as film:
        film.write(frame(0))
        raise KeyError
    assert not any(tmp_path.iterdir())


@needs_ffmpeg
def test_a_frame_of_another_size_is_refused(tmp_path: Path) -> None:
    with (
        pytest.raises(ValueError, match="film"),
        FilmWriter(tmp_path / "a.mp4", SIZE, 60.0) as film,
    ):
        film.write(np.zeros((10, 10, 3), np.uint8))
