"""How long the stage takes from its start to its first face, beside the least that any Python
program with its two main libraries takes."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from hypermask import paths
from hypermask.bench.table import Table
from hypermask.blackboard import Record
from hypermask.geometry import FACING, Pose
from hypermask.rehearsal.desk import Desk, wait_for
from hypermask.services import prepared
from hypermask.services.warm import go_first
from hypermask.show.engine import ShowEngine
from hypermask.show.showfile import load_show
from hypermask.tracking.motion import MotionFilter
from hypermask.workers.board import TRACK, Board
from hypermask.workers.health import Healths

ROUNDS = 9
LEAST = "import numpy, moderngl"
_BEAT_S = 0.004
_LONG_S = 60.0


def start(progress: bool) -> Table:
    """Both in turn, so that whatever else the machine does touches both."""
    go_first()  # whoever plays tracker and show must not be late, or the mask counts as unseen
    least_s, prepared_s, first_s = [], [], []
    with tempfile.TemporaryDirectory(prefix="hypermask-") as folder:
        desk = Desk(Path(folder), {"projector": {"driver": "offscreen"}})
        with desk, _Others(desk) as others:
            first_s.append(_first_face(desk, others))
            _prepare(desk, others)
            for _ in range(ROUNDS):
                least_s.append(_least())
                prepared_s.append(_first_face(desk, others))
    ratio = statistics.median(prepared_s) / statistics.median(least_s)
    best = min(prepared_s) / min(least_s)
    rows = [
        (f'python3 -c "{LEAST}"', statistics.median(least_s), min(least_s), 1.0),
        ("stage, start to first face", statistics.median(prepared_s), min(prepared_s), ratio),
        ("stage, its very first start", first_s[0], first_s[0], None),
    ]
    return Table(
        "start",
        "From the start of the stage's service to its first face",
        ("what", "median s", "best s", "ratio of the medians"),
        rows,
        (
            f"{ROUNDS} rounds of both in turn; mask seen and show playing, projector off screen, "
            "software GL; both with real-time priority where it is granted. The ratio is the "
            "figure: seconds depend on the machine and its load.",
            "The very first start has nothing prepared: it compiles shaders and makes costumes.",
            "Target: ratio <= 2.5.",
        ),
        data={"ratio": round(ratio, 3), "ratio_of_best": round(best, 3)},
    )


class _Others:
    """What tracker and show would write: a mask that stands still and the default show."""

    def __init__(self, desk: Desk) -> None:
        self._board = Board.shared(desk.board)
        show = load_show(paths.configs() / "shows" / "default.toml")
        self._board.scene.publish(ShowEngine(show, time.monotonic()).scene)
        self._motion = MotionFilter()
        self._record: Record = np.zeros((), TRACK)
        self.health = Healths(desk.board)

    def __enter__(self) -> _Others:
        return self

    def __exit__(self, *error: object) -> None:
        """Nothing to close: the blackboard goes with its folder."""

    def beat(self) -> None:
        now_s, record = time.monotonic(), self._record
        pose = Pose(FACING.copy(), np.array([0.15, -0.33, 1.8]))
        self._motion.update(now_s, pose, np.eye(6) * 1e-6)
        record["motion"], record["locked"] = self._motion.record(), True
        record["seen_s"] = record["time_s"] = now_s
        self._board.track.publish(record)
        time.sleep(_BEAT_S)


def _least() -> float:
    began_s = time.monotonic()
    # With the same right to the processor as the stage takes itself: the work is compared.
    subprocess.run([sys.executable, "-c", LEAST], check=True, preexec_fn=go_first)
    return time.monotonic() - began_s


def _first_face(desk: Desk, others: _Others) -> float:
    """Seconds from starting the process to the flip that shows the first face."""
    began_s = time.monotonic()
    process = desk.start("stage")

    def lit() -> Any:
        others.beat()
        record = others.health.all().get("stage")
        mine = record is not None and int(record["pid"]) == process.pid
        return record["first_s"].item() if mine and record is not None else 0.0

    lit_s: float = wait_for(lit, _LONG_S, "the first face", 0.0)
    # The rest is loaded before it is ended, as in a show.
    wait_for(lambda: _beaten(others, lit_s + 1.0), _LONG_S, "the second after it", 0.0)
    desk.stop("stage")
    return lit_s - began_s


def _beaten(others: _Others, until_s: float) -> bool:
    others.beat()
    return time.monotonic() > until_s


def _prepare(desk: Desk, others: _Others) -> None:
    """Let the dresser prepare the next start."""
    file = desk.home / prepared.path().relative_to(paths.home())
    desk.start("dresser")
    wait_for(file.is_file, _LONG_S, "the overture", 0.05)
    desk.kill("dresser")
    _first_face(desk, others)
