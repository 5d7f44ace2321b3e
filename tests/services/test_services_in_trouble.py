"""What services do when their files are not as they should be: the show must go on."""

from __future__ import annotations

import os
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from services_rig import LONG_S, Show

from hypermask.rehearsal.desk import wait_for

UNUSABLE = 78
"""EX_CONFIG: systemd does not start the service again."""


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Show]:
    with Show(tmp_path / "desk") as desk:
        yield desk


def test_a_broken_configuration_is_replaced_by_the_last_good_one_and_said_loudly(
    desk: Show,
) -> None:
    desk.start("stage")
    desk.start("show")
    wait_for((desk.home / "machine" / "last-good.toml").is_file, LONG_S, "last-good.toml")
    assert desk.stop("show") == 0
    desk.configure({**desk.machine, "machine": "sim", "stage": {"brightness": 1}})
    desk.start("tracker")
    desk.await_more("tracker")
    assert "<3>CFG-LASTGOOD: " in desk.said("tracker") and "brightness" in desk.said("tracker")
    assert desk.await_working("tracker")["fault"] == b"CFG-LASTGOOD"


def test_a_configuration_without_a_picture_is_not_a_good_one(desk: Show) -> None:
    desk.start("show")
    began_s = desk.await_working("show")["time_s"]
    desk.await_health("show", lambda show: show["time_s"] > began_s + 1.0, "the show goes on")
    assert not (desk.home / "machine" / "last-good.toml").exists()


def test_without_anything_usable_a_service_ends_as_systemd_wants_it(tmp_path: Path) -> None:
    with Show(tmp_path / "desk", machine="boat") as desk:
        process = desk.start("tracker")
        assert process.wait(LONG_S) == UNUSABLE
        assert desk.said("tracker").startswith("<3>CFG-MACHINE: there is no machine 'boat'. ")
        assert desk.said("tracker").count("\n") == 1


def test_an_unknown_service_is_wrong_usage(desk: Show) -> None:
    assert desk.start("conductor").wait(LONG_S) == 2


def test_a_blackboard_of_another_version_is_made_anew(desk: Show) -> None:
    desk.start("pantilt")
    desk.await_working("pantilt")
    track = desk.board / "track"
    layout = bytearray(track.read_bytes())
    layout[8] ^= 0xFF
    track.write_bytes(bytes(layout))
    before = desk.board.stat().st_ino
    desk.start("voice")
    wait_for(lambda: desk.board.is_dir() and desk.board.stat().st_ino != before, LONG_S, "a board")
    desk.look_anew()
    desk.await_working("voice")
    # Who still had the old one begins again, and then all share the new one.
    assert desk.processes["pantilt"].wait(LONG_S) == 1
    assert "BOARD-NEW" in desk.said("pantilt")
    desk.start("pantilt")
    desk.await_working("pantilt")
    assert [path.name for path in desk.run.glob(".board.old*")] == []


def test_a_show_that_cannot_be_played_is_replaced_by_the_default_one(tmp_path: Path) -> None:
    with Show(tmp_path / "desk", show="mine") as desk:
        shows = desk.home / "shows"
        shows.mkdir(parents=True)
        (shows / "mine.toml").write_text('version = 1\nname = "mine"\ncharacters = [')
        desk.start("show")
        desk.await_working("show")
        assert "<3>SHOW-FALLBACK: " in desk.said("show")
        assert desk.records.scene.latest() is not None


def test_a_stage_alone_plays_the_first_character_that_can_be_read(tmp_path: Path) -> None:
    """One is damaged, one is not there, nobody calibrated, and no show ever speaks."""
    with Show(tmp_path / "desk", show="mine") as desk:
        shows, shelf = desk.home / "shows", desk.home / "characters" / "broken"
        shelf.mkdir(parents=True)
        (shelf / "character.toml").write_text("version = 1")
        shows.mkdir(parents=True)
        cast = '["broken", "nobody", "noh", "clown"]'
        (shows / "mine.toml").write_text(f'version = 1\nname = "mine"\ncharacters = {cast}')
        desk.start("stage")
        desk.start("tracker")
        desk.await_health("stage", lambda stage: stage["first_s"] > 0, "a face")
        said = desk.said("stage")
        assert "CFG-MISSING" in said and "CHAR-ABSENT" in said and "CAL-NONE" in said


def test_a_machine_without_a_device_has_a_service_that_waits_quietly(tmp_path: Path) -> None:
    with Show(tmp_path / "desk", pantilt={"driver": "none"}) as desk:
        heard = Journal(tmp_path / "notify")
        desk.start("pantilt", NOTIFY_SOCKET=str(heard.path), WATCHDOG_USEC="1000000")
        desk.await_working("pantilt")
        heard.until("STATUS=no pan-tilt unit in this machine")
        heard.until("WATCHDOG=1")
        assert desk.said("pantilt") == ""


