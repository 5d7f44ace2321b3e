"""New code comes when nobody looks: blackout, or no mask for a minute."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hypermask.blackboard import Record, SharedTopic
from hypermask.show.scene import SCENE
from hypermask.stage.marks import OVERLAY, new_overlay
from hypermask.update import takeover
from hypermask.update.idle import DARK_S, UNSEEN_S, Idle
from hypermask.workers.board import TRACK


def scene(brightness: float) -> Record:
    record = np.zeros((), SCENE)
    record["brightness"] = record["previous_brightness"] = brightness
    return record


def track(seen_s: float, time_s: float, locked: bool = True) -> Record:
    record = np.zeros((), TRACK)
    record["seen_s"], record["time_s"], record["locked"] = seen_s, time_s, locked
    return record


@pytest.fixture
def idle(tmp_path: Path) -> Idle:
    return Idle(tmp_path, 1000.0)


def test_a_mask_that_is_seen_is_never_interrupted(idle: Idle) -> None:
    for now_s in np.arange(1000.0, 1400.0, 1.0):
        assert idle.judge(scene(1.0), track(now_s, now_s), now_s) is None


def test_a_minute_without_a_mask_is_idle(idle: Idle) -> None:
    def looks(now_s: float) -> str | None:
        return idle.judge(scene(1.0), track(1100.0, now_s, locked=False), now_s)

    assert looks(1100.0 + UNSEEN_S - 1) is None
    assert looks(1100.0 + UNSEEN_S) == "no mask was seen for 60 s"


def test_a_minute_is_waited_from_the_upgrade_on(idle: Idle) -> None:
    """Whoever upgrades while the mask is on the table has a minute to take it up."""
    assert idle.judge(scene(1.0), track(0.0, 1001.0, locked=False), 1001.0) is None


def test_a_tracker_that_died_while_it_saw_the_mask_does_not_block_for_ever(idle: Idle) -> None:
    last = track(1000.0, 1000.0)
    assert idle.judge(scene(1.0), last, 1030.0) is None
    assert idle.judge(scene(1.0), last, 1000.0 + UNSEEN_S) is not None


def test_blackout_is_idle_after_a_moment(idle: Idle) -> None:
    """Not in a short blackout between two scenes."""
    for now_s in (1000.0, 1001.0, 1002.0):
        assert idle.judge(scene(0.0), track(now_s, now_s), now_s) is None
    now_s = 1000.0 + DARK_S
    assert idle.judge(scene(0.0), track(now_s, now_s), now_s) == "blackout"


def test_a_blackout_that_fades_is_not_dark_yet(idle: Idle) -> None:
    record = scene(0.0)
    record["previous_brightness"] = 1.0
    record["brightness_fade"] = (1000.0, 8.0)
    assert idle.judge(record, track(1005.0, 1005.0), 1005.0) is None


def test_a_fixed_screen_is_never_seen_by_a_camera_and_waits_for_a_blackout(tmp_path: Path) -> None:
    idle = Idle(tmp_path, 1000.0, tracked=False)
    for now_s in np.arange(1000.0, 1200.0, 1.0):
        assert idle.judge(scene(1.0), None, now_s) is None
    assert idle.judge(scene(0.0), None, 1200.0 + DARK_S) == "blackout"


def test_a_calibration_is_not_interrupted(tmp_path: Path) -> None:
    SharedTopic(tmp_path / "scene", SCENE).publish(scene(0.0))
    idle = Idle(tmp_path, 1000.0)
    overlay = SharedTopic(tmp_path / "overlay", OVERLAY)
    overlay.publish(new_overlay(1100.0, True))
    assert idle.why(1100.5) is None
    overlay.publish(new_overlay(1101.0, False))
    assert idle.why(1101.5) == "blackout"


def test_no_show_is_idle(idle: Idle) -> None:
    assert idle.why(1000.0) == "no show plays"


def test_another_versions_blackboard_is_left_to_the_technician(tmp_path: Path) -> None:
    SharedTopic(tmp_path / "scene", np.dtype([("else", "<f8")]))
    assert Idle(tmp_path, 1000.0).why(5000.0) is None


def test_waiting_ends_when_somebody_switched_by_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(takeover, "pending", lambda: False)
    assert takeover.wait(tmp_path) is None
    assert takeover.main() == 1


def test_pending_compares_what_plays_with_what_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HYPERMASK_RUN", str(tmp_path))
    monkeypatch.setattr(takeover, "installed_release", lambda: "2+b")
    assert not takeover.pending()  # no show
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "release").write_text("1+a\n", "utf-8")
    assert takeover.pending()
    (tmp_path / "code" / "release").write_text("2+b\n", "utf-8")
    assert not takeover.pending()
