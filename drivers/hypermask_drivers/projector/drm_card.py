"""A display card: its connectors, planes and properties, atomic commits, and flip events.

Source: the kernel's documentation "Kernel Mode Setting (KMS)", atomic mode setting.
"""

from __future__ import annotations

import errno
import fcntl
import os
import select
import struct
from collections.abc import Mapping
from ctypes import Array, Structure, addressof, c_int32, c_uint32, c_uint64, sizeof
from dataclasses import dataclass
from typing import Any, TypeVar

from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost
from hypermask_drivers.projector import drm_abi as abi
from hypermask_drivers.projector.kms_hotplug import HotplugWatch

Argument = TypeVar("Argument", bound=Structure)

RETRIED = "Check power and cable; it is retried every second."


@dataclass(frozen=True)
class Property:
    """A property of a KMS object: its number, its value now, its enumeration's names."""

    number: int
    value: int
    names: Mapping[str, int]


@dataclass(frozen=True)
class Connector:
    """connected: None where the hardware cannot tell."""

    number: int
    name: str
    connected: bool | None
    modes: tuple[abi.ModeInfo, ...]
    encoders: tuple[int, ...]
    encoder: int


@dataclass(frozen=True)
class Flip:
    """A flip's end: CLOCK_MONOTONIC seconds, and the CRTC's frame count (0 without vblanks)."""

    time_s: float
    sequence: int


