"""The agent inside the guest: runs commands that arrive on a virtio-serial port.

One JSON object a line. Request: ``{"id": 1, "command": "ls", "timeout_s": 60}`` (a shell command).
Answer: ``{"id": 1, "status": 0, "output": "..."}``, output and errors together; status 124 after a
time-out, when everything the command started is killed. Standard library only: it is copied into
the disk and starts before anything else of ours.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

PORT_NAME = "cart.agent"
TIMED_OUT = 124


def run(command: str, timeout_s: float) -> tuple[int, str]:
    """Status and output of a shell command in a process group of its own."""
    with subprocess.Popen(
        ["/bin/sh", "-c", command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    ) as process:
        try:
            output, _ = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            output, _ = process.communicate()
            return TIMED_OUT, output.decode("utf-8", "replace")
        return process.returncode, output.decode("utf-8", "replace")


def answer(line: str) -> dict[str, Any]:
    """The answer to one request; a line that is no request is answered too."""
    try:
        request = json.loads(line)
        status, output = run(request["command"], float(request.get("timeout_s", 60)))
        return {"id": request.get("id"), "status": status, "output": output}
    except (ValueError, KeyError, TypeError) as error:
        return {"id": None, "status": 2, "output": f"not a request: {error}"}


def port() -> Path:
    """The port's device, also before udev has given it its name."""
    for name in Path("/sys/class/virtio-ports").glob("*/name"):
        if name.read_text().strip() == PORT_NAME:
            return Path("/dev") / name.parent.name
    return Path("/dev/virtio-ports") / PORT_NAME


def main() -> None:
    descriptor = os.open(port(), os.O_RDWR)
    buffer = b""
    os.write(descriptor, b'{"id": 0, "status": 0, "output": "ready"}\n')
    while True:
        data = os.read(descriptor, 65536)
        if not data:  # nobody at the other end
            signal.sigtimedwait([], 0.2)
            continue
        buffer += data
        while b"\n" in buffer:
            line, buffer = buffer.split(b"\n", 1)
            if line.strip():
                reply = json.dumps(answer(line.decode("utf-8", "replace"))) + "\n"
                _write(descriptor, reply.encode())


def _write(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data) :]


if __name__ == "__main__":
    main()
