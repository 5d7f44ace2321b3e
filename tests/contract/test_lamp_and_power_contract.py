import pytest
from contract_rigs import RIGS, Rig, implementations

from hypermask_drivers.errors import DeviceError
from hypermask_drivers.lamp import Lamp
from hypermask_drivers.power import Power


@pytest.fixture(params=implementations("lamp"))
def lamp(request: pytest.FixtureRequest) -> Lamp:
    device = RIGS["lamp"][request.param]().device
    device.open()
    assert isinstance(device, Lamp)
    return device


@pytest.fixture(params=implementations("power"))
def power_rig(request: pytest.FixtureRequest) -> Rig:
    rig = RIGS["power"][request.param]()
    rig.device.open()
    return rig


def test_the_lamp_does_as_it_is_told(lamp: Lamp) -> None:
    lamp.set_power(True)
    lamp.set_brightness(0.25)
    state = lamp.read()
    assert state.on and state.brightness == pytest.approx(0.25, abs=0.01)
    lamp.set_power(False)
    assert not lamp.read().on


@pytest.mark.parametrize("wrong", [-0.01, 1.01, float("nan")])
def test_a_brightness_out_of_range_is_refused(lamp: Lamp, wrong: float) -> None:
    lamp.set_brightness(0.5)
    with pytest.raises(DeviceError) as caught:
        lamp.set_brightness(wrong)
    assert caught.value.code == "LAMP-RANGE"
    assert lamp.read().brightness == pytest.approx(0.5, abs=0.01)


def test_the_battery_reading_is_plausible_and_of_now(power_rig: Rig) -> None:
    device = power_rig.device
    assert isinstance(device, Power)
    reading = device.read()
    assert 5 < reading.voltage_v < 60
    assert reading.charge is None or 0 <= reading.charge <= 1
    assert reading.time_s == pytest.approx(power_rig.clock.now(), abs=1.0)
