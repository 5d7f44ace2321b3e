"""Each device shows what it is and whether it works; one that does not is told with a remedy."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hypermask.errors import HypermaskError
from hypermask.machine.settings import MachineSettings
from hypermask.technician import devices
from hypermask.technician.trials import MOVE_RAD, facts, trial
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.device import Device, DeviceState
from hypermask_drivers.lamp.dlpc34xx import Dlpc34xxLamp, Dlpc34xxSettings
from hypermask_drivers.pantilt.ptu import DirectedPerceptionPtu, PtuSettings
from hypermask_drivers.power.ina2xx import Ina2xxSettings, Ina226
from hypermask_drivers.registry import driver_class
from hypermask_sim.emulators.i2c import Wires
from hypermask_sim.emulators.i2c_lamp import Dlpc34xxChip
from hypermask_sim.emulators.i2c_power import Ina226Chip
from hypermask_sim.emulators.ptu import PtuData, PtuUnit
from hypermask_sim.emulators.ptu_line import PtuLine
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World

BUS = "/dev/i2c-1"


def simulated(kind: str, **scenario: object) -> tuple[Device, VirtualClock]:
    clock = VirtualClock(100.0)
    settings = {"performer": {"voice": "speech", "motion": "sway"}} | scenario
    world = World(Scenario.model_validate(settings), 100.0)
    device = driver_class(kind, "sim")(world, clock)  # type: ignore[call-arg]
    device.open()
    return device, clock


def tried(device: Device, clock: VirtualClock) -> list[str]:
    said: list[str] = []
    trial(device, clock, said.append)
    return said


def refusal(device: Device, clock: VirtualClock) -> HypermaskError:
    with pytest.raises(HypermaskError) as caught:
        trial(device, clock, lambda row: None)
    assert caught.value.code == "DEV-TEST" and caught.value.remedy
    return caught.value


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("camera", "1280 x 800 pixels, 120.00 pictures a second"),
        ("projector", "1280 x 720 pixels at 60.00 Hz"),
        ("keypad", "it answers"),
        ("sound", "16000 samples a second"),
        ("pantilt", "limits: pan -159 to 159"),
        ("lamp", "off, light 100%"),
        ("power", "5.50 A"),
    ],
)
def test_every_device_says_what_it_is(kind: str, words: str) -> None:
    device, _ = simulated(kind)
    assert any(words in row for row in facts(device)), facts(device)
    device.close()


def test_the_camera_is_counted() -> None:
    said = tried(*simulated("camera"))
    assert said[0].startswith("239 pictures, 120.0 a second, 0 dropped")


def test_a_camera_that_gives_nothing_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    device, clock = simulated("camera")
    monkeypatch.setattr(device, "read", lambda timeout_s: None)
    assert "gave 0 pictures" in refusal(device, clock).what


def test_a_camera_that_is_slower_than_it_says_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    device, clock = simulated("camera")
    read = device.read  # type: ignore[attr-defined]

    def slow(timeout_s: float) -> object:
        frame = read(timeout_s)
        return frame and replace(frame, time_s=100 + (frame.time_s - 100) * 2)

    monkeypatch.setattr(device, "read", slow)
    assert "60.0 of 120.0" in refusal(device, clock).what


def test_the_projector_shows_its_colours_and_ends_black() -> None:
    device, clock = simulated("projector")
    shown: list[tuple[int, ...]] = []
    device.add_listener(  # type: ignore[attr-defined]
        lambda picture, flip_s, light_s: shown.append(tuple(int(v) for v in picture[5, 5]))
    )
    tried(device, clock)
    device.close()
    colours = [colour for colour, _ in itertools.groupby(shown)]
    assert colours == [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255), (0, 0, 0)]


def test_keys_are_named_until_enter() -> None:
    device, clock = simulated("keypad")
    for number, key in enumerate(("5", "star", "enter", "7")):
        device.press(key, 100.5 + number)  # type: ignore[attr-defined]
    assert tried(device, clock)[1:] == ["  5", "  star", "  enter"]


def test_a_keypad_that_nobody_presses_is_told() -> None:
    assert "no key" in refusal(*simulated("keypad")).what


def test_the_microphone_is_measured() -> None:
    said = tried(*simulated("sound"))
    assert "level -" in said[1] and "samples" in said[1]


def test_digital_silence_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    device, clock = simulated("sound")
    read = device.read  # type: ignore[attr-defined]

    def mute(timeout_s: float) -> object:
        block = read(timeout_s)
        return block and replace(block, samples=np.zeros_like(block.samples))

    monkeypatch.setattr(device, "read", mute)
    assert "digital silence" in refusal(device, clock).what


class Bench:
    """The real drivers over their emulators, which move on with the clock."""

    def __init__(self, folder: Path) -> None:
        self.clock = Moving(100.0)
        self.unit = PtuUnit(PtuData(baud=None, homing_s=2.0))
        self.line = PtuLine(self.unit, self.clock, folder / "ptu")
        self.line.plug()
        self.clock.moved = [self.line.catch_up, self.line.settle]
        self.ptu = DirectedPerceptionPtu(
            PtuSettings(device=str(folder / "ptu"), silence_s=0.15), self.clock, self.line.connect
        )


class Moving(VirtualClock):
    moved: list[Callable[[], object]]

    def sleep_until(self, time_s: float) -> None:
        before, after = getattr(self, "moved", [lambda: None] * 2)
        before()
        super().sleep_until(time_s)
        after()


def test_the_pan_tilt_unit_finds_its_zero_and_looks_to_both_sides(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.ptu.open()
    said = tried(bench.ptu, bench.clock)
    assert "finds its zero" in said[0]
    degrees = f"{np.degrees(MOVE_RAD):.1f}"
    assert [row.split(",")[0] for row in said[1:]] == [
        f"pan {degrees}", f"pan -{degrees}", said[3].split(",")[0],
    ]  # fmt: skip
    assert bench.ptu.read().homed and abs(bench.ptu.read().pan_rad) < 0.01
    bench.ptu.close()
    bench.line.close()


def test_a_head_that_something_blocks_is_halted_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    device, clock = simulated("pantilt")
    monkeypatch.setattr(device, "move", lambda *target: None)
    halted: list[bool] = []
    monkeypatch.setattr(device, "halt", lambda: halted.append(True))
    assert "did not come" in refusal(device, clock).what
    assert halted


def test_the_lamp_is_dimmed_and_left_as_it_was() -> None:
    clock = VirtualClock(100.0)
    chip = Dlpc34xxChip()
    lamp = Dlpc34xxLamp(Dlpc34xxSettings(device=BUS), clock, Wires({0x1B: chip}, BUS).connect)
    lamp.open()
    before = lamp.read()
    assert tried(lamp, clock) == ["light 30% (told 30%)", "light 100% (told 100%)"]
    assert lamp.read() == before


@pytest.mark.parametrize(("volts", "fine"), [(12.6, True), (0.0, False)])
def test_the_battery_is_measured(volts: float, fine: bool) -> None:
    clock = VirtualClock(100.0)
    chip = Ina226Chip(lambda: (volts, 1.5), 0.01)
    settings = Ina2xxSettings(device=BUS, shunt_ohm=0.01, most_a=8.0)
    power = Ina226(settings, clock, Wires({0x40: chip}, BUS).connect)
    power.open()
    if fine:
        assert tried(power, clock)[0] == "12.60 V, 1.50 A"
    else:
        assert "no voltage" in refusal(power, clock).what


# --- the machine's list ---------------------------------------------------------------------------


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MachineSettings:
    for name in ("HOME", "RUN", "ETC"):
        monkeypatch.setenv(f"HYPERMASK_{name}", str(tmp_path / name.lower()))
    (tmp_path / "cam").write_text("")
    return MachineSettings.model_validate(
        {
            "version": 1,
            "name": "x",
            "scenario": "services",
            "camera": {"driver": "v4l2", "device": str(tmp_path / "cam")},
            "pantilt": {"driver": "ptu", "device": str(tmp_path / "none")},
            "keypad": {"driver": "usb"},
            "power": {"driver": "sim"},
        }
    )


def test_the_list_says_where_each_is_looked_for_and_whether_it_is_there(
    machine: MachineSettings,
) -> None:
    found = {entry.kind: entry for entry in devices.entries(machine)}
    assert found["camera"].present is True and found["pantilt"].present is False
    assert found["keypad"].place == "found by itself" and found["keypad"].present is None
    assert found["lamp"].state == "none" and found["power"].state == "free"


def test_a_device_is_opened_and_closed_again(machine: MachineSettings) -> None:
    with devices.opened("power", machine) as device:
        assert device.state is DeviceState.READY
    assert device.state is DeviceState.ABSENT


def test_a_device_that_a_worker_holds_is_not_taken_away_from_it(
    machine: MachineSettings, tmp_path: Path
) -> None:
    from hypermask.workers.board import Board
    from hypermask.workers.health import Health
    from hypermask_drivers.clock import RealClock

    board = Board.shared(tmp_path / "run" / "board")
    health = Health(board.folder, "tracker", RealClock())
    health.device(True)
    health.say("working")
    health.publish(now=True)
    with (
        pytest.raises(HypermaskError, match=r"DEV-HELD.*'tracker'"),
        devices.opened("camera", machine),
    ):
        pass
    found = {entry.kind: entry for entry in devices.entries(machine)}
    assert (found["camera"].state, found["camera"].holder) == ("ready", "tracker")
    health.say("stopped")
    health.publish(now=True)
    assert devices.entries(machine)[0].state == "free"


def test_what_the_machine_does_not_have_is_said(machine: MachineSettings) -> None:
    with pytest.raises(HypermaskError, match="DEV-NONE"), devices.opened("lamp", machine):
        pass
    with pytest.raises(HypermaskError, match="DEV-KIND"):
        devices.check_kind("oven")
