"""What the machine file names by name or path: the mask and the simulated devices' scenario."""

from __future__ import annotations

from pathlib import Path

from hypermask import paths
from hypermask.errors import ConfigError
from hypermask.machine.devices import SIMULATED
from hypermask.machine.settings import DEVICES, MachineSettings
from hypermask.mask import load_mask, load_mask_settings


def mask_folder(name: str) -> Path:
    """A folder as it is, or the one of that name in configs/masks. Raises `ConfigError`
    MASK-ABSENT."""
    for folder in (Path(name), paths.configs() / "masks" / name):
        if paths.is_file(folder / "mask.toml"):
            return folder
    raise ConfigError(
        "MASK-ABSENT",
        f"there is no mask '{name}'",
        f"Correct the machine's 'mask'.{paths.hint(name)}",
    )


def scenario_path(name: str) -> Path:
    """A path as it is, or the scenario of that name. Raises `ConfigError` CFG-ABSENT."""
    for path in (Path(name), paths.configs() / "scenarios" / f"{name}.toml"):
        if paths.is_file(path):
            return path
    raise ConfigError(
        "CFG-ABSENT",
        f"there is no scenario '{name}'",
        f"Correct the machine's 'scenario'.{paths.hint(name)}",
    )


def check_places(machine: MachineSettings) -> None:
    """That what is named is there, as far as a start has time for it. Raises `ConfigError`
    MASK-ABSENT, MASK-LEDS, CFG-*."""
    load_mask_settings(mask_folder(machine.mask))
    if _is_simulated(machine):
        scenario_path(machine.scenario)


def check_contents(machine: MachineSettings) -> None:
    """That it can be used as well. Raises `ConfigError` as `check_places`, and MASK-RELIEF."""
    load_mask(mask_folder(machine.mask))
    if _is_simulated(machine):
        from hypermask_sim.scenario import load_scenario

        load_scenario(scenario_path(machine.scenario))


def _is_simulated(machine: MachineSettings) -> bool:
    tables = (machine.device(kind) for kind in DEVICES)
    return any(table is not None and table.driver == SIMULATED for table in tables)
