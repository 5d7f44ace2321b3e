"""Lamp, battery, heat and hung USB devices beside the keys: one message each, nothing held up."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hypermask.blackboard import Record
from hypermask.errors import DeviceError, HypermaskError
from hypermask.show.engine import ShowEngine
from hypermask.show.showfile import Cue, ShowFile
from hypermask.workers.background import OneThread, OnTheSpot
from hypermask.workers.board import Board
from hypermask.workers.devices import TEST_LIGHT, TEST_S, USB_AGAIN_S, SideDevices, UsbCare
from hypermask.workers.thermal import Heat, read_heat, words_of
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.lamp.dlpc34xx import Dlpc34xxLamp, Dlpc34xxSettings
from hypermask_drivers.power.battery import BatterySettings
from hypermask_drivers.power.ina2xx import Ina2xxSettings, Ina226
from hypermask_sim.emulators.i2c import Wires
from hypermask_sim.emulators.i2c_lamp import Dlpc34xxChip
from hypermask_sim.emulators.i2c_power import Ina226Chip

BUS = "/dev/i2c-1"


class Cart:
    """A show's scene, and its slow devices on an emulated bus."""

    def __init__(
        self, lamp: bool = True, power: bool = True, usb: UsbCare | None = None, **others: Any
    ) -> None:
        self.clock = VirtualClock(500.0)
        self.board = Board.local()
        self.told: list[tuple[str, str]] = []
        self.volts, self.amps = 12.7, 2.0
        self.light = Dlpc34xxChip()
        self.monitor = Ina226Chip(lambda: (self.volts, self.amps), 0.01)
        self.wires = Wires({0x1B: self.light, 0x40: self.monitor}, BUS)
        self.engine = ShowEngine(ShowFile(version=1, name="x", characters=("mean",)), 500.0)
        self.board.scene.publish(self.engine.scene)
        settings = Ina2xxSettings(
            device=BUS, shunt_ohm=0.01, most_a=8.0, battery=BatterySettings(cells=6)
        )
        connect = self.wires.connect
        self.devices = SideDevices(
            self.board,
            self.clock,
            lambda time_s, code, text: self.told.append((code, text)),
            lamp=Dlpc34xxLamp(Dlpc34xxSettings(device=BUS), self.clock, connect) if lamp else None,
            power=Ina226(settings, self.clock, connect) if power else None,
            usb_care=usb,
            background=others.pop("background", OnTheSpot()),
            **others,
        )

    def run(self, seconds: float) -> None:
        end_s = self.clock.now() + seconds
        while self.clock.now() < end_s - 1e-9:
            self.clock.sleep_until(self.clock.now() + 0.02)
            self.devices.step(self.clock.now())

    def blackout(self, to: str) -> None:
        self.engine.perform(Cue.model_validate({"blackout": to}), self.clock.now())
        self.board.scene.publish(self.engine.scene)

    @property
    def lit(self) -> bool:
        """What the light controller really does."""
        return self.light.parameters[0x53][0] & 0b111 != 0

    @property
    def machine(self) -> Record:
        record = self.board.machine.latest()
        assert record is not None
        return record

    @property
    def codes(self) -> list[str]:
        return [code for code, _ in self.told]


def test_the_lamp_goes_out_after_a_blackouts_fade_and_comes_before_the_light() -> None:
    cart = Cart()
    cart.run(1.0)
    assert cart.lit
    cart.blackout("on")
    cart.run(0.2)
    assert cart.lit, "the fade is still seen"
    cart.run(0.2)
    assert not cart.lit
    cart.blackout("off")
    cart.run(0.04)
    assert cart.lit
    assert cart.codes == []


