"""Runs inside the guest: the camera driver on vivid, whose HDMI output feeds its HDMI input.

The pictures of /host/frames.grey are played on the output in a loop; what the camera driver then
delivers, and what it says of faults, goes into /host/camera.json.
"""

import hashlib
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, "/source/drivers")
from hypermask_drivers.camera import v4l2_abi as abi
from hypermask_drivers.camera.v4l2 import V4l2Camera, V4l2Settings
from hypermask_drivers.errors import DeviceError, DeviceLost

HOST = Path("/host")
CAPTURE = "/dev/v4l/by-path/platform-vivid.0-video-index0"
OUTPUT = "/dev/v4l/by-path/platform-vivid.0-video-index1"


def tool(*arguments: str) -> str:
    done = subprocess.run(["v4l2-ctl", *arguments], capture_output=True, text=True, check=True)
    return done.stdout


def player() -> subprocess.Popen[bytes]:
    """Plays the pictures on the HDMI output."""
    for device in (CAPTURE, OUTPUT):  # noise arrives where the two differ
        tool("-d", device, "--set-dv-bt-timings", "index=0")
    tool("-d", OUTPUT, "--set-fmt-video-out", "width=640,height=480,pixelformat=GREY")
    tool("-d", CAPTURE, "-c", "hdmi_000_0_is_connected_to=2", "-c", "osd_text_mode=2")
    command = ["v4l2-ctl", "-d", OUTPUT, "--stream-out-mmap=4", "--stream-loop"]
    return subprocess.Popen(
        [*command, "--stream-from=/dev/shm/frames.grey"], stdout=subprocess.DEVNULL
    )


def watch(camera: V4l2Camera, count: int) -> list[dict[str, object]]:
    """What arrives: which picture it is (by its hash), when, and how late it was fetched."""
    seen: list[dict[str, object]] = []
    raw = Path("/dev/shm/frames.grey").read_bytes()
    size = 640 * 480
    played = {hashlib.sha256(raw[at : at + size]).digest() for at in range(0, len(raw), size)}
    while len(seen) < count:
        frame = camera.read(1.0)
        if frame is None:
            continue
        data = frame.image.tobytes()
        if hashlib.sha256(data).digest() not in played:
            (HOST / f"odd-{time.monotonic_ns()}.grey").write_bytes(data)
        seen.append({
            "hash": hashlib.sha256(data).hexdigest(), "time_s": frame.time_s,
            "sequence": frame.sequence, "age_s": time.monotonic() - frame.time_s,
        })  # fmt: skip
    return seen


class Logging(V4l2Camera):
    """Keeps the driver's own stamps beside the times made of them."""

    def __init__(self, settings: V4l2Settings) -> None:
        super().__init__(settings)
        self.stamps: list[tuple[bool, float]] = []

    def _time(self, buffer: abi.Buffer, now_s: float) -> float:
        time_s = super()._time(buffer, now_s)
        stamp_s = buffer.timestamp.seconds + buffer.timestamp.microseconds * 1e-6
        start = buffer.flags & abi.BUF_FLAG_TSTAMP_SRC_MASK == abi.BUF_FLAG_TSTAMP_SRC_SOE
        self.stamps.append((start, time_s - stamp_s))
        return time_s


def told(camera: V4l2Camera) -> list[str]:
    return [str(each) for each in camera.shortfalls]


def main() -> None:
    shutil.copy("/host/frames.grey", "/dev/shm/frames.grey")
    result: dict[str, object] = {}
    playing = player()
    asked = V4l2Settings(
        device=CAPTURE, rate_hz=59.9, exposure_ms=1.0, gain=50, readout_ms=0.0, newest_only=False
    )
    camera = Logging(asked)
    camera.open()
    result["mode"], result["format"] = vars(camera.mode), camera.pixel_format
    result["shortfalls"] = told(camera)
    result["gain"] = [camera.gain, tool("-d", CAPTURE, "-C", "gain").strip()]
    watch(camera, 10)
    result["frames"] = watch(camera, 100)
    result["measured_rate_hz"] = camera.measured_rate_hz

    time.sleep(0.1)  # vivid hands a frame on before the end that its stamp tells of
    watch(camera, 1)
    result["stamp_at_end"] = camera.stamps[-1]
    tool("-d", CAPTURE, "-c", "timestamp_source=1")
    watch(camera, 10)
    result["stamp_at_start"] = camera.stamps[-1]
    tool("-d", CAPTURE, "-c", "timestamp_source=0")

    dropped = camera.dropped
    tool("-d", CAPTURE, "-c", "percentage_of_dropped_buffers=40")
    frames = watch(camera, 30)
    result["dropped"] = camera.dropped - dropped
    result["sequence_gap"] = frames[-1]["sequence"] - frames[0]["sequence"] - 29  # type: ignore[operator]
    tool("-d", CAPTURE, "-c", "percentage_of_dropped_buffers=0")

    corrupt = camera.corrupt
    playing.kill()  # the output's thread would take the error for itself
    playing.wait()
    for _ in range(30):
        tool("-d", CAPTURE, "-c", "inject_v4l2_buf_flag_error=1")
        watch(camera, 5)
        if camera.corrupt > corrupt:
            break
    result["corrupt"] = camera.corrupt - corrupt

    tool("-d", CAPTURE, "-c", "disconnect=1")
    try:
        watch(camera, 100)
    except DeviceLost as error:
        result["lost"], result["state"] = str(error), camera.state.value
    try:
        camera.open()
        result["while_away"] = "opened"
    except DeviceError as error:
        result["while_away"] = error.code
    # vivid comes back when its last user has left
    for _ in range(50):
        try:
            camera.open()
            break
        except DeviceError:
            time.sleep(0.1)
    camera.close()
    playing = player()
    camera = V4l2Camera(asked.model_copy(update={"rate_hz": 120.0, "newest_only": True}))
    camera.open()
    result["shortfalls_at_120"] = told(camera)
    watch(camera, 5)
    result["back"] = watch(camera, 20)
    camera.close()
    playing.kill()
    (HOST / "camera.json").write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
