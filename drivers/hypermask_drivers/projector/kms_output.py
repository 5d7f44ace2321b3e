"""The way of a picture through a card: connector, CRTC and plane, and its mode settings."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from ctypes import c_uint32
from pathlib import Path

import numpy as np

from hypermask_drivers.errors import DeviceAbsent, DeviceError
from hypermask_drivers.projector import drm_abi as abi
from hypermask_drivers.projector.drm_card import RETRIED, Card, Connector, Property, commit_error

Changes = dict[int, dict[int, int]]

_UPRIGHT, _OPAQUE = 1, 0xFFFF
"""DRM_MODE_ROTATE_0 as a bit mask, and the whole of a plane's alpha."""


def card_paths(wanted: str | None, root: Path = Path("/dev/dri")) -> list[str]:
    """The cards to try: the one asked for, or all, by the names that stay the same."""
    if wanted is not None:
        return [wanted]
    stable = sorted(root.glob("by-path/*-card"))
    return [str(path) for path in stable or sorted(root.glob("card*"))]


def find_connector(card: Card, wanted: str | None) -> Connector:
    """The connector asked for, else the first with a display. Raises `DeviceAbsent` PRJ-PLUG."""
    connectors = [card.connector(number) for number in card.resources()[1]]
    connectors = [each for each in connectors if not each.name.startswith("Writeback")]
    if wanted is not None:
        named = [each for each in connectors if each.name == wanted]
        if not named:
            there = ", ".join(each.name for each in connectors) or "none"
            raise DeviceAbsent(
                "PRJ-PLUG", f"the card has no connector {wanted}", f"It has: {there}."
            )
        return named[0]
    if not connectors:
        raise DeviceAbsent("PRJ-PLUG", "the card has no connector", "Name another card.")
    return next((each for each in connectors if each.connected), connectors[0])


