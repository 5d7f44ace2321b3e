"""The keypads of real hardware: USB at report level, I2C at register level."""

from pathlib import Path

import pytest

from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.errors import DeviceAbsent, DeviceLost
from hypermask_drivers.keypad import KEYS, Keypad
from hypermask_drivers.keypad.i2c_pads import MatrixSettings, Pcf8574Pad, Tca8418Pad
from hypermask_drivers.keypad.layout import MATRIX_4X4, USAGES
from hypermask_drivers.keypad.matrix import Matrix, is_ambiguous
from hypermask_drivers.keypad.usb_pad import UsbPad, UsbPadSettings, pressed_keys
from hypermask_sim.emulators.i2c import Chip, Wires
from hypermask_sim.emulators.i2c_keypad import Pcf8574Matrix, Tca8418Chip
from hypermask_sim.emulators.keypad import EmulatedHid, EmulatedPad, Fingers

START = 100.0


def taken(pad: Keypad) -> list[tuple[str, bool]]:
    found = []
    while (event := pad.read(0.0)) is not None:
        found.append((event.key, event.pressed))
    return found


class UsbBench:
    def __init__(self, *others: EmulatedPad, **settings: object) -> None:
        self.clock = VirtualClock(START)
        self.fingers = Fingers(self.clock)
        self.pad = EmulatedPad(self.fingers)
        self.hid = EmulatedHid(self.pad, *others)
        self.driver = UsbPad(UsbPadSettings.model_validate(settings), self.clock, self.hid)

    def reports(self, *reports: list[int]) -> list[tuple[str, bool]]:
        for report in reports:
            self.pad.reports.append(report)
        return taken(self.driver)


@pytest.fixture
def usb() -> UsbBench:
    bench = UsbBench()
    bench.driver.open()
    return bench


# --- USB: reports -----------------------------------------------------------------------------


def test_every_key_of_a_pad_has_a_usage() -> None:
    assert set(USAGES.values()) == set(KEYS)


def test_press_and_release(usb: UsbBench) -> None:
    assert usb.reports([0, 0, 0x5D, 0, 0, 0, 0, 0], [0] * 8) == [("5", True), ("5", False)]


def test_keys_that_overlap(usb: UsbBench) -> None:
    found = usb.reports(
        [0, 0, 0x59, 0, 0, 0, 0, 0], [0, 0, 0x59, 0x5A, 0, 0, 0, 0], [0, 0, 0x5A, 0, 0, 0, 0, 0],
    )  # fmt: skip
    assert found == [("1", True), ("2", True), ("1", False)]


def test_a_key_held_says_nothing_more(usb: UsbBench) -> None:
    assert usb.reports(*[[0, 0, 0x59, 0, 0, 0, 0, 0]] * 5) == [("1", True)]


def test_rollover_is_no_release(usb: UsbBench) -> None:
    usb.reports([0, 0, 0x59, 0, 0, 0, 0, 0])
    assert usb.reports([0, 0, 1, 1, 1, 1, 1, 1]) == []
    assert usb.reports([0] * 8) == [("1", False)]


@pytest.mark.parametrize("modifiers", [0x00, 0x02, 0xFF])
def test_modifiers_and_numlock_do_not_matter(usb: UsbBench, modifiers: int) -> None:
    assert usb.reports([modifiers, 0, 0x61, 0, 0, 0, 0, 0]) == [("9", True)]


def test_numbered_and_foreign_reports() -> None:
    assert pressed_keys([1, 0, 0, 0x61, 0, 0, 0, 0, 0]) == ("9",)
    assert pressed_keys([3, 0xE9, 0]) is None
    assert pressed_keys([0, 0, 0x04, 0x61, 0, 0, 0, 0]) == ("9",)  # a letter is none of ours


# --- USB: which device ------------------------------------------------------------------------


def test_the_kernel_loses_the_interface_while_it_is_open(usb: UsbBench) -> None:
    assert usb.hid.detached == {"1-1:1.0"}
    usb.driver.close()
    assert usb.hid.detached == set()


