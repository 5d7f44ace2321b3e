"""The face of the first second is the face of the show, and as dark as it when it has to be."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hypermask import paths, storage
from hypermask.errors import HypermaskError
from hypermask.geometry import FACING, Pose, rotation_from_vector
from hypermask.machine import files
from hypermask.machine.toml import dumps
from hypermask.services import overture, prepared
from hypermask.services.preparing import Preparing
from hypermask.services.rig import MachineRig
from hypermask.services.stage import StageLoop
from hypermask.show.engine import ShowEngine
from hypermask.show.showfile import load_show
from hypermask.tracking.motion import MotionFilter, predict
from hypermask.workers.board import TRACK, Board
from hypermask.workers.health import Health
from hypermask_drivers.clock import RealClock, VirtualClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.projector import Projector
from hypermask_drivers.projector.offscreen import Offscreen

SMALL = {"driver": "offscreen", "width": 320, "height": 180}
OPTICS = {
    "projector": {
        "focal_px": 480.0, "width": 320, "height": 180, "centre_px": [159.5, 179.5]
    }
}  # fmt: skip


class Cart:
    """Folders, a blackboard with a mask straight ahead and the default show, and a dresser."""

    def __init__(self, folder: Path) -> None:
        self.told: list[str] = []
        (folder / "etc" / "machine.toml").write_text(
            dumps({"machine": "sim", "projector": SMALL, "optics": OPTICS}), "utf-8"
        )
        self.board = Board.shared(folder / "run" / "board")
        self.engine = ShowEngine(
            load_show(paths.configs() / "shows" / "default.toml"), time.monotonic() - 10
        )
        self.seen()
        self.play()

    def rig(self) -> MachineRig:
        machine = files.load_machine(lambda code, text: None)
        return MachineRig(machine, self.board, self.report, Health(None, "stage", RealClock()))

    def report(self, time_s: float, code: str, text: str) -> None:
        self.told.append(code)

    def seen(self, since_s: float = 0.0) -> None:
        record, motion = np.zeros((), TRACK), MotionFilter()
        now_s = time.monotonic() - since_s
        pose = Pose(FACING @ rotation_from_vector([0.1, 0.2, 0.0]), np.array([0.15, -0.33, 1.8]))
        motion.update(now_s, pose, np.eye(6) * 1e-6)
        record["motion"], record["locked"] = motion.record(), True
        record["seen_s"] = record["time_s"] = now_s
        self.board.track.publish(record)

    def play(self, cue: str | None = None) -> None:
        if cue is not None:
            self.engine.call(cue, time.monotonic() - 5)
        self.board.scene.publish(self.engine.scene)

    def prepare(self) -> None:
        preparing = Preparing(self.rig())
        while preparing.step():
            pass


@pytest.fixture
def cart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cart]:
    for name in ("run", "home", "etc"):
        (tmp_path / name).mkdir()
        monkeypatch.setenv(f"HYPERMASK_{name.upper()}", str(tmp_path / name))
    cart = Cart(tmp_path)
    cart.prepare()
    yield cart


@pytest.fixture
def opened(cart: Cart) -> Iterator[overture.Overture]:
    found = overture.begin(cart.report)
    assert found is not None
    yield found
    found.device.close()


def light(device: Projector) -> NDArray[np.float64]:
    """(height, width, 3) of what is in the framebuffer, 0 to 1."""
    with device.context:
        data = device.framebuffer.read(components=4)
    width, height = device.framebuffer.size
    return np.frombuffer(data, np.uint8).reshape(height, width, 4)[::-1, :, :3] / 255


def drawn(opened: overture.Overture) -> NDArray[np.float64]:
    """What the overture shows some time after its beginning, its fade-in being over."""
    now_s = time.monotonic()
    opened.latch(now_s, now_s + 0.05)
    opened.draw(opened.device.framebuffer, opened.latch(now_s, now_s + 0.1))
    return light(opened.device)


def test_the_overtures_face_is_where_the_stages_face_is(
    cart: Cart, opened: overture.Overture
) -> None:
    """It has its own, smaller way to both; the eyes may look elsewhere, the skin may breathe."""
    cart.seen()
    first = drawn(opened)
    loop = StageLoop(cart.rig(), opened.device, opened)
    for _ in loop.set_up():
        pass
    for _ in range(3):  # until the light of the fade is full again
        cart.seen()
        assert loop.turn()
    second = light(opened.device)
    assert second.max() > 0.3
    lit = second.sum(axis=2) > 0.05
    both = lit & (first.sum(axis=2) > 0.05)
    assert both.sum() > 0.98 * lit.sum()
    assert np.abs(first - second)[lit].mean() < 0.02
    loop.stop()


def test_the_stage_goes_on_with_what_the_overture_dressed(
    cart: Cart, opened: overture.Overture
) -> None:
    cart.play("third")
    loop = StageLoop(cart.rig(), opened.device, opened)
    for _ in loop.set_up():
        pass
    deadline_s = time.monotonic() + 30
    while len(loop.cast) < 4 and time.monotonic() < deadline_s:
        cart.seen()
        loop.turn()
    assert set(loop.cast) == {"mean", "noh", "kabuki", "clown"}
    assert [code for code in cart.told if code != "CAL-NONE"] == []


def test_without_an_overture_the_watchdog_hears_of_each_step_of_the_set_up(cart: Cart) -> None:
    """A turn that advanced feeds it: the set-up is not one long turn."""
    rig = cart.rig()
    device = rig.device("projector")
    assert isinstance(device, Projector)
    loop = StageLoop(rig, device)
    loop.begin()
    turns = 0
    while rig.health.record["steps"] == 0 and turns < 100:
        assert loop.turn()
        turns += 1
    assert 3 < turns < 100
    loop.stop()


def test_the_character_that_was_on_comes_back(cart: Cart) -> None:
    cart.play("third")
    found = overture.begin(cart.report)
    assert found is not None and found.dressed == "kabuki"
    found.device.close()


def test_a_blackout_stays_one(cart: Cart, opened: overture.Overture) -> None:
    cart.seen()
    assert drawn(opened).max() > 0.3
    cart.play("blackout")
    assert drawn(opened).max() == 0


def test_nothing_is_lit_where_the_mask_was_a_second_ago(
    cart: Cart, opened: overture.Overture
) -> None:
    cart.seen(since_s=1.0)
    assert drawn(opened).max() == 0


def test_nothing_is_lit_before_a_show_said_anything(cart: Cart, opened: overture.Overture) -> None:
    scene = paths.run() / "board" / "scene"
    with scene.open("r+b") as file:
        file.seek(16)  # its sequence number: nothing was ever written
        file.write(bytes(8))
    assert opened.latch(time.monotonic(), time.monotonic()).items == ()


def test_the_mask_is_predicted_as_the_filter_does_it() -> None:
    motion = MotionFilter()
    for frame in range(30):
        turn = rotation_from_vector([0.0, 0.01 * frame, 0.004 * frame])
        place = np.array([0.002 * frame, 0.0, 1.8])
        motion.update(frame / 120, Pose(FACING @ turn, place), np.eye(6) * 1e-8)
    record, later_s = motion.record(), 29 / 120 + 0.04
    expected = predict(record, later_s, "kalman").pose
    found = overture.pose_at(record, later_s)
    assert np.allclose(found[:3, :3], expected.rotation, atol=1e-3)
    assert np.allclose(found[:3, 3], expected.translation, atol=1e-3)


# --- when there is no overture ------------------------------------------------------------------


def test_there_is_none_before_anything_was_prepared(tmp_path: Path, cart: Cart) -> None:
    prepared.path().unlink()
    assert overture.begin(cart.report) is None


@pytest.mark.parametrize("part", ["etc/50-new.toml", "home/calibration", "run/../etc/machine.toml"])
def test_there_is_none_after_anything_changed(tmp_path: Path, cart: Cart, part: str) -> None:
    path = tmp_path / part
    if path.exists():
        path.write_text(path.read_text() + "\n# changed")
    elif path.suffix:
        path.write_text("[stage]\nbrightness_limit = 0.5")
    else:
        path.mkdir()
    assert overture.begin(cart.report) is None


def test_there_is_none_from_half_a_file(cart: Cart) -> None:
    data = prepared.path().read_bytes()
    for length in (0, 10, len(data) // 2, len(data) - 1):
        prepared.path().write_bytes(data[:length])
        assert overture.begin(cart.report) is None


def test_there_is_none_from_another_version_of_the_program(
    cart: Cart, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(overture, "CODE", "/run/hypermask/code/other")
    assert overture.begin(cart.report) is None


def test_there_is_none_without_its_costumes(cart: Cart) -> None:
    for costume in (paths.home() / "cache" / "costumes").iterdir():
        costume.unlink()
    assert overture.begin(cart.report) is None


@pytest.mark.parametrize("damage", [b"", b"{}\n", b"\xff" * 100])
def test_one_that_fails_gives_the_projector_back(
    cart: Cart, monkeypatch: pytest.MonkeyPatch, damage: bytes
) -> None:
    """An open card has one master: the long way could not take it."""
    closed = []
    close = Offscreen.close
    monkeypatch.setattr(Offscreen, "close", lambda device: (closed.append(device), close(device)))
    for costume in (paths.home() / "cache" / "costumes").iterdir():
        costume.write_bytes(damage)
    assert overture.begin(cart.report) is None
    (device,) = closed
    assert device.state is DeviceState.ABSENT


def test_costumes_that_are_missing_are_made_again(cart: Cart) -> None:
    costumes = paths.home() / "cache" / "costumes"
    before = {costume.name for costume in costumes.iterdir()}
    for costume in costumes.iterdir():
        costume.unlink()
    cart.prepare()
    assert {costume.name for costume in costumes.iterdir()} == before


def test_a_full_disk_is_tried_less_and_less_often_until_it_has_room(
    cart: Cart, monkeypatch: pytest.MonkeyPatch
) -> None:
    costumes = paths.home() / "cache" / "costumes"
    shutil.rmtree(costumes)
    rig, clock, tried = cart.rig(), VirtualClock(), []

    def full(path: Path, data: bytes) -> None:
        tried.append(clock.now())
        raise HypermaskError("DISK-WRITE", "the disk is full", "Free some space.")

    rig.clock = clock
    preparing = Preparing(rig)
    with monkeypatch.context() as patch:
        patch.setattr(storage, "write_atomically", full)
        for _ in range(300):
            assert not preparing.step()
            clock.sleep_until(clock.now() + 1.0)
    assert tried == [0, 5, 15, 35, 75, 155, 235]
    assert cart.told.count("DISK-WRITE") == 1
    clock.sleep_until(clock.now() + 80.0)
    while preparing.step():
        pass
    assert len(list(costumes.iterdir())) == 5
    shutil.rmtree(costumes)
    clock.sleep_until(clock.now() + 5.0)
    assert preparing.step()


def test_a_machine_of_which_none_can_be_prepared_has_none(tmp_path: Path, cart: Cart) -> None:
    (tmp_path / "etc" / "50-other.toml").write_text('mapping = "planar"')
    cart.prepare()
    assert not prepared.path().exists()


def test_a_layout_survives_the_file() -> None:
    for dtype in (TRACK, np.dtype([("a", "<f4", (2, 3)), ("b", [("c", "S8")], (4,))])):
        assert prepared.layout(prepared.description(dtype)) == dtype