def test_a_lamp_that_was_without_power_is_told_again() -> None:
    cart = Cart()
    cart.blackout("on")
    cart.run(2.0)
    assert not cart.lit
    cart.wires.present = False
    cart.run(5.0)
    assert bytes(cart.machine["lamp"].item()) == b"lost"
    cart.light.power_cycle()
    cart.wires.present = True
    cart.run(5.0)
    assert not cart.lit, "it came up lit in a blackout"
    assert bytes(cart.machine["lamp"].item()) == b"ready"


def test_one_bus_pulled_out_is_one_message_for_each_device_and_one_for_its_return() -> None:
    cart = Cart()
    cart.run(3.0)
    cart.wires.present = False
    cart.run(60.0)
    assert sorted(cart.codes) == ["LMP-LOST", "PWR-LOST"]
    cart.light.power_cycle()
    cart.monitor.power_cycle()
    cart.wires.present = True
    cart.run(10.0)
    assert sorted(cart.codes[2:]) == ["LAMP-BACK", "POWER-BACK"]
    assert bytes(cart.machine["power"].item()) == b"ready"


def test_a_battery_monitor_that_loses_its_power_for_a_moment_is_set_up_again() -> None:
    cart = Cart(lamp=False)
    cart.run(3.0)
    assert float(cart.machine["amps"]) == pytest.approx(2.0, abs=0.01)
    cart.monitor.power_cycle()
    cart.run(10.0)
    assert cart.codes == ["PWR-LOST", "POWER-BACK"]
    assert float(cart.machine["amps"]) == pytest.approx(2.0, abs=0.01)


def test_a_monitor_that_never_was_there_is_told_once() -> None:
    cart = Cart(lamp=False)
    cart.wires.present = False
    cart.run(120.0)
    assert cart.codes == ["PWR-ABSENT"]
    assert bytes(cart.machine["power"].item()) == b"lost"
    assert math.isnan(cart.machine["volts"])


def test_the_battery_is_told_of_when_it_is_low_and_critical_once_each() -> None:
    cart = Cart(lamp=False)
    cart.run(5.0)
    assert bytes(cart.machine["level"].item()) == b"good" and cart.codes == []
    cart.volts = 11.6
    cart.run(120.0)
    cart.volts = 10.6
    cart.run(120.0)
    assert cart.codes == ["PWR-LOW", "PWR-CRITICAL"]
    assert "Change it now." in cart.told[1][1] and "10.6 V" in cart.told[1][1]
    cart.volts = 12.9
    cart.run(300.0)
    assert cart.codes[-1] == "PWR-GOOD" and len(cart.codes) <= 4


def test_the_projectors_faults_are_told_once_and_their_end() -> None:
    cart = Cart(power=False)
    cart.run(3.0)
    cart.light.system_status = [0, 0b001000, 0, 0]
    cart.run(60.0)
    assert cart.codes == ["LMP-FAULT"]
    assert "red LED fails" in cart.told[0][1]
    assert b"red LED" in bytes(cart.machine["lamp_faults"].item())
    cart.light.system_status = [0, 0, 0, 0]
    cart.run(5.0)
    assert cart.codes == ["LMP-FAULT", "LMP-FINE"]


def test_a_lamp_that_refuses_its_currents_is_told_once_and_not_asked_at_every_step() -> None:
    cart = Cart(power=False)
    cart.light.most_current = 100
    cart.run(1.0)
    transfers = cart.wires.transfers
    cart.run(10.0)
    assert cart.codes == ["LMP-REFUSED"]
    assert cart.wires.transfers - transfers < 400


def test_the_lamp_is_dimmed_for_a_test_and_lit_again() -> None:
    cart = Cart(power=False)
    cart.run(3.0)
    assert "dimmed" in cart.devices.test("lamp")["text"]
    cart.run(0.5)
    full = 560
    assert cart.light.parameters[0x55][0] | cart.light.parameters[0x55][1] << 8 == round(
        full * TEST_LIGHT
    )
    cart.run(TEST_S)
    assert cart.light.parameters[0x55][0] | cart.light.parameters[0x55][1] << 8 == full


