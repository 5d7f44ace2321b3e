"""What a display does is heard; what the neighbours do leaves the picture alone."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from hypermask_drivers.projector.kms_hotplug import Hotplug, HotplugWatch, hotplug

MINE, OTHER = 36, 41


def message(card: str = "card0", **words: object) -> bytes:
    """As the kernel's drm_sysfs.c sends it."""
    start = [f"change@/devices/platform/gpu/drm/{card}", "ACTION=change", "SUBSYSTEM=drm"]
    given = [f"{name}={value}" for name, value in words.items()]
    return "\0".join([*start, *given, f"DEVNAME=dri/{card}", "SEQNUM=9", ""]).encode()


def test_a_hotplug_event_is_told_from_others() -> None:
    assert hotplug(message(HOTPLUG=1, CONNECTOR=36)) == Hotplug("card0", 36)
    assert hotplug(message(HOTPLUG=1)) == Hotplug("card0", None)
    assert hotplug(message(HOTPLUG=1, CONNECTOR=36, PROPERTY=5)) == Hotplug("card0", 36, True)
    assert hotplug(message(LEASE=1)) is None
    assert hotplug(message(HOTPLUG=1).replace(b"SUBSYSTEM=drm", b"SUBSYSTEM=usb")) is None


class Plug:
    """A connector in sysfs, and a kernel that sends events about it."""

    def __init__(self, root: Path) -> None:
        self.folder = root / "card0-HDMI-A-1"
        self.folder.mkdir()
        self.be("connected", b"EDID of a projector")
        self.broken = False
        self.probes = 0
        self.now_s = 1.0
        self.watch = HotplugWatch("/dev/dri/card0", "HDMI-A-1", MINE, self.probe, root)
        self.kernel, ours = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        ours.setblocking(False)
        self.watch.close()
        self.watch._socket = ours

    def be(self, status: str, edid: bytes) -> None:
        (self.folder / "status").write_text(status + "\n")
        (self.folder / "edid").write_bytes(edid)

    def probe(self) -> bool:
        self.probes += 1
        return self.broken

    def changed(self, *messages: bytes, after_s: float = 0.01) -> bool:
        for each in messages:
            self.kernel.send(each)
        self.now_s += after_s
        return self.watch.changed(self.now_s)


@pytest.fixture
def plug(tmp_path: Path) -> Iterator[Plug]:
    plug = Plug(tmp_path)
    assert not plug.changed()
    yield plug
    plug.watch.close()
    plug.kernel.close()


def test_a_display_that_goes_is_seen_in_its_status_file(plug: Plug) -> None:
    plug.be("disconnected", b"")
    assert not plug.changed(after_s=0.2)  # looked at twice a second at most
    assert plug.changed(after_s=0.4) and not plug.changed(after_s=0.6)
    assert plug.probes == 0


def test_an_event_of_this_connector_counts_at_once(plug: Plug) -> None:
    assert plug.changed(message(HOTPLUG=1, CONNECTOR=MINE))
    assert not plug.changed()


@pytest.mark.parametrize(
    "event",
    [
        message(HOTPLUG=1, CONNECTOR=OTHER),
        message("card1", HOTPLUG=1),
        message("card1", HOTPLUG=1, CONNECTOR=MINE),
        message(LEASE=1),
    ],
)
def test_what_the_neighbours_do_is_not_even_looked_into(plug: Plug, event: bytes) -> None:
    assert not plug.changed(event) and plug.probes == 0


@pytest.mark.parametrize(
    "event", [message(HOTPLUG=1), message(HOTPLUG=1, CONNECTOR=MINE, PROPERTY=5)]
)
def test_an_event_that_names_no_connector_counts_only_if_something_changed(
    plug: Plug, event: bytes
) -> None:
    assert not plug.changed(event) and plug.probes == 1
    plug.be("connected", b"EDID of a monitor")
    assert plug.changed(event) and not plug.changed(event)
    plug.broken = True
    assert plug.changed(event)


def test_an_edid_that_could_not_be_read_is_no_other_display(plug: Plug) -> None:
    plug.be("connected", b"")
    assert not plug.changed(message(HOTPLUG=1))
    plug.be("connected", b"EDID of a projector")
    assert not plug.changed(message(HOTPLUG=1))
