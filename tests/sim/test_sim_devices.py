"""What the simulated devices promise beyond their interfaces."""

from typing import Any

import numpy as np
import pytest

from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.errors import HypermaskError
from hypermask_sim.devices.camera import SimCamera
from hypermask_sim.devices.keypad import SimKeypad
from hypermask_sim.devices.lamp import SimLamp
from hypermask_sim.devices.pantilt import Move, plan
from hypermask_sim.devices.power import SimPower
from hypermask_sim.devices.projector import SimProjector
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World


def world_of(*changes: str, origin_s: float = 0.0) -> World:
    return World(Scenario().with_changes(list(changes)), origin_s)


def camera_of(world: World, start_s: float = 0.0) -> tuple[SimCamera, VirtualClock]:
    clock = VirtualClock(start_s)
    camera = SimCamera(world, clock)
    camera.open()
    return camera, clock


def read_next(camera: SimCamera, clock: VirtualClock) -> Any:
    clock.sleep_until(camera.next_arrival_s())
    return camera.read(0.0)


class Steps:
    """A clock that is not virtual but never really sleeps; it wakes late, as real ones do."""

    def __init__(self, late_s: float) -> None:
        self.time_s = 100.0
        self.late_s = late_s

    def now(self) -> float:
        return self.time_s

    def sleep_until(self, time_s: float) -> None:
        self.time_s = max(self.time_s, time_s + self.late_s)


def test_frames_arrive_when_the_scenario_says() -> None:
    camera, clock = camera_of(world_of("camera.phase_ms=2"))
    for sequence in range(3):
        middle = 0.002 + sequence / 120
        clock.sleep_until(middle + 0.0093 - 1e-6)
        assert camera.read(0.0) is None
        clock.sleep_until(middle + 0.0093)
        frame = camera.read(0.0)
        assert frame is not None and frame.sequence == sequence
        assert frame.time_s == pytest.approx(middle)


def test_a_read_with_a_timeout_waits_on_a_real_clock_only() -> None:
    camera, clock = camera_of(world_of())
    assert camera.read(1.0) is None and clock.now() == 0.0
    steps = Steps(late_s=1e-4)
    camera = SimCamera(world_of(origin_s=100.0), steps)
    camera.open()
    frame = camera.read(1.0)
    assert frame is not None and frame.time_s == pytest.approx(100.0)
    assert steps.now() == pytest.approx(100.0094)
    assert camera.read(1e-3) is None
    assert steps.now() == pytest.approx(100.0105)


def test_the_picture_shows_where_the_mask_was() -> None:
    world = world_of("performer.motion=sway", "performer.speed=3")
    camera, clock = camera_of(world)
    for _ in range(20):
        frame = read_next(camera, clock)
    then, _ = world.led_points(frame.time_s)
    now, _ = world.led_points(clock.now())
    x, y = then[0]
    bright = np.argwhere(frame.image[: round(y) + 10, : round(x) + 30] > 100).mean(axis=0)[::-1]
    assert np.hypot(*(bright - then[0])) < 0.5 < np.hypot(*(bright - now[0]))


def test_two_runs_show_the_same_pictures() -> None:
    changes = ("performer.motion=dance", "camera.rate_error_ppm=80")
    runs = [camera_of(world_of(*changes)) for _ in range(2)]
    for camera, clock in runs:
        camera.shift_phase(0.002)
        del clock
    for _ in range(40):
        one, other = (read_next(camera, clock) for camera, clock in runs)
        assert (one.time_s, one.sequence) == (other.time_s, other.sequence)
        assert np.array_equal(one.image, other.image)


def test_a_camera_opened_late_starts_with_a_frame_of_its_time() -> None:
    camera, clock = camera_of(world_of(), start_s=3.0)
    frame = read_next(camera, clock)
    assert frame.sequence == 360 and frame.time_s == pytest.approx(3.0)


def test_a_cameras_clock_may_be_off() -> None:
    camera, clock = camera_of(world_of("camera.rate_error_ppm=1000"))
    for _ in range(101):
        frame = read_next(camera, clock)
    assert frame.time_s == pytest.approx(100 / (120 * 1.001))
    assert camera.mode.rate_hz == 120


def test_a_phase_shift_drifts_by_no_more_than_two_percent_a_frame() -> None:
    camera, clock = camera_of(world_of())
    read_next(camera, clock)
    applied = camera.shift_phase(-0.004)
    times = [read_next(camera, clock).time_s for _ in range(60)]
    steps = np.diff(times) * 120
    assert applied == -0.004
    assert steps.min() == pytest.approx(0.98) and steps.max() == pytest.approx(1.0)
    assert (times[-1] - 60 / 120) == pytest.approx(-0.004)


def test_a_phase_shift_is_at_most_half_a_period() -> None:
    camera, _ = camera_of(world_of())
    assert camera.shift_phase(1.0) == pytest.approx(0.5 / 120)