class Journal:
    """What a service tells systemd."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.settimeout(LONG_S)
        self.heard: list[str] = []

    def until(self, line: str) -> None:
        """Wait for a line. Raises `TimeoutError`."""
        while line not in self.heard:
            self.heard += self._socket.recv(4096).decode().splitlines()

    def rest(self) -> list[str]:
        """Everything that came, and what comes within a moment."""
        self._socket.settimeout(0.1)
        while True:
            try:
                self.heard += self._socket.recv(4096).decode().splitlines()
            except TimeoutError:
                return self.heard


def test_systemd_is_told_of_start_work_and_end(desk: Show, tmp_path: Path) -> None:
    heard = Journal(tmp_path / "notify")
    desk.start("tracker", NOTIFY_SOCKET=str(heard.path), WATCHDOG_USEC="1000000")
    heard.until("READY=1")
    heard.until("WATCHDOG=1")
    heard.until("STATUS=sees the mask")
    assert desk.stop("tracker") == 0
    assert heard.rest()[-1] == "STOPPING=1"


def test_a_camera_that_is_away_is_asked_for_again_and_nobody_thinks_the_tracker_hung(
    tmp_path: Path,
) -> None:
    fault = '[[faults]]\nkind = "camera_lost"\nfrom_s = 0.0\nto_s = 86400.0\n'
    with Show(tmp_path / "desk", fault) as desk:
        heard = Journal(tmp_path / "notify")
        desk.start("tracker", NOTIFY_SOCKET=str(heard.path), WATCHDOG_USEC="1000000")
        heard.until("STATUS=waits for the camera")
        heard.heard.clear()
        heard.until("WATCHDOG=1")
        heard.heard.clear()
        heard.until("WATCHDOG=1")
        assert desk.said("tracker").count("CAM-ABSENT") == 1
        assert not desk.await_working("tracker")["ready"]


@pytest.fixture
def full_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder on a file system of its own without a byte left."""
    folder = tmp_path / "full"
    folder.mkdir()
    mounted = os.geteuid() == 0 and not subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)],
        capture_output=True,
        check=False,
    ).returncode  # fmt: skip
    if not mounted:
        pytest.skip("only root may mount a small file system to fill")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=False)


def fill(folder: Path) -> None:
    with (folder / "filler").open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            pass


def test_the_show_plays_on_a_full_disk(tmp_path: Path, full_disk: Path) -> None:
    """Nothing can be kept: neither configuration nor costumes nor events."""
    with Show(tmp_path / "desk") as desk:
        desk.home.rmdir()
        desk.home.symlink_to(full_disk)
        (desk.run / "events").symlink_to(full_disk)
        fill(full_disk)
        for name in ("show", "dresser", "stage", "tracker"):
            desk.start(name)
        desk.await_health("stage", lambda stage: stage["first_s"] > 0, "a face")
        desk.await_said("show", "DISK-WRITE")
        desk.await_said("dresser", "DISK-WRITE")
        for name in ("show", "dresser", "stage", "tracker"):
            desk.await_working(name)


def test_a_full_memory_disk_is_said_and_kills_nobody(tmp_path: Path, full_disk: Path) -> None:
    """The blackboard lies in memory: a page that is not there must not be written to."""
    with Show(tmp_path / "desk") as desk:
        fill(full_disk)
        desk.board.symlink_to(full_disk)
        assert desk.start("tracker").wait(LONG_S) == 1
        assert "<3>DISK-WRITE: " in desk.said("tracker")


def test_the_safe_state_is_dark_and_parked(tmp_path: Path) -> None:
    with Show(tmp_path / "desk", neck={"silence_s": 0.1, "park_after_s": 0.1}) as desk:
        heard = Journal(tmp_path / "notify")
        desk.start("safe", NOTIFY_SOCKET=str(heard.path))
        heard.until("READY=1")
        heard.until("STATUS=dark; the head is parked")
        assert desk.stop("safe") == 0


def test_the_safe_state_needs_neither_configuration_nor_blackboard(tmp_path: Path) -> None:
    """What ended the others may be just that."""
    with Show(tmp_path / "desk", machine="boat") as desk:
        heard = Journal(tmp_path / "notify")
        desk.board.write_text("in the way")
        desk.start("safe", NOTIFY_SOCKET=str(heard.path), WATCHDOG_USEC="1000000")
        heard.until("READY=1")
        heard.until("WATCHDOG=1")
        assert "<3>CFG-MACHINE" in desk.said("safe")
        assert desk.stop("safe") == 0


def test_a_camera_of_another_size_still_finds_the_mask(tmp_path: Path) -> None:
    """Its optics were measured at twice the size; an unscaled model would find nothing."""
    optics = {"camera": {"focal_px": 900.0, "width": 1280, "height": 800}}
    with Show(tmp_path / "desk", optics=optics) as desk:
        desk.start("tracker")
        desk.await_said("tracker", "MASK-FOUND")
        assert desk.said("tracker").count("CAM-OPTICS") == 1
        track = desk.records.track.latest()
        assert track is not None
        assert track["motion"]["translation"][2] == pytest.approx(1.8, abs=0.15)
