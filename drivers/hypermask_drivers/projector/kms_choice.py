"""Which card, which of its connectors and which of a display's modes: as asked for, else as before.

A display that was away for a moment is not exchanged for the operator's own, and a projector that
tells its modes late or not all at once does not change the size of the picture in mid-show.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from hypermask_drivers.clock import Clock
from hypermask_drivers.errors import DeviceAbsent, DeviceError
from hypermask_drivers.projector import drm_abi as abi
from hypermask_drivers.projector.drm_card import RETRIED, Card, Connector
from hypermask_drivers.projector.drm_modes import choose, like
from hypermask_drivers.projector.kms_output import card_paths, find_connector

if TYPE_CHECKING:
    from hypermask_drivers.projector.kms_settings import KmsSettings

_PATIENCE_S = 5.0


class Choice:
    """What the settings leave open is remembered by `keep`, once a picture was shown."""

    def __init__(
        self, settings: KmsSettings, clock: Clock, open_card: Callable[[str], Card]
    ) -> None:
        self._settings, self._clock, self._open = settings, clock, open_card
        self._path: str | None = None
        self._connector: str | None = None
        self._timing: abi.ModeInfo | None = None
        self._missing_s: float | None = None  # since when the earlier size is not offered

    def keep(self, card: Card, connector: Connector, timing: abi.ModeInfo) -> None:
        self._path, self._connector, self._timing = card.path, connector.name, timing
        self._missing_s = None

    def card(self) -> Card:
        """Opened: the earlier one, else the first with a display, else the first of use.

        Raises `DeviceAbsent` PRJ-CARD, PRJ-RIGHTS, PRJ-MASTER, PRJ-ATOMIC, PRJ-PLUG.
        """
        paths = sorted(card_paths(self._settings.card), key=lambda path: path != self._path)
        problem: DeviceError = DeviceAbsent("PRJ-CARD", "there is no display card", RETRIED)
        without: Card | None = None
        for path in paths:
            try:
                card, wanted = self._usable(path)
            except DeviceAbsent as error:
                problem = error
                continue
            if wanted:
                _close(without)
                return card
            if without is None:
                without = card
            else:
                card.close()
        if without is None:
            raise problem
        return without

    def _usable(self, path: str) -> tuple[Card, bool]:
        """An open card with a connector, and whether it is the one to take."""
        card = self._open(path)
        try:
            connector = self.connector(card)
        except DeviceAbsent:
            card.close()
            raise
        except OSError as error:
            card.close()
            raise DeviceAbsent("PRJ-CARD", f"{path} vanished", RETRIED) from error
        earlier = path == self._path and connector.name == self._connector
        return card, earlier or bool(connector.connected)

    def connector(self, card: Card) -> Connector:
        """Raises `DeviceAbsent` PRJ-PLUG."""
        wanted = self._settings.connector
        if wanted is None and self._connector is not None:
            with contextlib.suppress(DeviceAbsent):  # PRJ-PLUG: it is another card
                return find_connector(card, self._connector)
        return find_connector(card, wanted)

    def timing(self, connector: Connector) -> abi.ModeInfo:
        """Raises `DeviceAbsent` PRJ-SIZE, PRJ-ABSENT; `ConfigError` PRJ-MODE."""
        modes, wanted, force = connector.modes, self._settings.mode, self._settings.force
        if wanted is None and self._timing is not None:
            found = like(modes, self._timing, force and not modes)
            if found is not None:
                return found
            self._be_patient(connector.name, self._timing)
        timing = choose(modes, wanted, force)
        if timing is None:
            offered = sorted({f"{mode.hdisplay}x{mode.vdisplay}" for mode in modes})
            raise DeviceAbsent(
                "PRJ-SIZE",
                f"the display has no mode {wanted or ''}".rstrip(),
                f"It has: {', '.join(offered) or 'none'}. Choose one, or set force = true.",
            )
        return timing

    def _be_patient(self, name: str, earlier: abi.ModeInfo) -> None:
        now_s = self._clock.now()
        if self._missing_s is None:
            self._missing_s = now_s
        if now_s - self._missing_s < _PATIENCE_S:
            raise DeviceAbsent(
                "PRJ-ABSENT",
                f"the display on {name} does not offer {earlier.hdisplay}x{earlier.vdisplay} again",
                f"Its own size is taken after {_PATIENCE_S:.0f} s.",
            )

    def again(self, modes: Sequence[abi.ModeInfo]) -> abi.ModeInfo:
        """For a display that is back while the picture goes on, so of the same size."""
        assert self._timing is not None
        if self._settings.mode is not None:
            asked = choose(modes, self._settings.mode, self._settings.force)
            if asked is not None and _size(asked) == _size(self._timing):
                return asked
        same = like(modes, self._timing, True)
        assert same is not None
        return same


def _size(timing: abi.ModeInfo) -> tuple[int, int]:
    return timing.hdisplay, timing.vdisplay


def _close(card: Card | None) -> None:
    if card is not None:
        card.close()