def test_of_several_keyboards_the_numeric_pad_is_taken() -> None:
    clock = VirtualClock()
    pad = EmulatedPad(Fingers(clock), path="1-3:1.0", name="USB Numeric Keypad")
    bench = UsbBench(pad)
    bench.driver.open()
    assert bench.driver.place == "USB port 1-3"


def test_of_several_keyboards_none_is_taken_unless_it_is_named() -> None:
    other = EmulatedPad(Fingers(VirtualClock()), path="1-3:1.0")
    with pytest.raises(DeviceAbsent) as caught:
        UsbBench(other).driver.open()
    assert caught.value.code == "KEY-CHOICE" and "1-1, 1-3" in caught.value.what
    bench = UsbBench(other, port="1-3")
    bench.driver.open()
    assert bench.driver.place == "USB port 1-3"


def test_by_vendor_and_product() -> None:
    bench = UsbBench(vendor=0x04D9, product=0x1203)
    with pytest.raises(DeviceAbsent) as caught:
        bench.driver.open()
    assert caught.value.code == "KEY-ABSENT"
    bench.pad.vendor, bench.pad.product = 0x04D9, 0x1203
    bench.driver.open()


@pytest.mark.parametrize("boot", [True, False])
def test_sysfs_tells_where_the_back_end_cannot(tmp_path: Path, boot: bool) -> None:
    clock = VirtualClock()
    pad = EmulatedPad(Fingers(clock), usage=(0, 0), boot_keyboard=boot)
    pad.write_sysfs(tmp_path)
    driver = UsbPad(UsbPadSettings(), clock, EmulatedHid(pad), tmp_path)
    if boot:
        driver.open()
        return
    with pytest.raises(DeviceAbsent):
        driver.open()


def test_the_other_back_end_would_leak_keys() -> None:
    bench = UsbBench()
    bench.pad.path = "/dev/hidraw0"
    with pytest.raises(DeviceAbsent) as caught:
        bench.driver.open()
    assert caught.value.code == "KEY-LEAK"


def test_no_right_to_open_it() -> None:
    bench = UsbBench()
    bench.pad.busy = True
    with pytest.raises(DeviceAbsent) as caught:
        bench.driver.open()
    assert caught.value.code == "KEY-RIGHTS"


def test_what_was_pressed_before_it_was_opened_is_forgotten() -> None:
    bench = UsbBench()
    bench.fingers.press("4", START + 1)
    bench.clock.sleep_until(START + 2)
    bench.driver.open()
    assert taken(bench.driver) == []


def test_a_key_held_while_unplugged_is_not_held_afterwards(usb: UsbBench) -> None:
    usb.fingers.press("4", START + 1, held_s=60.0)
    usb.clock.sleep_until(START + 2)
    assert taken(usb.driver) == [("4", True)]
    usb.pad.unplug()
    with pytest.raises(DeviceLost):
        usb.driver.read(0.0)
    usb.pad.plug()
    usb.driver.open()
    usb.fingers.press("4", START + 3)
    usb.clock.sleep_until(START + 4)
    assert taken(usb.driver) == [("4", True), ("4", False)]


# --- I2C: matrix ------------------------------------------------------------------------------


def test_bouncing_contacts_are_one_press() -> None:
    matrix = Matrix(MATRIX_4X4, debounce_s=0.015)
    closed = [1, 0, 1, 1, 0, 1, 1, 1, 1, 1, 1, 0, 1, 0, 0, 0, 0, 0, 0]
    for step, contact in enumerate(closed):
        matrix.take((0, contact, 0, 0), 0.005 * step)
    assert [(event.key, event.pressed) for event in matrix.events] == [("4", True), ("4", False)]


def test_a_blip_shorter_than_the_debounce_time_is_nothing() -> None:
    matrix = Matrix(MATRIX_4X4, debounce_s=0.015)
    for step, contact in enumerate([0, 1, 1, 0, 0, 0, 0, 0]):
        matrix.take((contact, 0, 0, 0), 0.005 * step)
    assert not matrix.events


def test_two_keys_are_told_apart_and_a_rectangle_is_not() -> None:
    assert not is_ambiguous((0b0001, 0b0010, 0, 0))
    assert not is_ambiguous((0b0011, 0, 0b0001, 0))
    assert is_ambiguous((0b0011, 0b0011, 0, 0))


