"""Re-enumerating a USB device that hangs, by its port, which stays the same when others come.

A port is named as sysfs names it: `1-1.2` is bus 1, root port 1, hub port 2.
"""

from __future__ import annotations

import errno
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from hypermask_drivers.clock import Clock, RealClock
from hypermask_drivers.errors import DeviceAbsent, DeviceError
from hypermask_drivers.hardware import needed, plain

SYSFS = Path("/sys")
_PORT = re.compile(r"\d+-\d+(?:\.\d+)*")
_OFF_S = 0.5


@dataclass(frozen=True)
class UsbDevice:
    """bus, address: as `lsusb` counts them; they change when it is plugged in again."""

    port: str
    bus: int
    address: int
    vendor: int
    product: int
    words: str


def device_at(port: str, sysfs: Path = SYSFS) -> UsbDevice:
    """Raises `DeviceError` USB-PORT for what is no port, `DeviceAbsent` USB-ABSENT."""
    if not _PORT.fullmatch(port):
        raise DeviceError("USB-PORT", f"'{port}' is no USB port", "Name one such as 1-1.2.")
    folder = sysfs / "bus/usb/devices" / port
    try:
        return UsbDevice(
            port,
            int(_word(folder, "busnum")),
            int(_word(folder, "devnum")),
            int(_word(folder, "idVendor"), 16),
            int(_word(folder, "idProduct"), 16),
            " ".join(filter(None, (_word(folder, "manufacturer"), _word(folder, "product")))),
        )
    except (OSError, ValueError):
        raise DeviceAbsent(
            "USB-ABSENT", f"nothing is plugged in at the USB port {port}", "Check its cable."
        ) from None


def port_of(node: Path, sysfs: Path = SYSFS) -> str:
    """The port of a device node such as `/dev/hypermask/ptu`, a camera, a sound card.

    Raises `DeviceAbsent` USB-NONE where it is not a USB device.
    """
    real = Path(node).resolve()
    for kind in ("tty", "video4linux", "sound", "hidraw", "drm"):
        link = sysfs / "class" / kind / real.name / "device"
        if link.exists():
            place = link.resolve()
            ports = [part for part in place.parts if _PORT.fullmatch(part)]
            if ports:
                return ports[-1]
    raise DeviceAbsent(
        "USB-NONE", f"{node} is not a USB device that is plugged in", "Check the name."
    )


def reenumerate(
    port: str, sysfs: Path = SYSFS, core: Any = None, clock: Clock | None = None
) -> str:
    """Make the device at `port` start anew; returns how: "reset" or "authorized".

    First a USB port reset (pyusb), which a hung device usually obeys; where that fails, the kernel
    lets go of it and takes it back. Raises `DeviceAbsent` USB-ABSENT, DRV-MODULE, `DeviceError`
    USB-RIGHTS, USB-FAILED.
    """
    device = device_at(port, sysfs)
    core = core or needed("usb.core", "python3-usb")
    try:
        found = core.find(bus=device.bus, address=device.address)
        if found is not None:
            found.reset()
            return "reset"
        failure: Exception = DeviceAbsent("USB-ABSENT", "libusb does not see it", "")
    except core.NoBackendError as error:
        failure = error
    except (core.USBError, OSError) as error:
        if getattr(error, "errno", None) == errno.ENODEV:  # it came back at another address
            return "reset"
        failure = error
    try:
        _authorize(sysfs / "bus/usb/devices" / port / "authorized", clock or RealClock())
    except OSError as error:
        _explain(port, failure, error)
    return "authorized"


def _authorize(file: Path, clock: Clock) -> None:
    """Kernel documentation, usb/authorization.rst: 0 unbinds, 1 enumerates again."""
    file.write_text("0")
    try:
        clock.sleep_until(clock.now() + _OFF_S)
    finally:
        file.write_text("1")


def _explain(port: str, first: Exception, second: OSError) -> NoReturn:
    denied = {errno.EACCES, errno.EPERM}
    if second.errno in denied:
        raise DeviceError(
            "USB-RIGHTS",
            f"the device at the USB port {port} may not be reset ({plain(first)})",
            "Install the udev rules and join the group hypermask, or run this as root.",
        ) from second
    raise DeviceError(
        "USB-FAILED",
        f"the device at the USB port {port} did not start anew ({plain(second)})",
        "Unplug it and plug it in again.",
    ) from second


def _word(folder: Path, name: str) -> str:
    """Empty for what a device need not have; its numbers it has."""
    path = folder / name
    if name in ("manufacturer", "product") and not path.exists():
        return ""
    return path.read_text().strip()
