"""The simulated battery monitor: a lead-acid battery that a steady current empties."""

from __future__ import annotations

from hypermask_drivers.power import Power, PowerReading
from hypermask_sim.devices.base import SimDevice


class SimPower(SimDevice, Power):
    """The open-circuit voltage falls in proportion to the charge; the load takes I * R off it."""

    kind, code, noun = "power", "PWR", "battery monitor"

    def read(self) -> PowerReading:
        now = self._check()
        settings = self.world.scenario.power
        used = settings.current_a * now / 3600 / settings.capacity_ah
        charge = max(0.0, settings.charge - used)
        current = settings.current_a if charge > 0 else 0.0
        open_v = settings.empty_v + (settings.full_v - settings.empty_v) * charge
        voltage = open_v - current * settings.resistance_ohm
        return PowerReading(voltage, current, charge, now + self.world.origin_s)
