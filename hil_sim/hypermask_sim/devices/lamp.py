"""The simulated lamp: light and power of the projector."""

from __future__ import annotations

import math

from hypermask_drivers.clock import Clock
from hypermask_drivers.errors import DeviceError
from hypermask_drivers.lamp import Lamp, LampState
from hypermask_sim.devices.base import SimDevice
from hypermask_sim.world import World

_ROOM_C, _HOT_C, _WARM_UP_S = 22.0, 58.0, 120.0


class SimLamp(SimDevice, Lamp):
    """Its temperature follows the light with a time constant of two minutes."""

    kind, code, noun = "lamp", "LMP", "lamp"

    def __init__(self, world: World, clock: Clock) -> None:
        super().__init__(world, clock)
        self._on = False
        self._brightness = 1.0
        self._temperature_c = _ROOM_C
        self._since_s = 0.0

    def _settle(self, now_s: float) -> None:
        """Bring the temperature up to now, before what drives it changes."""
        target = _ROOM_C + (_HOT_C - _ROOM_C) * (self._brightness if self._on else 0.0)
        share = math.exp(-max(0.0, now_s - self._since_s) / _WARM_UP_S)
        self._temperature_c = target + (self._temperature_c - target) * share
        self._since_s = now_s

    def set_power(self, on: bool) -> None:
        self._settle(self._check())
        self._on = on

    def set_brightness(self, brightness: float) -> None:
        now = self._check()
        if not 0 <= brightness <= 1:
            raise DeviceError(
                "LAMP-RANGE", f"a brightness of {brightness} is not possible", "Give 0 to 1."
            )
        self._settle(now)
        self._brightness = brightness

    def read(self) -> LampState:
        self._settle(self._check())
        return LampState(self._on, self._brightness, self._temperature_c)
