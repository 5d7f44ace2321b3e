"""From a device's table in the machine file to the device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hypermask.config import Settings, parse
from hypermask.errors import ConfigError
from hypermask.machine.settings import DEVICES, DeviceTable, MachineSettings
from hypermask_drivers.clock import Clock
from hypermask_drivers.device import Device
from hypermask_drivers.registry import driver_class, settings_class

if TYPE_CHECKING:
    from hypermask_sim.world import World

SIMULATED = "sim"


class NoSettings(Settings):
    """A simulated device has none: its scenario says everything."""


def check_devices(machine: MachineSettings, source: str) -> None:
    """Raises `ConfigError` DRV-NAME, CFG-KEY, CFG-VALUE, CFG-SCENARIO."""
    simulated = []
    for kind in DEVICES:
        table = machine.device(kind)
        if table is not None:
            device_settings(kind, table, source)
            simulated += [kind] if table.driver == SIMULATED else []
    if simulated and not machine.scenario:
        raise ConfigError(
            "CFG-SCENARIO",
            f"the {simulated[0]} is simulated, but no scenario is named",
            'Set scenario = "reference-cart" or another driver.',
        )


def device_settings(kind: str, table: DeviceTable, source: str = "the machine file") -> Settings:
    """The driver's own settings. Raises `ConfigError` DRV-NAME, CFG-KEY, CFG-VALUE."""
    model = settings_class(kind, table.driver) or NoSettings
    return parse(model, table.own, f"{source}, [{kind}]")


def make_device(kind: str, table: DeviceTable, clock: Clock, world: World | None) -> Device:
    """Not opened yet. world: of the simulated devices. Raises `ConfigError` as the above."""
    cls: Any = driver_class(kind, table.driver)
    if table.driver == SIMULATED:
        assert world is not None
        device: Device = cls(world, clock)
    else:
        device = cls(device_settings(kind, table), clock)
    return device