def test_an_operator_can_press_keys() -> None:
    clock = VirtualClock(50.0)
    keypad = SimKeypad(world_of("performer.keys=[[9.0, 'plus']]", origin_s=50.0), clock)
    keypad.open()
    keypad.press("4")
    keypad.press("enter", 51.0)
    event = keypad.read(0.0)
    assert event is not None and (event.key, event.pressed, event.time_s) == ("4", True, 50.0)
    clock.sleep_until(60.0)
    keys = []
    while (event := keypad.read(0.0)) is not None:
        keys.append((event.key, event.pressed))
    assert keys[1:] == [("enter", True), ("enter", False), ("plus", True), ("plus", False)]
    with pytest.raises(HypermaskError, match="KEY-NAME"):
        keypad.press("F1")


def test_listeners_get_the_picture_top_row_first_with_its_times() -> None:
    clock = VirtualClock()
    world = world_of("projector.width=64", "projector.height=32")
    projector = SimProjector(world, clock)
    projector.open()
    shown: list[tuple[Any, float, float]] = []
    projector.add_listener(lambda *frame: shown.append(frame))
    with projector.context:
        projector.framebuffer.clear(1.0, 0.0, 0.0)
        projector.framebuffer.clear(0.0, 0.0, 1.0, viewport=(0, 0, 64, 8))  # GL's lowest rows
    flip_s = projector.present()
    picture, told_flip, light = shown[0]
    assert picture.shape == (32, 64, 3)
    assert picture[0, 0].tolist() == [255, 0, 0] and picture[-1, 0].tolist() == [0, 0, 255]
    assert told_flip == flip_s and light == world.light_time(flip_s)
    assert clock.now() == 0.0


def test_a_late_present_takes_the_next_flip_and_is_counted() -> None:
    clock = VirtualClock()
    projector = SimProjector(world_of("projector.width=64", "projector.height=32"), clock)
    projector.open()
    flips = []
    for now in (0.010, 0.027, 0.055, 0.062):
        clock.sleep_until(now)
        flips.append(round(projector.present() * 60))
    assert flips == [1, 2, 4, 5]
    assert projector.missed_flips == 1


def test_in_real_time_present_waits_and_reads_back_now_and_then() -> None:
    steps = Steps(late_s=1e-4)
    world = world_of(
        "projector.width=64", "projector.height=32", "projector.readback_every=4", origin_s=100.0
    )
    projector = SimProjector(world, steps)
    projector.open()
    shown: list[float] = []
    projector.add_listener(lambda picture, flip_s, light_s: shown.append(flip_s))
    flips = [projector.present() for _ in range(9)]
    assert np.diff(flips) == pytest.approx(1 / 60)
    assert steps.now() == pytest.approx(flips[-1] + 1e-4)
    assert shown == [flips[0], flips[4], flips[8]]
    assert projector.missed_flips == 0


@pytest.mark.parametrize("distance", [2.0, 0.05, -1.3, 0.0])
@pytest.mark.parametrize("speed", [0.0, 0.7, -0.7, 1.6])
def test_a_move_ends_at_rest_on_its_target_within_the_limits(distance: float, speed: float) -> None:
    top, acceleration = 1.0, 3.0
    move = Move(5.0, 0.2, speed, plan(distance, speed, top, acceleration))
    position, rest = move.at(move.end_s)
    assert position == pytest.approx(0.2 + distance) and rest == pytest.approx(0, abs=1e-9)
    times = np.linspace(5.0, move.end_s + 0.1, 2000)
    speeds = np.array([move.at(t)[1] for t in times])
    assert np.abs(np.diff(speeds) / np.diff(times)).max() <= acceleration + 1e-6
    assert np.abs(speeds).max() <= max(top, abs(speed)) + 1e-9


def test_the_battery_runs_down() -> None:
    clock = VirtualClock()
    power = SimPower(world_of("power.capacity_ah=10", "power.current_a=5"), clock)
    power.open()
    full = power.read()
    clock.sleep_until(3600.0)
    half = power.read()
    clock.sleep_until(3 * 3600.0)
    empty = power.read()
    assert full.charge == 1.0 and empty.charge == 0.0
    assert half.charge == pytest.approx(0.5)
    assert full.voltage_v > half.voltage_v > empty.voltage_v
    assert empty.current_a == 0


def test_the_lamp_warms_up_and_cools_down() -> None:
    clock = VirtualClock()
    lamp = SimLamp(world_of(), clock)
    lamp.open()
    cold = lamp.read().temperature_c
    lamp.set_power(True)
    clock.sleep_until(600.0)
    hot = lamp.read().temperature_c
    lamp.set_power(False)
    clock.sleep_until(1200.0)
    cooled = lamp.read().temperature_c
    assert cold is not None and hot is not None and cooled is not None
    assert hot > cold + 30 and cooled == pytest.approx(cold, abs=1)
