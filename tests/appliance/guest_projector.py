"""Runs inside the guest: the projector driver shows pictures and says what happened, as JSON.

Waits between the steps for files that the host makes in /host.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, "/source/drivers")
from hypermask_drivers.errors import DeviceError, DeviceLost
from hypermask_drivers.projector.kms import KmsProjector
from hypermask_drivers.projector.kms_settings import KmsSettings

HOST = Path("/host")


def hand_over(step: str) -> None:
    """Tell the host that a step is reached, and wait until it has looked."""
    (HOST / f"{step}.reached").touch()
    while not (HOST / f"{step}.seen").exists():
        time.sleep(0.05)


def draw(projector: KmsProjector, shift: int) -> None:
    """Three bands on black: red at the left top, green right of it, blue at the left bottom."""
    width, height = projector.mode.width, projector.mode.height
    framebuffer = projector.framebuffer
    with projector.context:
        framebuffer.viewport = (0, 0, width, height)
        framebuffer.clear(0.0, 0.0, 0.0, 1.0)
        framebuffer.clear(1.0, 0.0, 0.0, viewport=(shift, height - 100, 200, 100))
        framebuffer.clear(0.0, 1.0, 0.0, viewport=(shift + 300, height - 100, 200, 100))
        framebuffer.clear(0.0, 0.0, 1.0, viewport=(shift, 0, 200, 50))


def main() -> None:
    projector = KmsProjector(KmsSettings(mode=sys.argv[1] if len(sys.argv) > 1 else None))
    result: dict[str, object] = {}
    for _ in range(100):
        try:
            projector.open()
            break
        except DeviceError as error:
            result["waited"] = str(error)
            time.sleep(0.2)
    result["renderer"] = projector.context.info["GL_RENDERER"]
    result["version_code"] = projector.context.version_code
    result["mode"] = vars(projector.mode)
    result["framebuffer"] = projector.framebuffer.size
    result["connector"] = projector.connector
    result["shortfalls"] = [str(each) for each in projector.shortfalls]
    hand_over("opened")
    draw(projector, 0)
    with projector.context:
        data = projector.framebuffer.read(components=4)
    rows = np.frombuffer(data, np.uint8).reshape(projector.mode.height, projector.mode.width, 4)
    result["read_back"] = {
        "red": rows[-10, 10, :3].tolist(), "blue": rows[10, 10, :3].tolist(),
        "black": rows[-10, 250, :3].tolist(),
    }  # fmt: skip
    promised, flips = [], []
    for _ in range(30):
        draw(projector, 0)
        promised.append(projector.next_flip_s())
        before = time.monotonic()
        flips.append(projector.present())
        assert before - 0.1 <= flips[-1] <= time.monotonic() + 0.001
    result["promised"], result["flips"] = promised, flips
    result["missed"] = projector.missed_flips
    hand_over("drawn")
    draw(projector, 640)
    projector.present()
    hand_over("moved")
    identity = id(projector.context)
    lost = ""
    if "replug" in sys.argv:
        deadline = time.monotonic() + 60
        (HOST / "unplug.reached").touch()
        while time.monotonic() < deadline and not lost:
            try:
                draw(projector, 0)
                projector.present()
            except DeviceLost as error:
                lost = str(error)
        result["lost"] = lost
        (HOST / "replug.reached").touch()
        while time.monotonic() < deadline:
            try:
                projector.open()
                break
            except DeviceError as error:
                result["away"] = str(error)
                time.sleep(0.2)
        result["same_context"] = id(projector.context) == identity
        draw(projector, 320)
        projector.present()
        hand_over("back")
    projector.close()
    (HOST / "projector.json").write_text(json.dumps(result, indent=1))
    hand_over("closed")


if __name__ == "__main__":
    main()