@pytest.mark.parametrize(
    ("kind", "code"), [("camera", "DEV-HELD"), ("oven", "DEV-KIND"), ("lamp", "DEV-NONE")]
)
def test_what_the_show_does_not_have_is_said(kind: str, code: str) -> None:
    cart = Cart(lamp=False)
    with pytest.raises(HypermaskError) as caught:
        cart.devices.probe(kind)
    assert caught.value.code == code


def test_a_bus_that_hangs_does_not_hold_up_the_keys() -> None:
    """Its thread waits for ever; the worker's steps go on, and say it once."""
    free = threading.Event()
    cart = Cart(background=OneThread(), power=False)

    def hangs(device: str) -> None:
        free.wait()
        raise OSError("freed")

    cart.devices._lamp.device._connect = hangs  # type: ignore[union-attr,attr-defined]
    cart.run(60.0)
    assert cart.codes == ["DEV-STUCK"]
    assert float(cart.machine["time_s"]) > cart.clock.now() - 1.1
    free.set()


def test_a_driver_with_a_fault_is_told_once_and_the_others_go_on() -> None:
    cart = Cart()
    cart.run(3.0)
    cart.light.read_block = lambda register, length: []  # type: ignore[method-assign]
    cart.run(60.0)
    assert cart.codes == ["DEV-FAULT"]
    cart.volts = 11.0
    cart.run(60.0)
    assert "PWR-LOW" in cart.codes or "PWR-CRITICAL" in cart.codes


def test_at_most_one_thing_is_under_way_at_a_time() -> None:
    class Slow:
        busy = False
        started = 0

        def start(self, action: Callable[[], None]) -> None:
            assert not self.busy
            self.busy, self.started = True, self.started + 1

    slow = Slow()
    cart = Cart(background=slow)
    cart.run(5.0)
    assert slow.started == 1


# --- heat -----------------------------------------------------------------------------------------


def test_heat_and_throttling_are_told_once_with_some_hysteresis() -> None:
    now = [Heat(60.0, 0, True)]
    cart = Cart(lamp=False, power=False, heat=lambda: now[0])
    cart.run(10.0)
    for celsius, flags in ((82.0, 0), (79.0, 0), (82.0, 0b0110), (60.0, 0x60000)):
        now[0] = Heat(celsius, flags, True)
        cart.run(20.0)
    assert cart.codes == ["TMP-HOT", "TMP-THROTTLED", "TMP-FINE", "TMP-UNTHROTTLED"]
    assert float(cart.machine["temperature_c"]) == 60.0


def test_a_weak_supply_is_told() -> None:
    cart = Cart(lamp=False, power=False, heat=lambda: Heat(50.0, 0x10001, True))
    cart.run(10.0)
    assert cart.codes == ["PWR-UNDERVOLTAGE"]


def board_files(root: Path, files: Mapping[str, str]) -> Path:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def test_the_processors_temperature_comes_before_others(tmp_path: Path) -> None:
    board_files(
        tmp_path,
        {
            "class/thermal/thermal_zone0/type": "cpu-thermal\n",
            "class/thermal/thermal_zone0/temp": "61234\n",
            "class/thermal/thermal_zone1/type": "battery\n",
            "class/thermal/thermal_zone1/temp": "70000\n",
            "devices/platform/soc/soc:firmware/get_throttled": "50005\n",
        },
    )
    heat = read_heat(tmp_path)
    assert heat.temperature_c == pytest.approx(61.234) and heat.known and heat.flags == 0x50005
    assert words_of(heat.flags) == "supply voltage too low, slowed down"


def test_elsewhere_a_cooling_device_says_that_the_clock_is_held_down(tmp_path: Path) -> None:
    files = {
        "class/thermal/cooling_device0/type": "Processor",
        "class/thermal/cooling_device0/cur_state": "3",
        "class/thermal/cooling_device1/type": "Fan",
        "class/thermal/cooling_device1/cur_state": "9",
    }
    assert words_of(read_heat(board_files(tmp_path, files)).flags) == "slowed down"
    board_files(tmp_path, {"class/thermal/cooling_device0/cur_state": "0"})
    assert words_of(read_heat(tmp_path).flags) == "not slowed down"


