"""What the status says of a show, from its blackboard alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hypermask.loudspeaker.offset import LIP_SYNC
from hypermask.show.engine import ShowEngine
from hypermask.show.showfile import ShowFile
from hypermask.workers.board import MOUTH, PACE, TRACK, Board
from hypermask.workers.status import Status, look

NOW = 1000.0


@pytest.fixture
def board(tmp_path: Path) -> Board:
    """A show in which all is well."""
    board = Board.shared(tmp_path)
    track, mouth, pace = (np.zeros((), dtype) for dtype in (TRACK, MOUTH, PACE))
    track["time_s"] = track["seen_s"] = NOW - 0.01
    track["locked"] = track["camera_ready"] = True
    mouth["time_s"], mouth["level_db"] = NOW - 0.02, -30.0
    pace["flip_s"], pace["period_s"], pace["latch_lead_s"] = NOW, 1 / 60, 0.005
    board.track.publish(track)
    board.mouth.publish(mouth)
    board.pace.publish(pace)
    show = ShowFile(version=1, name="x", characters=("mean",))
    board.scene.publish(ShowEngine(show, NOW - 9).scene)
    board.lip_sync.publish(np.array((NOW, 0.050, 0.045, 0.005), LIP_SYNC))
    return board


def lines(status: Status) -> dict[str, str]:
    return {line.name: line.text for line in status.lines if not line.fine}


def test_a_show_in_which_all_is_well(board: Board, tmp_path: Path) -> None:
    status = look(tmp_path, NOW)
    assert status.fine
    texts = {line.name: line.text for line in status.lines}
    assert texts["show"] == "mean, neutral, light 100%"
    assert texts["stage"].startswith("60 pictures a second")
    assert "5 ms after the loudspeaker: together" in texts["lip sync"]


def test_a_mask_that_is_not_seen(board: Board, tmp_path: Path) -> None:
    track = board.track.latest()
    assert track is not None
    track["locked"], track["seen_s"] = False, NOW - 3
    board.track.publish(track)
    assert lines(look(tmp_path, NOW)) == {
        "tracker": "the mask is not seen for 3.0 s; 0 frames, 0 dropped"
    }


def test_a_mask_that_was_never_seen(board: Board, tmp_path: Path) -> None:
    track = board.track.latest()
    assert track is not None
    track["locked"], track["seen_s"] = False, -np.inf
    board.track.publish(track)
    status = look(tmp_path, NOW)
    assert lines(status) == {"tracker": "the mask has not been seen yet; 0 frames, 0 dropped"}
    (tracker,) = [line for line in status.lines if line.name == "tracker"]
    assert tracker.figures["unseen_s"] is None


def test_workers_that_have_stopped_are_named(board: Board, tmp_path: Path) -> None:
    assert set(lines(look(tmp_path, NOW + 2))) == {"tracker", "voice", "stage"}


def test_sound_and_mouth_far_apart_is_a_fault(board: Board, tmp_path: Path) -> None:
    board.lip_sync.publish(np.array((NOW, 0.120, 0.0, 0.120), LIP_SYNC))
    assert set(lines(look(tmp_path, NOW))) == {"lip sync"}


def test_a_board_on_which_nobody_has_written(tmp_path: Path) -> None:
    found = lines(look(tmp_path, NOW))
    assert set(found) == {"tracker", "voice", "stage", "show"}
