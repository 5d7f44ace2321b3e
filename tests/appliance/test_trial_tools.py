"""What the virtual cart's trial judges with, without a virtual machine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stage_references import Cart, Place, judge, likeness
from virtual_show import PLACE, PLAYER_HZ, SWAY_S

from hypermask.services.rig import camera_model
from hypermask.tracking.motion import MotionFilter
from hypermask.tracking.tracker import Tracker, TrackerSettings
from hypermask_sim.appliance.image import needed_by, recipe
from hypermask_sim.appliance.qemu import Machine, VirtualCart, stumbles
from hypermask_sim.appliance.report import Part, gather
from hypermask_sim.appliance.watch import Glance, GuestClock, dark_moments, longest_freeze_s


def glances(*seen: tuple[float, str, float]) -> list[Glance]:
    return [Glance(at_s, at_s + 0.05, name, lit, 720) for at_s, name, lit in seen]


def test_a_picture_that_stands_is_a_freeze() -> None:
    moving = glances((0.0, "a", 0.1), (0.5, "b", 0.1), (1.0, "c", 0.1))
    assert longest_freeze_s(moving) == 0
    looks = [(0.5 + 0.3 * n, "b", 0.1) for n in range(6)]
    stood = glances((0.0, "a", 0.1), *looks, (2.3, "c", 0.1))
    assert longest_freeze_s(stood) == pytest.approx(1.45)


def test_a_machine_that_was_not_looked_at_for_long_is_not_blamed_for_it() -> None:
    stood = glances((0.0, "a", 0.1), (0.1, "b", 0.1), (0.2, "b", 0.1), (9.2, "b", 0.1))
    assert longest_freeze_s(stood) == pytest.approx(0.05 + 0.5)


def test_each_dark_moment_is_told() -> None:
    seen = glances((0.0, "a", 0.1), (0.5, "d", 0.0), (1.0, "a", 0.1))
    assert dark_moments(seen) == ["at 0.50 s, 0.45 s after the last look"]


def test_darkness_is_no_freeze() -> None:
    assert longest_freeze_s(glances((0.0, "a", 0.1), (1.0, "d", 0.0), (9.0, "d", 0.0))) == 0


def test_a_picture_that_came_back_is_no_freeze() -> None:
    assert longest_freeze_s(glances((0.0, "a", 0.1), (1.0, "b", 0.1), (2.0, "a", 0.1))) == 0


class CountingMonitor:
    """A timer of 24 bits at 3.579545 MHz that is read every two seconds."""

    def __init__(self) -> None:
        self.count = 0xFFFF00

    def human(self, line: str) -> str:
        assert line == "i /w 0x608"
        answer = f"portl[0x0608] = {self.count & 0xFFFFFF:#010x}\r\n"
        self.count += 2 * 3579545
        return answer


def test_the_guests_clock_runs_on_over_the_timers_end() -> None:
    clock = GuestClock(CountingMonitor())  # type: ignore[arg-type]
    assert [clock.now() for _ in range(4)] == pytest.approx([2.0, 4.0, 6.0, 8.0])


@pytest.fixture(scope="module")
def cart() -> Cart:
    return Cart()


def test_a_face_is_known_by_its_place_its_character_and_its_expression(cart: Cart) -> None:
    here, there = Place(), Place(1.7, right_m=0.12, up_m=-0.06, roll=12, pitch=5, yaw=20)
    mean = cart.reference(here, "mean")
    same = judge(mean, mean)
    assert (same.overlap, same.shift_px) == (1.0, 0.0)
    assert judge(mean, cart.reference(there, "mean")).shift_px > 25
    assert judge(mean, cart.reference(Place(right_m=0.01), "mean")).shift_px > 5
    surprise = cart.reference(here, "mean", "surprise")
    for other in (cart.reference(here, "noh"), surprise):
        assert likeness(mean, other) < 0.95
    assert judge(mean, np.zeros_like(mean)).overlap == 0
    assert judge(np.zeros((480, 640, 3), np.uint8), mean).overlap == 0


def test_the_leds_are_where_the_tracker_must_see_them(cart: Cart) -> None:
    frame = np.frombuffer(cart.frames(Place()), np.uint8)[: 640 * 480].reshape(480, 640)
    points, seen = cart.world(Place()).led_points(0.0)
    assert seen.all()
    for x, y in np.rint(points).astype(int):
        assert frame[y - 1 : y + 2, x - 1 : x + 2].max() > 100


def test_one_sway_begins_where_it_ends(cart: Cart) -> None:
    frames = np.frombuffer(cart.moving_frames(Place(), 15, 4.0), np.uint8).reshape(-1, 480, 640)
    places = [np.argwhere(frame > 100).mean(axis=0)[1] for frame in frames]
    steps = np.abs(np.diff([*places, places[0]]))
    assert len(frames) == 60 and np.ptp(places) > 40
    assert steps.max() < 13


def test_whoever_begins_to_sway_is_not_lost(cart: Cart) -> None:
    """Not even by a camera of an overloaded machine, whose frames come up to 120 ms apart; the loss
    and a slow return would be a dark moment that nobody but the trial has made."""
    still, sway = (
        np.frombuffer(frames, np.uint8).reshape(-1, 480, 640)
        for frames in (cart.frames(PLACE), cart.moving_frames(PLACE, PLAYER_HZ, SWAY_S))
    )
    tracker = Tracker(cart.mask.leds, camera_model(cart.machine), TrackerSettings(), MotionFilter())
    random = np.random.default_rng(1)
    time_s, lost_at_s, begin_s = 0.0, [], 3.0
    for number in range(400):
        time_s += random.uniform(0.05, 0.12) if random.random() < 0.3 else 1 / 60
        moves = time_s > begin_s
        image = (
            sway[int((time_s - begin_s) * PLAYER_HZ) % len(sway)] if moves else still[number % 4]
        )
        if not tracker.process(image, time_s, number).locked and number > 10:
            lost_at_s.append(time_s)
    assert time_s > begin_s + SWAY_S / 2
    assert not lost_at_s


def test_the_report_gathers_what_several_processes_tell(tmp_path: Path) -> None:
    show, second = Part(tmp_path, "show"), Part(tmp_path, "second")
    step = show.begin("test_boot", "Cold <boot>")
    step.outcome, step.seconds = "passed", 3.0
    show.picture(step, np.zeros((4, 4, 3), np.uint8), "dark")
    show.write()
    second.begin("test_cuts", "Cuts").outcome = "failed"
    second.write()
    assert [each.name for each in gather(tmp_path)] == ["test_cuts", "test_boot"]
    told = json.loads((tmp_path / "report.json").read_text())
    assert (told["passed"], told["failed"]) == (1, 1)
    page = (tmp_path / "index.html").read_text()
    assert "Cold &lt;boot&gt;" in page and "pictures/show-test_boot-0.png" in page
    assert (tmp_path / "pictures/show-test_boot-0.png").exists()


def test_whoever_reads_a_part_while_it_is_written_reads_all_of_the_one_before(
    tmp_path: Path,
) -> None:
    part = Part(tmp_path, "show")
    part.begin("test_boot", "Cold boot")
    part.write()
    names = ("part-show.json", "report.json", "index.html")
    readers = [(tmp_path / name).open() for name in names]
    whole = [(tmp_path / name).read_text() for name in names]
    part.begin("test_pose", "Pose")
    part.write()
    for reader, text in zip(readers, whole, strict=True):
        with reader:
            assert reader.read() == text
    assert "test_pose" in (tmp_path / "report.json").read_text()


def test_another_package_is_another_base() -> None:
    assert recipe(("a", "b")) == recipe(("b", "a")) != recipe(("a",))
    assert needed_by(()) == []


INT3 = "[    0.441870] Kernel panic - not syncing: Fatal exception in interrupt\n"
ROOT = "[    4.100000] Kernel panic - not syncing: VFS: Unable to mount root fs\n"


def test_only_a_processor_that_stumbles_is_forgiven() -> None:
    assert stumbles("") == stumbles(ROOT) == stumbles("words of a Kernel panic - \n") == 0
    assert stumbles(f"[    0.44] Oops: int3\n{INT3}[    0.1] on\n{INT3}{ROOT}") == 2


def test_a_machine_whose_processor_stumbled_is_reset_once_for_each_time(tmp_path: Path) -> None:
    class Agent:
        waits = 0

        def receive(self, timeout_s: float) -> dict[str, Any]:
            self.waits += 1
            if self.waits in (2, 5):
                with (tmp_path / "console.log").open("a") as log:
                    log.write(INT3)
            if self.waits < 8:
                raise TimeoutError
            return {"id": 0}

    class Monitor:
        asked: list[str]

        def run(self, command: str, **arguments: Any) -> None:
            self.asked.append(command)

    cart = VirtualCart.__new__(VirtualCart)
    monitor = Monitor()
    monitor.asked = []
    cart.machine = Machine(None, tmp_path, tmp_path)  # type: ignore[arg-type]
    cart.stumbles, cart._agent, cart._monitor = 0, Agent(), monitor  # type: ignore[assignment]
    cart.wait_booted(3600)
    assert monitor.asked == ["system_reset"] * 2 and cart.stumbles == 2
