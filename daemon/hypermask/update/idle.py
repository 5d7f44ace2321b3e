"""Whether anybody looks: new code comes only when nobody does."""

from __future__ import annotations

from pathlib import Path

from hypermask.blackboard import ReadTopic, Record, SharedTopic
from hypermask.errors import HypermaskError
from hypermask.show.scene import SCENE, brightness_at
from hypermask.stage.marks import OVERLAY, lit
from hypermask.workers.board import TRACK

UNSEEN_S = 60.0
DARK_S = 3.0
SILENT_S = 10.0
"""Without a frame for so long the camera says nothing about the mask."""


class Idle:
    """Looks at the blackboard of the running show again and again; all times CLOCK_MONOTONIC."""

    def __init__(self, board: Path, now_s: float, tracked: bool = True) -> None:
        """tracked: False for a screen that is fixed to its projector, which no camera ever sees."""
        self._board, self._tracked = board, tracked
        self._began_s = now_s
        self._bright_s = now_s

    def why(self, now_s: float) -> str | None:
        """Why nobody looks now; None while somebody may."""
        if not (self._board / "scene").exists():
            return "no show plays"
        try:
            scene = SharedTopic(self._board / "scene", SCENE).latest()
            track = SharedTopic(self._board / "track", TRACK).latest()
            if lit(ReadTopic(self._board / "overlay", OVERLAY).latest(), now_s):
                return None  # somebody calibrates
        except (HypermaskError, OSError):
            return None  # another version's, or not ours to read: only by command
        return self.judge(scene, track, now_s)

    def judge(self, scene: Record | None, track: Record | None, now_s: float) -> str | None:
        if scene is None:
            return "no show plays"
        if brightness_at(scene, now_s) > 0:
            self._bright_s = now_s
        elif now_s - self._bright_s >= DARK_S:
            return "blackout"
        if not self._tracked:
            return None
        seen_s = self._began_s
        if track is not None:
            seen_s = max(seen_s, float(track["seen_s"]))
            if now_s - float(track["time_s"]) < SILENT_S and track["locked"]:
                seen_s = now_s
        if now_s - seen_s >= UNSEEN_S:
            return f"no mask was seen for {UNSEEN_S:.0f} s"
        return None