class Output:
    """The CRTC and the primary plane for a connector, with their properties by name."""

    def __init__(self, card: Card, connector: Connector) -> None:
        """Raises `DeviceAbsent` PRJ-ROUTE when every way is taken."""
        self._card = card
        self.connector = connector
        self.crtc, self.plane = self._route()
        self._of_connector = card.properties(connector.number, abi.OBJECT_CONNECTOR)
        self._of_crtc = card.properties(self.crtc, abi.OBJECT_CRTC)
        self._of_plane = card.properties(self.plane, abi.OBJECT_PLANE)
        self._mode_blob: int | None = None
        self._lut_blob: int | None = None

    def release(self) -> None:
        """Give back what the card keeps for this; what is shown stays."""
        for blob in (self._mode_blob, self._lut_blob):
            if blob is not None:
                with contextlib.suppress(OSError):
                    self._card.drop_blob(blob)
        self._mode_blob = self._lut_blob = None

    def _route(self) -> tuple[int, int]:
        crtcs, _ = self._card.resources()
        for index, crtc in self._reachable(crtcs):
            for plane in self._card.planes():
                if plane.possible_crtcs & 1 << index and self._is_primary(plane.plane_id):
                    return crtc, plane.plane_id
        raise DeviceAbsent(
            "PRJ-ROUTE", f"nothing can drive {self.connector.name}", "Unplug other displays."
        )

    def _reachable(self, crtcs: tuple[int, ...]) -> Iterator[tuple[int, int]]:
        """CRTCs of the connector: the one in use first, so that nothing else is disturbed."""
        encoders = [self._card.encoder(number) for number in self.connector.encoders]
        using = {each.crtc_id for each in encoders if each.encoder_id == self.connector.encoder}
        possible = [
            (index, crtc)
            for index, crtc in enumerate(crtcs)
            if any(each.possible_crtcs & 1 << index for each in encoders)
        ]
        yield from sorted(possible, key=lambda pair: pair[1] not in using)

    def _is_primary(self, plane: int) -> bool:
        kind = self._card.properties(plane, abi.OBJECT_PLANE).get("type")
        return kind is not None and kind.value == kind.names.get("Primary")

    # Commits

    def switch_on(self, mode: abi.ModeInfo, frame: int) -> None:
        """Set the mode with a framebuffer as it is, and nothing else on the screen. Waits.

        Raises `DeviceLost` PRJ-*.
        """
        if self._mode_blob is not None:
            self._card.drop_blob(self._mode_blob)
        self._mode_blob = self._card.blob(mode)
        changes = self._detach_others()
        width, height = mode.hdisplay, mode.vdisplay
        _put(changes, self.connector.number, self._of_connector, {"CRTC_ID": self.crtc})
        if "link-status" in self._of_connector:  # a link that broke is tried anew
            _put(changes, self.connector.number, self._of_connector, {"link-status": 0})
        _put(changes, self.crtc, self._of_crtc, {"MODE_ID": self._mode_blob, "ACTIVE": 1})
        _put(changes, self.plane, self._of_plane, {
            "FB_ID": frame, "CRTC_ID": self.crtc, "CRTC_X": 0, "CRTC_Y": 0,
            "CRTC_W": width, "CRTC_H": height, "SRC_X": 0, "SRC_Y": 0,
            "SRC_W": width << 16, "SRC_H": height << 16,
        })  # fmt: skip
        self._put_plain(changes)
        self._commit(changes, abi.ATOMIC_ALLOW_MODESET)

    def _put_plain(self, changes: Changes) -> None:
        """Undo what a program before left: its colours, a picture turned or shone through."""
        for name, blob in (("GAMMA_LUT", self._lut_blob), ("DEGAMMA_LUT", 0), ("CTM", 0)):
            if name in self._of_crtc:
                _put(changes, self.crtc, self._of_crtc, {name: blob or 0})
        for name, value in (("rotation", _UPRIGHT), ("alpha", _OPAQUE)):
            found = self._of_plane.get(name)
            if found is not None and found.value != value:
                _put(changes, self.plane, self._of_plane, {name: value})

    def switch_off(self) -> None:
        """No signal on the connector. Raises `DeviceLost` PRJ-*."""
        changes: Changes = {}
        _put(changes, self.connector.number, self._of_connector, {"CRTC_ID": 0})
        _put(changes, self.crtc, self._of_crtc, {"MODE_ID": 0, "ACTIVE": 0})
        _put(changes, self.plane, self._of_plane, {"FB_ID": 0, "CRTC_ID": 0})
        self._commit(changes, abi.ATOMIC_ALLOW_MODESET)

    def flip(self, frame: int) -> None:
        """Show a framebuffer at the next vertical blanking; an event tells when. Does not wait.

        Raises `OSError`.
        """
        self._card.commit(
            {self.plane: {self._of_plane["FB_ID"].number: frame}},
            abi.ATOMIC_NONBLOCK | abi.PAGE_FLIP_EVENT,
        )

    def set_curve(self, brightness: float, gamma: float) -> bool:
        """Brightness and gamma of everything shown; False where the hardware has no such table."""
        size = self._of_crtc.get("GAMMA_LUT_SIZE")
        if size is None or "GAMMA_LUT" not in self._of_crtc or size.value < 2:
            return False
        blob = self._card.blob(curve(size.value, brightness, gamma))
        number = self._of_crtc["GAMMA_LUT"].number
        try:
            self._card.commit({self.crtc: {number: blob}}, abi.ATOMIC_ALLOW_MODESET)
        except OSError:
            self._card.drop_blob(blob)
            return False
        if self._lut_blob is not None:
            self._card.drop_blob(self._lut_blob)
        self._lut_blob = blob
        return True

    def _detach_others(self) -> Changes:
        """What else is on our CRTC: mirrored connectors, cursors, another plane's picture."""
        changes: Changes = {}
        for number in self._card.resources()[1]:
            found = self._card.properties(number, abi.OBJECT_CONNECTOR)
            using = found.get("CRTC_ID")
            if number != self.connector.number and using and using.value == self.crtc:
                _put(changes, number, found, {"CRTC_ID": 0})
        for plane in self._card.planes():
            if plane.plane_id != self.plane and plane.crtc_id == self.crtc:
                found = self._card.properties(plane.plane_id, abi.OBJECT_PLANE)
                _put(changes, plane.plane_id, found, {"FB_ID": 0, "CRTC_ID": 0})
        return changes

    def _commit(self, changes: Changes, flags: int) -> None:
        try:
            self._card.commit(changes, flags)
        except OSError as error:
            raise commit_error(error) from error


def _put(changes: Changes, number: int, found: dict[str, Property], values: dict[str, int]) -> None:
    """Raises `DeviceError` PRJ-ATOMIC for a driver without one of the properties."""
    for name, value in values.items():
        if name not in found:
            raise DeviceError(
                "PRJ-ATOMIC", f"the display driver has no property {name}", f"Update it. {RETRIED}"
            )
        changes.setdefault(number, {})[found[name].number] = value


def curve(size: int, brightness: float, gamma: float) -> object:
    """A CRTC's table of `size` entries: brightness * x ** gamma, the same for the three colours."""
    level = np.linspace(0.0, 1.0, size) ** gamma * min(max(brightness, 0.0), 1.0)
    table = np.zeros((size, 4), np.uint16)
    table[:, :3] = np.round(level * 65535)[:, None]
    return (c_uint32 * (2 * size)).from_buffer_copy(table.tobytes())
