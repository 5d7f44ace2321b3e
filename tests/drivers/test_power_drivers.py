"""The battery monitors at register level, and the battery's state of charge."""

import itertools

import pytest

from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost
from hypermask_drivers.i2c import signed, swapped
from hypermask_drivers.power.battery import CURVES, Battery, BatterySettings
from hypermask_drivers.power.ina2xx import Ina2xxSettings, Ina219, Ina226
from hypermask_sim.emulators.i2c import Chip, Wires
from hypermask_sim.emulators.i2c_power import Ina219Chip, Ina226Chip, InaChip

CHIPS = {Ina219: Ina219Chip, Ina226: Ina226Chip}
FITTING = {
    Ina219: Ina2xxSettings(device="/dev/i2c-1", shunt_ohm=0.02, most_a=15.0),
    Ina226: Ina2xxSettings(device="/dev/i2c-1", shunt_ohm=0.005, most_a=15.0),
}


class Bench:
    def __init__(self, kind: type[Ina219 | Ina226], **changes: object) -> None:
        settings = FITTING[kind].model_copy(update=changes)
        self.volts, self.amperes = 12.6, 5.5
        chip: type[InaChip] = CHIPS[kind]  # type: ignore[assignment]
        self.chip = chip(lambda: (self.volts, self.amperes), settings.shunt_ohm)
        self.wires = Wires({0x40: self.chip})
        self.clock = VirtualClock(50.0)
        self.monitor = kind(settings, self.clock, self.wires.connect)


@pytest.fixture(params=CHIPS, ids=lambda kind: kind.__name__)
def bench(request: pytest.FixtureRequest) -> Bench:
    return Bench(request.param)


@pytest.mark.parametrize("amperes", [0.0, 0.5, 5.5, 14.0, -3.0])
def test_volts_amperes_and_watts(bench: Bench, amperes: float) -> None:
    bench.amperes = amperes
    bench.monitor.open()
    raw = bench.monitor.measure()
    assert raw.voltage_v == pytest.approx(12.6, abs=0.004)
    assert raw.current_a == pytest.approx(amperes, rel=1e-3, abs=0.006)
    assert raw.power_w == pytest.approx(12.6 * abs(amperes), abs=0.1)


def test_the_datasheets_example_of_the_ina226() -> None:
    """SBOS547, section 6.5.2 (table 6-1): 2 mohm, 10 A, 1 mA steps: calibration 2560."""
    settings = Ina2xxSettings(shunt_ohm=0.002, most_a=0.001 * 2**15)
    assert Ina226(settings).calibration == 2560


def test_the_calibration_gives_the_step_that_is_used(bench: Bench) -> None:
    monitor = bench.monitor
    ideal = monitor._scale / (monitor.current_step_a * monitor.settings.shunt_ohm)
    assert 0 < monitor.calibration <= 0xFFFE
    assert monitor.calibration == pytest.approx(ideal, rel=2e-3)


