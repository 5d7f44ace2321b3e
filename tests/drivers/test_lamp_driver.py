"""The projector's lamp at command level: what is written is read back."""

import pytest

from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost
from hypermask_drivers.lamp.dlpc34xx import Dlpc34xxLamp, Dlpc34xxSettings
from hypermask_sim.emulators.i2c import Wires
from hypermask_sim.emulators.i2c_lamp import Dlpc34xxChip


class Bench:
    def __init__(self, **settings: object) -> None:
        self.chip = Dlpc34xxChip()
        self.wires = Wires({0x1B: self.chip})
        chosen = Dlpc34xxSettings.model_validate({"device": "/dev/i2c-1", **settings})
        self.lamp = Dlpc34xxLamp(chosen, connect=self.wires.connect)


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.lamp.open()
    return bench


def test_opening_takes_the_currents_into_hand_and_leaves_the_light_as_it_is(bench: Bench) -> None:
    assert bench.chip.parameters[0x51] == [0]
    assert bench.lamp.read().on and bench.lamp.read().brightness == pytest.approx(1.0)


def test_brightness_scales_all_three_currents(bench: Bench) -> None:
    bench.lamp.set_power(True)
    bench.lamp.set_brightness(0.5)
    assert bench.chip.parameters[0x55] == [24, 1, 24, 1, 24, 1]  # 280
    assert bench.lamp.read().brightness == pytest.approx(0.5)


def test_no_brightness_is_dark_and_still_on(bench: Bench) -> None:
    bench.lamp.set_power(True)
    bench.lamp.set_brightness(0.0)
    assert bench.chip.parameters[0x53] == [0]
    assert bench.lamp.read().on and bench.lamp.read().brightness == 0
    bench.lamp.set_brightness(0.2)
    assert bench.chip.parameters[0x53] == [7]


def test_off_keeps_the_brightness_for_later(bench: Bench) -> None:
    bench.lamp.set_brightness(0.3)
    bench.lamp.set_power(False)
    assert not bench.lamp.read().on
    bench.lamp.set_power(True)
    assert bench.lamp.read().brightness == pytest.approx(0.3, abs=0.01)


def test_currents_that_the_driver_cuts_are_not_passed_over() -> None:
    bench = Bench(full_current=(1000, 1000, 1000))
    bench.lamp.open()
    with pytest.raises(DeviceError) as caught:
        bench.lamp.set_brightness(1.0)
    assert caught.value.code == "LMP-REFUSED" and "800" in caught.value.what


def test_a_controller_that_still_starts_is_absent(bench: Bench) -> None:
    bench.lamp.close()
    bench.chip.ready = False
    with pytest.raises(DeviceAbsent) as caught:
        bench.lamp.open()
    assert caught.value.code == "LMP-STARTING"


def test_a_restarted_controller_is_lost_and_back(bench: Bench) -> None:
    bench.chip.power_cycle()
    with pytest.raises(DeviceLost):
        bench.lamp.read()
    bench.lamp.open()
    assert bench.lamp.read().on


def test_temperature_and_faults(bench: Bench) -> None:
    bench.chip.system_status = [0b001, 0b010000, 0, 0b100000]
    state = bench.lamp.read()
    assert state.temperature_c == pytest.approx(41.5)
    assert state.faults == (
        "the mirror chip is wrong", "the green LED fails", "its watchdog has restarted it",
    )  # fmt: skip


def test_the_curtain_is_black_over_a_lit_picture(bench: Bench) -> None:
    bench.lamp.set_curtain(True)
    assert bench.chip.parameters[0x17] == [1] and bench.lamp.read().on