class Card:
    def __init__(self, path: str) -> None:
        """Raises `DeviceAbsent` PRJ-CARD, PRJ-RIGHTS, PRJ-MASTER or PRJ-ATOMIC."""
        try:
            self.descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NONBLOCK)
        except OSError as error:
            raise _open_error(path, error) from error
        self.path = path
        try:
            self.take_master()
            self._require_atomic()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        os.close(self.descriptor)

    def call(self, request: int, argument: Any = 0) -> Any:
        """One ioctl, tried again after signals. Raises `OSError`."""
        while True:
            try:
                fcntl.ioctl(self.descriptor, request, argument, *(() if argument == 0 else (True,)))
                return argument
            except InterruptedError:
                continue

    # Master: one program at a time may drive a card

    def take_master(self) -> None:
        """Raises `DeviceAbsent` PRJ-MASTER while another program drives the display."""
        try:
            self.call(abi.SET_MASTER)
        except OSError as error:
            if error.errno == errno.ENODEV:
                raise DeviceAbsent("PRJ-CARD", f"{self.path} vanished", RETRIED) from error
            raise DeviceAbsent(
                "PRJ-MASTER",
                f"another program drives the display on {self.path} ({error.strerror})",
                "Stop the desktop or the other show (`fuser -v /dev/dri/card*` names it). "
                "It is retried every second.",
            ) from error

    def drop_master(self) -> None:
        """Let another program take the display over; the picture stays until it does."""
        try:
            self.call(abi.DROP_MASTER)
        except OSError:
            return

    def _require_atomic(self) -> None:
        try:
            for cap in (abi.CLIENT_CAP_UNIVERSAL_PLANES, abi.CLIENT_CAP_ATOMIC):
                self.call(abi.SET_CLIENT_CAP, abi.Capability(cap, 1))
        except OSError as error:
            raise DeviceAbsent(
                "PRJ-ATOMIC",
                f"the display driver of {self.path} has no atomic mode setting",
                "Use a kernel driver that has it (for virtual and board displays: 5.10 or newer).",
            ) from error

    def monotonic_stamps(self) -> bool:
        answer = self.call(abi.GET_CAP, abi.Capability(abi.CAP_TIMESTAMP_MONOTONIC, 0))
        return bool(answer.value)

    def watch(self, connector: Connector) -> HotplugWatch:
        """Tells when the connector's display comes or goes."""

        def probe() -> bool:
            self.connector(connector.number)
            link = self.properties(connector.number, abi.OBJECT_CONNECTOR).get("link-status")
            return link is not None and link.value == link.names.get("Bad")

        return HotplugWatch(self.path, connector.name, connector.number, probe)

    # What there is

    def resources(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Numbers of the CRTCs and of the connectors, in the kernel's order."""
        counts = self.call(abi.GET_RESOURCES, abi.CardResources())
        crtcs, connectors = _numbers(counts.count_crtcs), _numbers(counts.count_connectors)
        self.call(
            abi.GET_RESOURCES,
            abi.CardResources(
                crtc_id_ptr=addressof(crtcs), connector_id_ptr=addressof(connectors),
                count_crtcs=counts.count_crtcs, count_connectors=counts.count_connectors,
            ),
        )  # fmt: skip
        return tuple(crtcs), tuple(connectors)

    def connector(self, number: int) -> Connector:
        """Asks the display anew (tens of ms)."""
        counts = self.call(abi.GET_CONNECTOR, abi.GetConnector(connector_id=number))
        modes = (abi.ModeInfo * max(1, counts.count_modes))()
        encoders = _numbers(counts.count_encoders)
        found = self.call(
            abi.GET_CONNECTOR,
            abi.GetConnector(
                connector_id=number, modes_ptr=addressof(modes), count_modes=counts.count_modes,
                encoders_ptr=addressof(encoders), count_encoders=counts.count_encoders,
            ),
        )  # fmt: skip
        kind = found.connector_type
        known = kind < len(abi.CONNECTOR_NAMES)
        name = abi.CONNECTOR_NAMES[kind] if known else "Unknown"
        return Connector(
            number,
            f"{name}-{found.connector_type_id}",
            {1: True, 2: False}.get(found.connection),
            tuple(modes[: min(found.count_modes, counts.count_modes)]),
            tuple(encoders),
            found.encoder_id,
        )

    def encoder(self, number: int) -> abi.GetEncoder:
        return self._get(abi.GET_ENCODER, abi.GetEncoder(encoder_id=number))

    def planes(self) -> tuple[abi.GetPlane, ...]:
        counts = self.call(abi.GET_PLANE_RESOURCES, abi.PlaneResources())
        numbers = _numbers(counts.count_planes)
        self.call(
            abi.GET_PLANE_RESOURCES, abi.PlaneResources(addressof(numbers), counts.count_planes)
        )
        return tuple(self._get(abi.GET_PLANE, abi.GetPlane(plane_id=n)) for n in numbers)

    def _get(self, request: int, argument: Argument) -> Argument:
        self.call(request, argument)
        return argument

    def properties(self, number: int, kind: int) -> dict[str, Property]:
        counts = self.call(
            abi.GET_OBJECT_PROPERTIES, abi.ObjectProperties(obj_id=number, obj_type=kind)
        )
        numbers = _numbers(counts.count_props)
        values = (c_uint64 * max(1, counts.count_props))()
        self.call(
            abi.GET_OBJECT_PROPERTIES,
            abi.ObjectProperties(
                addressof(numbers), addressof(values), counts.count_props, number, kind
            ),
        )
        found: dict[str, Property] = {}
        for prop, value in zip(numbers, values, strict=False):
            name, names = self._describe(prop)
            found[name] = Property(prop, value, names)
        return found

    def _describe(self, number: int) -> tuple[str, dict[str, int]]:
        counts = self.call(abi.GET_PROPERTY, abi.GetProperty(prop_id=number))
        count = counts.count_enum_blobs
        if not count or counts.flags & 0x10:  # a blob's "enumeration" is none
            return counts.name.decode(), {}
        entries = bytearray(40 * count)  # drm_mode_property_enum: u64 value, char name[32]
        view = (c_uint64 * (5 * count)).from_buffer(entries)
        self.call(
            abi.GET_PROPERTY,
            abi.GetProperty(prop_id=number, enum_blob_ptr=addressof(view), count_enum_blobs=count),
        )
        return counts.name.decode(), parse_enumeration(bytes(entries))

    # Making pictures appear

    def blob(self, data: Any) -> int:
        """A property blob of a ctypes object."""
        made = self.call(abi.CREATE_BLOB, abi.CreateBlob(addressof(data), sizeof(data)))
        return int(made.blob_id)

    def drop_blob(self, number: int) -> None:
        self.call(abi.DESTROY_BLOB, abi.DestroyBlob(number))

    def add_framebuffer(self, size: tuple[int, int], handle: int, pitch: int) -> int:
        frame = abi.Framebuffer(width=size[0], height=size[1], pixel_format=abi.FORMAT_XRGB8888)
        frame.handles[0], frame.pitches[0] = handle, pitch
        return int(self.call(abi.ADD_FRAMEBUFFER2, frame).fb_id)

    def remove_framebuffer(self, number: int) -> None:
        self.call(abi.REMOVE_FRAMEBUFFER, c_int32(number))

    def commit(self, changes: Mapping[int, Mapping[int, int]], flags: int) -> None:
        """Change properties at once: object number to property number to value.

        Raises `OSError`: EBUSY while a flip is pending, EACCES without the master's right, EINVAL
        for what the hardware cannot do.
        """
        objects = (c_uint32 * len(changes))(*changes)
        counts = (c_uint32 * len(changes))(*(len(each) for each in changes.values()))
        pairs = [pair for each in changes.values() for pair in each.items()]
        numbers = (c_uint32 * len(pairs))(*(number for number, _ in pairs))
        values = (c_uint64 * len(pairs))(*(value for _, value in pairs))
        self.call(
            abi.ATOMIC,
            abi.Atomic(
                flags, len(changes), addressof(objects), addressof(counts), addressof(numbers),
                addressof(values), 0, 0,
            ),
        )  # fmt: skip

    def wait_flip(self, timeout_s: float) -> Flip | None:
        """The next flip's end, None when none comes in time."""
        poll = select.poll()
        poll.register(self.descriptor, select.POLLIN)
        if not poll.poll(timeout_s * 1000):
            return None
        return parse_flip(os.read(self.descriptor, 4096))

    def latest_vblank(self, crtc: int) -> Flip | None:
        """None where the driver has no vertical blanking to tell of, as virtual displays."""
        try:
            found = self.call(abi.CRTC_GET_SEQUENCE, abi.CrtcSequence(crtc_id=crtc))
        except OSError:
            return None
        return Flip(found.sequence_ns * 1e-9, found.sequence) if found.active else None


def parse_flip(data: bytes) -> Flip | None:
    """The last flip's end among the events read from a card."""
    flip: Flip | None = None
    offset = 0
    while offset + 8 <= len(data):
        kind, length = struct.unpack_from("=II", data, offset)
        if length > len(data) - offset:
            break
        if kind == abi.EVENT_FLIP_COMPLETE and length >= sizeof(abi.VblankEvent):
            event = abi.VblankEvent.from_buffer_copy(data, offset)
            flip = Flip(event.seconds + event.microseconds * 1e-6, event.sequence)
        offset += max(8, length)
    return flip


def parse_enumeration(data: bytes) -> dict[str, int]:
    """Names and values of an array of drm_mode_property_enum."""
    entries = struct.iter_unpack("=Q32s", data)
    return {name.split(b"\0")[0].decode(): value for value, name in entries}


def _numbers(count: int) -> Array[c_uint32]:
    return (c_uint32 * count)()


def _open_error(path: str, error: OSError) -> DeviceAbsent:
    if error.errno in (errno.EACCES, errno.EPERM):
        return DeviceAbsent(
            "PRJ-RIGHTS",
            f"the display card {path} may not be opened",
            "Put the service's user into the group video.",
        )
    return DeviceAbsent("PRJ-CARD", f"there is no display card {path}", RETRIED)


def commit_error(error: OSError) -> DeviceError:
    """What a refused commit means."""
    if error.errno == errno.EACCES:
        return DeviceLost(
            "PRJ-MASTER",
            "another program took the display over",
            "Stop it (`fuser -v /dev/dri/card*` names it). It is retried every second.",
        )
    if error.errno in (errno.ENODEV, errno.ENOENT):
        return DeviceLost("PRJ-LOST", "the display vanished", RETRIED)
    return DeviceLost(
        "PRJ-COMMIT",
        f"the display driver refuses the picture ({error.strerror})",
        "Try another mode (mode = in the projector's table); report it with `hypermask bundle`.",
    )