@pytest.mark.parametrize("kind", CHIPS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("shunt_ohm", [0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("share", [1.0, 0.3, 0.02])
def test_the_current_is_right_whatever_the_shunt(
    kind: type[Ina219 | Ina226], shunt_ohm: float, share: float
) -> None:
    """share: of the largest current that the chip measures with it, as full scale."""
    most_a = max(share * kind._shunt_full_v / shunt_ohm, 3.0 if shunt_ohm < 0.005 else 0.5)
    bench = Bench(kind, shunt_ohm=shunt_ohm, most_a=most_a)
    bench.monitor.open()
    for bench.amperes in (0.98 * most_a, -0.7 * most_a):
        raw = bench.monitor.measure()
        assert raw.current_a == pytest.approx(bench.amperes, rel=0.01)
        assert raw.power_w == pytest.approx(12.6 * abs(bench.amperes), rel=0.02)


def test_wires_the_other_way_round(bench: Bench) -> None:
    turned = Bench(type(bench.monitor), reversed=True)
    turned.amperes = -2.0
    turned.monitor.open()
    assert turned.monitor.read().current_a == pytest.approx(2.0, abs=0.01)


def test_a_monitor_that_forgot_its_calibration_is_lost_not_believed(bench: Bench) -> None:
    """Without it the current reads 0: a cart that seems to draw nothing."""
    bench.monitor.open()
    bench.chip.power_cycle()
    with pytest.raises(DeviceLost) as caught:
        bench.monitor.read()
    assert caught.value.code == "PWR-LOST"
    bench.monitor.open()
    assert bench.monitor.read().current_a == pytest.approx(5.5, abs=0.01)


def test_a_shunt_too_large_for_the_chip_is_refused(bench: Bench) -> None:
    wrong = Bench(type(bench.monitor), shunt_ohm=0.1)
    with pytest.raises(DeviceAbsent) as caught:
        wrong.monitor.open()
    assert caught.value.code == "PWR-RANGE"


def test_another_chip_at_the_address_is_told(bench: Bench) -> None:
    bench.wires.chips[0x40] = Chip()
    if isinstance(bench.monitor, Ina219):  # it has no number of its own, only its behaviour
        bench.wires.chips[0x40].write_word_data = lambda *_: None  # type: ignore[method-assign]
    with pytest.raises(DeviceAbsent) as caught:
        bench.monitor.open()
    assert caught.value.code == "PWR-STRANGE"


def test_the_ina219_says_when_its_mathematics_overflow() -> None:
    bench = Bench(Ina219, shunt_ohm=0.02, most_a=2.0)
    bench.amperes = 14.0
    bench.monitor.open()
    with pytest.raises(DeviceError) as caught:
        bench.monitor.read()
    assert caught.value.code == "PWR-OVERFLOW"


def test_the_ina219_works_on_the_kernels_i2c_stub() -> None:
    """Registers that are only memory: volts and amperes are what was put there from outside."""
    stub = Chip()
    settings = Ina2xxSettings(device="/dev/i2c-1")
    monitor = Ina219(settings, VirtualClock(), Wires({0x40: stub}).connect)
    monitor.open()
    stub.words[2] = swapped(round(12.0 / 0.004) << 3)
    stub.words[4] = swapped(round(1.5 / monitor.current_step_a))
    reading = monitor.read()
    assert (reading.voltage_v, reading.current_a) == pytest.approx((12.0, 1.5), abs=1e-3)


@pytest.mark.parametrize(("word", "value"), [(0, 0), (1, 1), (0x7FFF, 32767), (0xFFFF, -1)])
def test_twos_complement(word: int, value: int) -> None:
    assert signed(word) == value


# --- the battery ------------------------------------------------------------------------------


@pytest.mark.parametrize("chemistry", CURVES)
def test_curves_rise(chemistry: str) -> None:
    for (low_v, low), (high_v, high) in itertools.pairwise(CURVES[chemistry]):
        assert low_v < high_v and low < high


def test_full_and_empty_by_voltage() -> None:
    battery = Battery(BatterySettings())
    assert battery.by_voltage(13.0, 0.0) == 1.0
    assert battery.by_voltage(10.0, 0.0) == 0.0
    assert 0.3 < battery.by_voltage(12.0, 0.0) < 0.6


def test_a_load_does_not_make_a_full_battery_look_empty() -> None:
    battery = Battery(BatterySettings(resistance_ohm=0.05))
    assert battery.by_voltage(12.6 - 10 * 0.05, 10.0) == pytest.approx(
        battery.by_voltage(12.6, 0.0)
    )


def test_charge_is_counted_where_the_capacity_is_known() -> None:
    """A tenth of the capacity drawn takes about a tenth of the charge, whatever the flat curve
    says meanwhile."""
    settings = BatterySettings(
        chemistry="lifepo4", cells=4, capacity_ah=10.0, resistance_ohm=0.0, settle_s=1e9
    )
    battery = Battery(settings)
    start, _ = battery.follow(13.2, 10.0, 0.0)
    for second in range(1, 361):
        charge, _ = battery.follow(13.2, 10.0, float(second))
    assert start - charge == pytest.approx(0.1, abs=1e-3)


def test_the_counted_charge_settles_on_what_the_voltage_says() -> None:
    battery = Battery(BatterySettings(capacity_ah=10.0, settle_s=100.0))
    battery.follow(12.6, 0.0, 0.0)
    for second in range(1, 2000):
        charge, _ = battery.follow(12.18, 0.0, float(second))
    assert charge == pytest.approx(0.6, abs=0.01)


def test_levels_do_not_flicker_around_their_bounds() -> None:
    battery = Battery(BatterySettings(low=0.2, critical=0.08, hysteresis=0.03))
    seen = []
    for step, charge in enumerate([0.5, 0.21, 0.19, 0.21, 0.22, 0.24, 0.07, 0.1, 0.12, 0.3]):
        battery._charge, battery._time_s = charge, float(step)
        seen.append(battery._judge(charge))
        battery._level = seen[-1]
    assert seen == [
        "good", "good", "low", "low", "low", "good", "critical", "critical", "low", "good",
    ]  # fmt: skip