def test_a_machine_that_says_nothing_is_unknown(tmp_path: Path) -> None:
    board_files(tmp_path, {"class/thermal/thermal_zone0/temp": "rubbish"})
    heat = read_heat(tmp_path)
    assert math.isnan(heat.temperature_c) and not heat.known


# --- USB ------------------------------------------------------------------------------------------


class Port:
    """faults: what workers report; restarted: nodes that were made to start anew."""

    def __init__(self, error: HypermaskError | None = None) -> None:
        self.faults: dict[str, str] = {}
        self.restarted: list[str] = []
        self.error = error

    def restart(self, node: str) -> str:
        self.restarted.append(node)
        if self.error is not None:
            raise self.error
        return "1-1.2"

    def care(self) -> UsbCare:
        return UsbCare(
            lambda: self.faults, {"camera": "/dev/cam", "pantilt": "/dev/ptu"}, self.restart
        )


def test_a_hung_camera_is_made_to_start_anew_once_a_minute() -> None:
    port = Port()
    cart = Cart(lamp=False, power=False, usb=port.care())
    cart.run(5.0)
    assert port.restarted == []
    port.faults = {"tracker": "CAM-HUNG", "show": "KEY-LOST"}
    cart.run(USB_AGAIN_S - 5)
    assert port.restarted == ["/dev/cam"]
    assert cart.codes == ["USB-RESET"] and "1-1.2" in cart.told[0][1]
    cart.run(10.0)
    assert port.restarted == ["/dev/cam"] * 2
    assert int(cart.machine["usb_resets"]) == 2


@pytest.mark.parametrize("code", ["CAM-ABSENT", "CAM-LOST", "CAM-RATE", ""])
def test_a_camera_that_is_merely_not_there_is_left_alone(code: str) -> None:
    port = Port()
    port.faults = {"tracker": code}
    cart = Cart(lamp=False, power=False, usb=port.care())
    cart.run(30.0)
    assert port.restarted == [] and cart.codes == []


def test_a_silent_unit_has_a_minute_of_its_own() -> None:
    port = Port()
    port.faults = {"tracker": "CAM-HUNG", "pantilt": "PTU-SILENT"}
    cart = Cart(lamp=False, power=False, usb=port.care())
    cart.run(30.0)
    assert sorted(port.restarted) == ["/dev/cam", "/dev/ptu"]


def test_a_device_that_cannot_be_restarted_is_told_once() -> None:
    port = Port(DeviceError("USB-NONE", "/dev/cam is no USB device", "Check the name."))
    port.faults = {"tracker": "CAM-HUNG"}
    cart = Cart(lamp=False, power=False, usb=port.care())
    cart.run(300.0)
    assert cart.codes == ["USB-NONE"] and len(port.restarted) == 5


def test_what_workers_report_is_read_from_their_health(tmp_path: Path) -> None:
    from hypermask.machine.settings import MachineSettings
    from hypermask.services.side_devices import nodes_of
    from hypermask.workers.health import Health, Healths

    machine = MachineSettings.model_validate(
        {
            "version": 1,
            "name": "x",
            "camera": {"driver": "v4l2", "device": "/dev/video7"},
            "pantilt": {"driver": "sim"},
        }
    )
    assert nodes_of(machine) == {"camera": "/dev/video7"}
    health = Health(tmp_path, "tracker", VirtualClock(1.0))
    health.fault("CAM-HUNG")
    health.publish(now=True)
    (record,) = Healths(tmp_path).all().values()
    assert not record["ready"] and bytes(record["fault"].item()) == b"CAM-HUNG"
    assert np.isfinite(record["time_s"])
