"""The film of a show: raw frames through a pipe to ffmpeg, with the voice in its true place.

H.264 and AAC in an MP4 whose index comes first. The film appears under its name only when it is
whole; until then, and for ever if something fails, there is only a temporary file.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
import wave
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask_drivers.errors import HypermaskError

Sound = tuple[ArrayLike, float]
"""Mono samples (n,), full scale 1.0, and their rate in Hz."""


class FilmError(HypermaskError):
    """FILM-FFMPEG: ffmpeg is absent or died; FILM-WRITE: the place cannot be written."""


def shifted(samples: ArrayLike, rate_hz: float, offset_s: float) -> NDArray[np.float32]:
    """Sound that starts with the picture: silence first (offset > 0) or its head cut off.

    offset_s: when the first sample was heard, minus when the first frame was seen.
    """
    sound = np.asarray(samples, np.float32).reshape(-1)
    count = round(offset_s * rate_hz)
    if count < 0:
        return sound[-count:]
    return np.concatenate([np.zeros(count, np.float32), sound])


class FilmWriter:
    """Give it frames in order, then `close`; or use it in a `with` (an exception discards it).

    path: of the film; size: (width, height); rate_hz: frames a second; sound: see `Sound`;
    sound_offset_s: see `shifted`. Raises `FilmError`, in the constructor, `write` and `close`.
    """

    def __init__(
        self,
        path: Path,
        size: tuple[int, int],
        rate_hz: float,
        sound: Sound | None = None,
        sound_offset_s: float = 0.0,
    ) -> None:
        self.path = Path(path)
        self.size = size
        self.frames = 0
        program = shutil.which("ffmpeg")
        if program is None:
            raise FilmError(
                "FILM-FFMPEG",
                "the program ffmpeg, which makes the film, is not installed",
                "Install it (apt install ffmpeg) or run without the film.",
            )
        try:
            self._folder = self._make_folder()
            voice = None if sound is None else self._write_voice(sound, sound_offset_s)
        except OSError as error:
            raise FilmError(
                "FILM-WRITE",
                f"cannot write {self.path}: {error.strerror or error}",
                "Free some space or check the folder's rights.",
            ) from error
        self._process = self._start(program, rate_hz, voice)

    def write(self, frame: NDArray[np.uint8]) -> None:
        """The next frame, (height, width, 3) uint8 RGB, row 0 at the top."""
        if frame.shape != (self.size[1], self.size[0], 3) or frame.dtype != np.uint8:
            raise ValueError(f"frame {frame.shape} {frame.dtype}, film {self.size}")
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(frame).data)
        except OSError as error:
            raise self._failed() from error
        self.frames += 1

    def close(self) -> None:
        """Finish the film and give it its name."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # ffmpeg's exit status tells more
            self._process.stdin.close()
        if self._process.wait() != 0 or not self._unfinished.is_file():
            raise self._failed()
        try:
            self._unfinished.replace(self.path)
        finally:
            self._clean()

    def discard(self) -> None:
        """Stop and leave nothing behind; may be called at any time."""
        if self._process.poll() is None:
            self._process.kill()
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        self._process.wait()
        self._clean()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    def _make_folder(self) -> Path:
        """Beside the film, so that the last step is a rename on one file system."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(dir=self.path.parent, prefix=f".{self.path.name}."))

    @property
    def _unfinished(self) -> Path:
        return self._folder / "film.mp4"

    @property
    def _complaints(self) -> Path:
        return self._folder / "ffmpeg.log"

    def _write_voice(self, sound: Sound, offset_s: float) -> Path:
        samples, rate_hz = sound
        path = self._folder / "voice.wav"
        levels = np.clip(np.nan_to_num(shifted(samples, rate_hz, offset_s)), -1, 1) * 32767
        try:
            with wave.open(str(path), "wb") as file:
                file.setnchannels(1)
                file.setsampwidth(2)
                file.setframerate(round(rate_hz))
                file.writeframes(np.round(levels).astype("<i2").tobytes())
        except OSError:
            self._clean()
            raise
        return path

    def _start(self, program: str, rate_hz: float, voice: Path | None) -> subprocess.Popen[bytes]:
        width, height = self.size
        command = [program, "-hide_banner", "-nostdin", "-loglevel", "error", "-y"]
        command += ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
        command += ["-r", f"{rate_hz:.6f}", "-i", "pipe:0"]
        if voice is not None:
            command += ["-i", str(voice), "-map", "0:v", "-map", "1:a"]
            # As long as the picture: silence behind a short voice, a long one is cut.
            command += ["-af", "apad", "-shortest", "-c:a", "aac", "-b:a", "128k"]
        command += ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709"]
        command += ["-c:v", "libx264", "-preset", "veryfast", "-crf", "19", "-pix_fmt", "yuv420p"]
        command += ["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"]
        command += ["-movflags", "+faststart", str(self._unfinished)]
        with self._complaints.open("wb") as log:
            return subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log
            )

    def _failed(self) -> FilmError:
        """What ffmpeg said before it died; nothing is left behind."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=5)
        status = self._process.poll()
        text = self._complaints.read_text("utf-8", "replace") if self._complaints.is_file() else ""
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        self.discard()
        full = any(os.strerror(28) in line for line in lines)
        said = os.strerror(28) if full else lines[-1] if lines else f"exit status {status}"
        return FilmError(
            "FILM-FFMPEG",
            f"ffmpeg stopped while it made {self.path}: {said}",
            "Free some space and try again."
            if full
            else "Install a complete ffmpeg (apt install ffmpeg), or run without the film.",
        )

    def _clean(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
