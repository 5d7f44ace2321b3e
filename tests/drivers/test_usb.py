"""Re-enumerating a hung USB device, over a copy of what sysfs shows."""

import errno
from pathlib import Path
from typing import Any

import pytest
import usb.core

from hypermask_drivers import usb as tool
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.errors import DeviceAbsent, DeviceError


@pytest.fixture
def sysfs(tmp_path: Path) -> Path:
    folder = tmp_path / "devices/pci0/usb1/1-1/1-1.2"
    folder.mkdir(parents=True)
    words = {
        "busnum": "1", "devnum": "7", "idVendor": "0403", "idProduct": "6001",
        "manufacturer": "FTDI", "product": "USB Serial", "authorized": "1",
    }  # fmt: skip
    for name, word in words.items():
        (folder / name).write_text(f"{word}\n")
    bus = tmp_path / "bus/usb/devices"
    bus.mkdir(parents=True)
    (bus / "1-1.2").symlink_to(folder)
    interface = folder / "1-1.2:1.0/ttyUSB0"
    interface.mkdir(parents=True)
    tty = tmp_path / "class/tty/ttyUSB0"
    tty.mkdir(parents=True)
    (tty / "device").symlink_to(interface)
    return tmp_path


class Core:
    """`usb.core`, with one device that answers a reset as told."""

    USBError, NoBackendError = usb.core.USBError, usb.core.NoBackendError

    def __init__(self, failure: Exception | None = None, there: bool = True) -> None:
        self.failure, self.there = failure, there
        self.asked: dict[str, Any] = {}
        self.resets = 0

    def find(self, **asked: Any) -> Any:
        self.asked = asked
        if isinstance(self.failure, usb.core.NoBackendError):
            raise self.failure
        return self if self.there else None

    def reset(self) -> None:
        self.resets += 1
        if self.failure:
            raise self.failure


def test_a_device_is_known_by_its_port(sysfs: Path) -> None:
    device = tool.device_at("1-1.2", sysfs)
    assert (device.bus, device.address, device.vendor, device.product) == (1, 7, 0x0403, 0x6001)
    assert device.words == "FTDI USB Serial"


def test_the_port_behind_a_device_node(sysfs: Path) -> None:
    assert tool.port_of(Path("/dev/ttyUSB0"), sysfs) == "1-1.2"
    with pytest.raises(DeviceAbsent) as caught:
        tool.port_of(Path("/dev/ttyS0"), sysfs)
    assert caught.value.code == "USB-NONE"


@pytest.mark.parametrize("port", ["", "usb1", "../../etc", "1-1.2:1.0"])
def test_what_is_no_port_is_refused(sysfs: Path, port: str) -> None:
    with pytest.raises(DeviceError) as caught:
        tool.reenumerate(port, sysfs, Core())
    assert caught.value.code == "USB-PORT"


def test_an_empty_port_says_so(sysfs: Path) -> None:
    with pytest.raises(DeviceAbsent) as caught:
        tool.reenumerate("1-4", sysfs, Core())
    assert caught.value.code == "USB-ABSENT"


def test_a_reset_is_enough_where_it_works(sysfs: Path) -> None:
    core = Core()
    assert tool.reenumerate("1-1.2", sysfs, core) == "reset"
    assert core.asked == {"bus": 1, "address": 7} and core.resets == 1


def test_a_device_that_comes_back_elsewhere_was_reset(sysfs: Path) -> None:
    core = Core(usb.core.USBError("No such device", errno=errno.ENODEV))
    assert tool.reenumerate("1-1.2", sysfs, core) == "reset"


@pytest.mark.parametrize(
    "core",
    [
        Core(usb.core.USBError("I/O", errno=errno.EIO)),
        Core(usb.core.NoBackendError("No backend")),
        Core(there=False),
    ],
    ids=["reset fails", "no libusb", "libusb does not see it"],
)
def test_otherwise_the_kernel_lets_go_and_takes_it_back(
    sysfs: Path, core: Core, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []
    write = Path.write_text

    def note(path: Path, text: str, *rest: Any) -> int:
        written.append((path.name, text))
        return write(path, text, *rest)

    monkeypatch.setattr(Path, "write_text", note)
    clock = VirtualClock()
    assert tool.reenumerate("1-1.2", sysfs, core, clock) == "authorized"
    assert written == [("authorized", "0"), ("authorized", "1")] and clock.now() == 0.5


def test_without_the_rights_it_says_what_to_do(
    sysfs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, text: str) -> int:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "write_text", refuse)
    core = Core(usb.core.USBError("Access denied", errno=errno.EACCES))
    with pytest.raises(DeviceError) as caught:
        tool.reenumerate("1-1.2", sysfs, core, VirtualClock())
    assert caught.value.code == "USB-RIGHTS" and "udev" in caught.value.remedy
