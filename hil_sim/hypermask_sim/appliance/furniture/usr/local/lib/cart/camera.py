"""Plays what the host puts into /host/leds.grey on vivid's HDMI output, again and again.

What is played there arrives at vivid's HDMI input, the virtual cart's camera. The file holds whole
frames, 640x480 bytes each, `RATE_HZ` of them a second; the host replaces it by renaming another
over it. vivid shows a frame until the next is queued, so a late player costs nothing.

vivid's own threads, of the camera and of the wire to it, stay as everybody's. They take the same
lock and spin while another has it: with a show worker's rights, the one of the wire kept a
processor for as long as that of the camera, stopped on the other one with the lock in its hands,
waited for the stage there.
"""

import contextlib
import fcntl
import mmap
import os
import struct
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

ORDERED = Path("/host/leds.grey")
PLAYING = Path("/run/cart-camera")
CAPTURE = "/dev/v4l/by-path/platform-vivid.0-video-index0"
OUTPUT = "/dev/v4l/by-path/platform-vivid.0-video-index1"
WIDTH, HEIGHT = 640, 480
SIZE = WIDTH * HEIGHT
SETTINGS = ("hdmi_000_0_is_connected_to=2", "osd_text_mode=2")
RATE_HZ = 15
LOOK_S = 0.3

# linux/videodev2.h on 64 bits
REQBUFS, QUERYBUF, QBUF, DQBUF, STREAMON = (
    0xC0145608, 0xC0585609, 0xC058560F, 0xC0585611, 0x40045612,
)  # fmt: skip
VIDEO_OUTPUT, MMAP, FIELD_NONE = 2, 1, 1
BUFFER = struct.Struct("@IIIII4x16x16xIIQI4xI4x")  # index, type, bytesused, ... offset, length
BUFFERS = 3


def tool(*arguments: str) -> None:
    subprocess.run(["v4l2-ctl", *arguments], stdout=subprocess.DEVNULL, check=True)


def wire() -> None:
    """Noise arrives where the two sides' timings differ."""
    for device in (CAPTURE, OUTPUT):
        tool("-d", device, "--set-dv-bt-timings", "index=0")
    tool("-d", OUTPUT, "--set-fmt-video-out", f"width={WIDTH},height={HEIGHT},pixelformat=GREY")
    for setting in SETTINGS:
        tool("-d", CAPTURE, "-c", setting)


class Output:
    """The HDMI output's queue of pictures."""

    def __init__(self) -> None:
        self._file = os.open(OUTPUT, os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(self._file, REQBUFS, struct.pack("IIII4x", BUFFERS, VIDEO_OUTPUT, MMAP, 0))
        self._maps = []
        for index in range(BUFFERS):
            fields = BUFFER.unpack(self._call(QUERYBUF, index))
            self._maps.append(mmap.mmap(self._file, fields[8], offset=fields[7]))
        self._free = list(range(BUFFERS))
        self._streams = False

    def _call(self, request: int, index: int, used: int = 0) -> bytes:
        data = BUFFER.pack(index, VIDEO_OUTPUT, used, 0, FIELD_NONE, 0, MMAP, 0, 0, 0)
        return fcntl.ioctl(self._file, request, data)

    def show(self, frame: bytes) -> bool:
        """False while vivid still holds all buffers."""
        with contextlib.suppress(BlockingIOError):
            while self._streams and len(self._free) < BUFFERS:
                self._free.append(BUFFER.unpack(self._call(DQBUF, 0))[0])
        if not self._free:
            return False
        index = self._free.pop()
        self._maps[index][:SIZE] = frame
        self._call(QBUF, index, SIZE)
        if not self._streams:
            fcntl.ioctl(self._file, STREAMON, struct.pack("i", VIDEO_OUTPUT))
            self._streams = True
        return True


@contextlib.contextmanager
def at_leisure() -> Iterator[None]:
    """As everybody: tens of megabytes take a while, in which the show needs the processors."""
    mine = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    try:
        yield
    finally:
        os.sched_setscheduler(0, *mine)


class Light:
    """The frames that the host ordered; before the first order a dark room."""

    def __init__(self) -> None:
        self.frames = [bytes(SIZE)]
        self._known = (0, 0)
        self._look_s = 0.0
        self._next = 0

    def look(self) -> bool:
        """Whether there is something new to show: the next of several frames, or another order."""
        now = time.monotonic()
        if now >= self._look_s:
            self._look_s = now + LOOK_S
            with contextlib.suppress(OSError):
                found = ORDERED.stat()
                if (found.st_mtime_ns, found.st_size) != self._known:
                    self._fetch()
                    self._known = found.st_mtime_ns, found.st_size
                    PLAYING.write_text(f"{found.st_mtime_ns}\n")
                    return True
        return len(self.frames) > 1

    def _fetch(self) -> None:
        with at_leisure():
            data = ORDERED.read_bytes()
            self.frames = [data[at : at + SIZE] for at in range(0, len(data) - SIZE + 1, SIZE)]
        self._next = 0

    def frame(self) -> bytes:
        self._next += 1
        return self.frames[self._next % len(self.frames)]


def main() -> None:
    while not (Path(CAPTURE).exists() and Path(OUTPUT).exists()):
        time.sleep(LOOK_S)
    wire()
    output, light = Output(), Light()
    light.look()
    output.show(light.frame())
    with contextlib.suppress(OSError):  # unplugged: the service starts again until it is back
        while Path(OUTPUT).exists():
            time.sleep(1 / RATE_HZ)
            if light.look():
                output.show(light.frame())


if __name__ == "__main__":
    main()
