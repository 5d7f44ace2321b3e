"""The running show and the installed code: which plays, and when the new one takes over.

`python3 -m hypermask.update.takeover` waits until nobody looks, and ends with 0: its unit then
restarts the show (debian/libexec/takeover); with 1 when there is nothing to take over any more.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from hypermask import paths
from hypermask.errors import HypermaskError
from hypermask.update.idle import Idle
from hypermask.update.install import SHARE

SWITCH = Path("/usr/libexec/hypermask/takeover")
UNIT = "hypermask-takeover.service"
EVERY_S = 1.0


def installed_release(share: Path = SHARE) -> str | None:
    """VERSION+CHECKSUM of the installed code."""
    return _line(share / "release")


def playing_release() -> str | None:
    """Of the code that the running show has; None while there is none."""
    return _line(paths.run() / "code" / "release")


def pending() -> bool:
    playing = playing_release()
    return playing is not None and playing != installed_release()


def wait(board: Path) -> str | None:
    """Returns why nobody looks, when nobody does; None when it was done by command meanwhile."""
    idle = Idle(board, time.monotonic(), _tracked())
    while pending():
        reason = idle.why(time.monotonic())
        if reason is not None:
            return reason
        time.sleep(EVERY_S)
    return None


def _tracked() -> bool:
    """Whether this machine's mask is seen by a camera."""
    from hypermask.machine.files import load

    try:
        return load().machine.mapping != "fixed"
    except HypermaskError:
        return True


def switch() -> None:
    """Now, whoever looks. Raises `HypermaskError` UPD-SWITCH."""
    try:
        done = subprocess.run([str(SWITCH)], capture_output=True, text=True)
    except OSError as error:
        done = subprocess.CompletedProcess([], 1, "", str(error))
    if done.returncode:
        raise HypermaskError(
            "UPD-SWITCH",
            f"the show did not start anew: {done.stderr.strip()[-300:]}",
            "systemctl status 'hypermask*' tells more; hypermask update rollback goes back.",
        )


def _line(path: Path) -> str | None:
    try:
        return path.read_text("utf-8").strip() or None
    except OSError:
        return None


def main() -> int:
    reason = wait(paths.run() / "board")
    if reason is None:
        print("<6>UPD-SAME: the show already plays with the installed code.", file=sys.stderr)
        return 1
    print(
        f"<5>UPD-TAKEOVER: {reason}: the show begins anew with {installed_release()}.",
        file=sys.stderr,
        flush=True,
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
