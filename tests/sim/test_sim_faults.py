"""Faults come and go by the scenario's time."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hypermask_drivers.camera import Frame
from hypermask_drivers.clock import VirtualClock
from hypermask_sim.devices.camera import SimCamera
from hypermask_sim.devices.keypad import SimKeypad
from hypermask_sim.faults import chance
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World


def world_with(*faults: dict[str, Any], **performer: Any) -> World:
    return World(Scenario.model_validate({"faults": list(faults), "performer": performer}))


def frames_of(
    world: World, until_s: float, look: Callable[[NDArray[np.uint8]], float] = lambda _: 0.0
) -> list[tuple[float, Frame, float]]:
    """Arrival times, frames and what `look` saw in them, read as soon as they are there."""
    clock = VirtualClock()
    camera = SimCamera(world, clock)
    camera.open()
    found = []
    while camera.next_arrival_s() < until_s:
        clock.sleep_until(camera.next_arrival_s())
        frame = camera.read(0.0)
        if frame is not None:
            found.append((clock.now(), frame, look(frame.image)))
    return found


def test_named_leds_are_hidden_for_the_time_given() -> None:
    fault = {"kind": "leds_hidden", "from_s": 1.0, "to_s": 2.0, "leds": ["label", "upper_left"]}
    world = world_with(fault)
    assert world.led_points(0.99)[1].all()
    assert world.led_points(1.0)[1].tolist() == [False, True, True, True, False]
    assert world.led_points(2.0)[1].all()


def test_all_leds_hidden_leaves_a_dark_picture() -> None:
    world = world_with({"kind": "leds_hidden", "from_s": 0.1})
    assert world.spots(0.2, 1e-3) is None
    brightest = [level for _, _, level in frames_of(world, 0.3, lambda image: image.max())]
    assert brightest[0] > 100 and brightest[-1] < 30


def test_extra_blobs_are_as_many_as_asked_bright_and_moving() -> None:
    world = world_with({"kind": "extra_blobs", "from_s": 1.0, "count": 10, "peak": 200})
    before, now, later = (world.spots(t, 1e-3) for t in (0.5, 1.5, 1.6))
    assert before is not None and now is not None and later is not None
    assert len(now.points) == len(before.points) + 10
    moved = np.linalg.norm(now.points[-10:, 1] - later.points[-10:, 1], axis=1)
    assert np.median(moved) > 5
    assert now.peaks[-10:].min() >= 100
    assert np.all((now.points[-10:] > 0) & (now.points[-10:] < [1280, 800]))


def test_a_flash_lasts_as_long_as_it_says() -> None:
    world = world_with({"kind": "flash", "from_s": 0.1, "to_s": 0.15})
    frames = frames_of(world, 0.3, lambda image: image.mean())
    bright = [frame.time_s for _, frame, level in frames if level > 200]
    assert min(bright) >= 0.1 and max(bright) < 0.15 and len(bright) == 6


def test_dropped_frames_leave_gaps_in_the_sequence() -> None:
    world = world_with({"kind": "frames_dropped", "frames": [5, 6, 9]})
    sequences = [f.sequence for _, f, _ in frames_of(world, 0.2)]
    assert [s for s in range(12) if s not in sequences] == [5, 6, 9]


def test_a_share_of_the_frames_is_dropped_always_the_same_ones() -> None:
    fault = {"kind": "frames_dropped", "fraction": 0.3, "from_s": 1.0, "to_s": 3.0}
    runs = [[f.sequence for _, f, _ in frames_of(world_with(fault), 4.0)] for _ in range(2)]
    assert runs[0] == runs[1]
    missing = set(range(470)) - set(runs[0])
    assert len(missing) == pytest.approx(0.3 * 240, rel=0.25)
    assert min(missing) >= 120 and max(missing) < 360


def test_late_frames_arrive_later_and_never_overtake() -> None:
    world = world_with({"kind": "frames_late", "frames": [4], "delay_ms": 20.0})
    frames = frames_of(world, 0.2)
    lag = {f.sequence: arrival - f.time_s for arrival, f, _ in frames}
    assert lag[3] == pytest.approx(9.3e-3) and lag[4] == pytest.approx(29.3e-3)
    assert lag[5] == pytest.approx(29.3e-3 - 1 / 120) and lag[8] == pytest.approx(9.3e-3)
    assert [f.sequence for _, f, _ in frames] == list(range(len(frames)))


def test_a_key_pressed_while_the_keypad_is_unplugged_is_lost() -> None:
    fault = {"kind": "keypad_unplugged", "from_s": 1.0, "to_s": 2.0}
    world = world_with(fault, keys=[[0.5, "1"], [1.5, "2"], [2.5, "3"]])
    clock = VirtualClock(2.2)
    keypad = SimKeypad(world, clock)
    keypad.open()
    clock.sleep_until(3.0)
    event = keypad.read(0.0)
    assert event is not None and event.key == "3"


def test_chance_is_even_and_has_no_memory() -> None:
    numbers = [chance(1, index) for index in range(4000)]
    assert numbers == [chance(1, index) for index in range(4000)]
    assert np.histogram(numbers, 10, (0, 1))[0] == pytest.approx(400, rel=0.2)
    assert abs(np.corrcoef(numbers[:-1], numbers[1:])[0, 1]) < 0.05