class I2cBench:
    def __init__(self, driver: type[Pcf8574Pad | Tca8418Pad]) -> None:
        self.clock = VirtualClock(START)
        self.fingers = Fingers(self.clock)
        emulator = Pcf8574Matrix if driver is Pcf8574Pad else Tca8418Chip
        self.chip = emulator(self.fingers, MATRIX_4X4)
        address = 0x20 if driver is Pcf8574Pad else 0x34
        self.wires = Wires({address: self.chip})
        settings = MatrixSettings(device="/dev/i2c-1")
        self.driver = driver(settings, self.clock, self.wires.connect)

    def watch(self, until_s: float) -> list[tuple[str, bool]]:
        while self.clock.now() < START + until_s:
            self.clock.sleep_until(self.clock.now() + 0.005)
            self.driver.poll()
        return taken(self.driver)


@pytest.fixture(params=[Pcf8574Pad, Tca8418Pad], ids=["pcf8574", "tca8418"])
def bench(request: pytest.FixtureRequest) -> I2cBench:
    bench = I2cBench(request.param)
    bench.driver.open()
    return bench


@pytest.mark.parametrize("key", [key for row in MATRIX_4X4 for key in row])
def test_every_key_of_the_matrix(bench: I2cBench, key: str) -> None:
    bench.fingers.press(key, START + 0.5)
    assert bench.watch(1.0) == [(key, True), (key, False)]


def test_two_keys_at_a_time(bench: I2cBench) -> None:
    bench.fingers.press("7", START + 0.5, held_s=0.5)
    bench.fingers.press("5", START + 0.7)
    assert bench.watch(2.0) == [("7", True), ("5", True), ("5", False), ("7", False)]


def test_ghosts_are_never_reported() -> None:
    """7, 8 and 4 together close 5 as well, electrically."""
    bench = I2cBench(Pcf8574Pad)
    bench.driver.open()
    for key, delay in (("7", 0.1), ("8", 0.2), ("4", 0.3)):
        bench.fingers.press(key, START + delay, held_s=1.0)
    found = bench.watch(2.0)
    assert "5" not in {key for key, _ in found}
    assert found[:2] == [("7", True), ("8", True)]


def test_more_events_than_the_chip_keeps_leave_no_key_stuck() -> None:
    """The release of 6 is among the events that the full memory dropped."""
    bench = I2cBench(Tca8418Pad)
    bench.driver.open()
    bench.fingers.press("6", START + 0.1, held_s=0.2)
    assert bench.watch(0.2) == [("6", True)]
    for index in range(6):
        bench.fingers.press("5", START + 0.5 + 0.2 * index)
    bench.clock.sleep_until(START + 5)
    found = taken(bench.driver)
    assert found[0] == ("6", False)
    assert found[-2:] == [("5", True), ("5", False)]


def test_a_pad_that_lost_its_power_is_lost_and_back(bench: I2cBench) -> None:
    bench.chip.power_cycle()
    with pytest.raises(DeviceLost) as caught:
        bench.driver.read(0.0)
    assert caught.value.code == "KEY-LOST"
    bench.driver.open()
    bench.fingers.press("1", START + 0.5)
    assert bench.watch(1.0) == [("1", True), ("1", False)]


def test_a_pcf8574_works_on_the_kernels_i2c_stub() -> None:
    """Each register holds what the pins read while its number is written to them."""
    stub, clock = Chip(), VirtualClock()
    idle, rows = 0x0F, (0xEF, 0xDF, 0xBF, 0x7F)
    for register in (idle, *rows):
        stub.words[register] = register
    stub.words[idle + 1] = idle
    driver = Pcf8574Pad(MatrixSettings(device="/dev/i2c-1"), clock, Wires({0x20: stub}).connect)
    driver.open()
    stub.words[0xDF] = 0xDD  # row 1, column 1 closed
    for step in range(10):
        clock.sleep_until(0.005 * step)
        driver.poll()
    assert taken(driver) == [("5", True)]


def test_a_layout_of_unknown_keys_is_refused() -> None:
    with pytest.raises(ValueError, match="there is no key 'F1'"):
        MatrixSettings(layout=(("F1",),))
