"""The machine's layers on disk: packaged file, what the cart's owner changed, the last good one.

1. `configs/machines/NAME.toml`, which comes with the program;
2. every `/etc/hypermask/*.toml` in the order of their names, table by table over the first
   (`HYPERMASK_ETC` names another folder). `machine = "NAME"` in one of them chooses the first.

What cannot be used is not used: the last good configuration of a show that started takes its place
(`paths.home()/machine/last-good.toml`), or the packaged file alone where there is none yet.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from hypermask import paths
from hypermask.config import override, parse, read_toml
from hypermask.errors import ConfigError, HypermaskError
from hypermask.machine.devices import check_devices
from hypermask.machine.places import check_contents, check_places
from hypermask.machine.settings import MachineSettings
from hypermask.machine.toml import dumps
from hypermask.storage import write_atomically

DEFAULT = "cart"
SET_FILE = "90-set.toml"
CHOICE = "machine"
"""The key of `/etc/hypermask/*.toml` that names the packaged file."""

Table = dict[str, Any]
Tell = Callable[[str, str], None]
"""Called with a stable code and a sentence."""


@dataclass(frozen=True)
class Loaded:
    """origin: where `machine` comes from; problem: why not from the configured files."""

    machine: MachineSettings
    origin: Literal["configured", "last-good", "packaged"]
    problem: ConfigError | None = None


def etc() -> Path:
    return Path(os.environ.get("HYPERMASK_ETC") or "/etc/hypermask")


def last_good_path() -> Path:
    return paths.home() / "machine" / "last-good.toml"


def layer_paths() -> list[Path]:
    """The owner's files, the strongest last."""
    return sorted(path for path in etc().glob("*.toml") if not path.name.startswith("."))


def packaged_path(name: str) -> Path:
    """Raises `ConfigError` CFG-MACHINE."""
    folder = paths.configs() / "machines"
    path = folder / f"{name}.toml"
    if "/" in name or not paths.is_file(path):
        known = ", ".join(sorted(found.stem for found in folder.glob("*.toml"))) or "none"
        raise ConfigError("CFG-MACHINE", f"there is no machine '{name}'", f"Known: {known}.")
    return path


def merged() -> Table:
    """All layers in one table. Raises `ConfigError` CFG-*."""
    owner: Table = {}
    for path in layer_paths():
        owner = merge(owner, read_toml(path))
    return over_packaged(owner)


def over_packaged(owner: Table) -> Table:
    """The owner's layers over the packaged machine that they choose. Raises `ConfigError` CFG-*."""
    changes = {key: value for key, value in owner.items() if key != CHOICE}
    return merge(read_toml(packaged_path(str(owner.get(CHOICE, DEFAULT)))), changes)


def merge(base: Mapping[str, Any], change: Mapping[str, Any]) -> Table:
    """`change` over `base`, table by table. A device of another driver starts from nothing."""
    result = dict(base)
    for key, value in change.items():
        inner = result.get(key)
        if isinstance(inner, dict) and isinstance(value, dict):
            other = "driver" in value and value["driver"] != inner.get("driver")
            result[key] = dict(value) if other else merge(inner, value)
        else:
            result[key] = value
    return result


def validated(table: Table, source: str) -> MachineSettings:
    """Raises `ConfigError` CFG-*, DRV-NAME, MASK-*: also for what only the drivers know."""
    machine = parse(MachineSettings, without_devices(table), source)
    check_devices(machine, source)
    check_places(machine)
    return machine


def without_devices(table: Table) -> Table:
    """`driver = "none"` in an owner's file takes away a device of the packaged one."""
    return {
        key: value
        for key, value in table.items()
        if not (isinstance(value, dict) and value.get("driver") == "none")
    }


def source() -> str:
    """The files of the configuration, for messages."""
    names = [str(path) for path in layer_paths()]
    return " + ".join(names) if names else "the packaged configuration"


def load() -> Loaded:
    """The configuration to use. Raises `ConfigError` where not even the packaged one is good."""
    try:
        return Loaded(validated(merged(), source()), "configured")
    except ConfigError as error:
        problem = error
    try:
        path = last_good_path()
        return Loaded(validated(read_toml(path), str(path)), "last-good", problem)
    except ConfigError:
        pass
    try:
        path = packaged_path(_chosen())
        return Loaded(validated(read_toml(path), str(path)), "packaged", problem)
    except ConfigError:
        raise problem from None


def load_machine(tell: Tell) -> MachineSettings:
    """`load`, with CFG-LASTGOOD said where it is not what is configured."""
    loaded = load()
    if loaded.problem is not None:
        tell("CFG-LASTGOOD", f"CFG-LASTGOOD: {complaint(loaded)}")
    return loaded.machine


def complaint(loaded: Loaded) -> str:
    """What is wrong with the configuration and what is used in its place."""
    used = {
        "last-good": "The last good configuration is used",
        "packaged": "There is no last good configuration yet: the packaged one is used",
    }.get(loaded.origin, "")
    return f"the configuration cannot be used ({loaded.problem}) {used}."


def keep_good(machine: MachineSettings) -> bool:
    """Remember a configuration with which a show started; False when it was so already.

    Raises `HypermaskError` DISK-WRITE.
    """
    data = dumps(machine.model_dump(mode="json", exclude_unset=True)).encode()
    path = last_good_path()
    try:
        if path.read_bytes() == data:
            return False
    except OSError:
        pass
    write_atomically(path, data)
    return True


def set_value(
    assignment: str, check: Callable[[MachineSettings], object] = lambda machine: None
) -> MachineSettings:
    """`table.key=value` into `/etc/hypermask/90-set.toml`, if all together is then still good.

    check: raises what else may be wrong.
    Raises `ConfigError` CFG-*, MASK-*, SET-FORM, SET-OVERRULED, SET-RIGHTS; `HypermaskError`
    DISK-WRITE.
    """
    path = etc() / SET_FILE
    changed = override(read_toml(path) if path.is_file() else {}, [assignment])
    layers = sorted({*layer_paths(), path})
    owner: Table = {}
    for layer in layers:
        owner = merge(owner, changed if layer == path else read_toml(layer))
    _check_holds(owner, changed, assignment, [layer.name for layer in layers if layer > path])
    table = over_packaged(owner)
    machine = validated(table, f"{source()} with {assignment}")
    check_contents(machine)
    check(machine)
    try:
        write_atomically(path, dumps(changed).encode())
    except HypermaskError as error:
        if not os.access(etc(), os.W_OK):
            raise ConfigError(
                "SET-RIGHTS", f"you may not write into {etc()}", "Become root (sudo)."
            ) from error
        raise
    return machine


def _chosen() -> str:
    """The machine's name as far as the owner's files can be read."""
    name = DEFAULT
    for path in layer_paths():
        try:
            name = str(read_toml(path).get(CHOICE, name))
        except ConfigError:
            continue
    return name


def _check_holds(owner: Table, changed: Table, assignment: str, later: list[str]) -> None:
    """Raises `ConfigError` SET-OVERRULED where a later file has another value."""
    key = assignment.partition("=")[0].strip()
    if _at(owner, key) != _at(changed, key):
        raise ConfigError(
            "SET-OVERRULED",
            f"{' or '.join(later)} has another value of {key}, and comes after {SET_FILE}",
            "Change it there.",
        )


def _at(table: Table, key: str) -> Any:
    found: Any = table
    for part in key.split("."):
        found = found.get(part) if isinstance(found, dict) else None
    return found
