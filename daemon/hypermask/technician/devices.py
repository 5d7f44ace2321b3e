"""The machine's devices by kind: what is configured, who holds it, whether it is there."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hypermask.blackboard import Record
from hypermask.errors import HypermaskError, UsageError
from hypermask.machine.devices import SIMULATED, device_settings
from hypermask.machine.files import load
from hypermask.machine.settings import DEVICES, MachineSettings
from hypermask.technician.crew import OWNS, alive, text
from hypermask.workers.board import Board
from hypermask.workers.health import Health, Healths
from hypermask_drivers.clock import RealClock
from hypermask_drivers.device import Device

SHOWS_OWN = ("keypad", "lamp", "power")
"""Held by the show worker, which can be asked about them."""


@dataclass(frozen=True)
class Entry:
    """place: where it is looked for; state: ready, away (its worker waits for it), free (nobody
    holds it), none (not in this machine)."""

    kind: str
    driver: str
    place: str
    present: bool | None
    state: str
    holder: str


def entries(machine: MachineSettings | None = None) -> list[Entry]:
    """Every kind of device, also those that this machine does not have."""
    machine = machine or load().machine
    holders = _holders()
    return [_entry(kind, machine, holders) for kind in DEVICES]


def _entry(kind: str, machine: MachineSettings, holders: dict[str, Record]) -> Entry:
    table = machine.device(kind)
    if table is None:
        return Entry(kind, "-", "-", None, "none", "-")
    place, present = place_of(kind, machine)
    holder = holder_of(kind, holders)
    if not holder:
        return Entry(kind, table.driver, place, present, "free", "-")
    if kind in ("lamp", "power"):
        return Entry(kind, table.driver, place, present, _side_state(kind), holder)
    state = "ready" if holders[holder]["ready"] else "away"
    return Entry(kind, table.driver, place, present, state, holder)


def place_of(kind: str, machine: MachineSettings) -> tuple[str, bool | None]:
    """Where a device is looked for, and whether the system has it; None where only opening tells.

    Raises `ConfigError` DRV-NAME, CFG-*.
    """
    table = machine.device(kind)
    if table is None or table.driver == SIMULATED:
        return "-", None
    settings = device_settings(kind, table)
    for key in ("device", "card", "port"):
        value = getattr(settings, key, None)
        if isinstance(value, str) and value:
            there = Path(value).exists() if value.startswith("/") else None
            return value, there
    return "found by itself", None


def _holders() -> dict[str, Record]:
    """Health of the workers that live, by name."""
    from hypermask.workers.running import running_board

    try:
        healths = Healths(running_board()).all()
    except HypermaskError:
        return {}
    return {
        name: record
        for name, record in healths.items()
        if text(record["state"]) != "stopped" and alive(int(record["pid"]))
    }


def holder_of(kind: str, holders: dict[str, Record]) -> str:
    """The running worker that holds a kind of device, empty when nobody does."""
    name = next((name for name, owned in OWNS.items() if owned == kind), "show")
    if kind in ("projector", "pantilt") and "safe" in holders:
        return "safe"
    return name if name in holders else ""


def _side_state(kind: str) -> str:
    from hypermask.workers.running import running_board

    record = Board.reading(running_board()).machine.latest()
    return "away" if record is None or text(record[kind]) != "ready" else "ready"


def check_kind(kind: str) -> str:
    """Raises `UsageError` DEV-KIND."""
    if kind not in DEVICES:
        raise UsageError(
            "DEV-KIND", f"there is no kind of device '{kind}'", f"Kinds: {', '.join(DEVICES)}."
        )
    return kind


@contextlib.contextmanager
def opened(kind: str, machine: MachineSettings | None = None) -> Iterator[Device]:
    """A device of this machine, open for as long as the block lasts.

    Raises `HypermaskError` DEV-NONE, DEV-HELD, `DeviceError` what opening it raises.
    """
    from hypermask.services.rig import MachineRig

    machine = machine or load().machine
    if machine.device(kind) is None:
        raise HypermaskError(
            "DEV-NONE",
            f"the machine '{machine.name}' has no {kind}",
            f"Give it one: [{kind}] in /etc/hypermask (see hypermask config show).",
        )
    holder = holder_of(kind, _holders())
    if holder:
        raise HypermaskError(
            "DEV-HELD",
            f"the {kind} is held by the worker '{holder}' of the running show",
            "Its figures are in `hypermask status`. To test it alone, stop the show: "
            "systemctl stop hypermask.target.",
        )
    clock = RealClock()
    rig = MachineRig(
        machine, Board.local(), lambda time_s, code, what: None, Health(None, "technician", clock)
    )
    device = rig.device(kind)
    assert device is not None
    try:
        device.open()
        yield device
    finally:
        device.close()


def asks_the_show(kind: str) -> bool:
    """Whether a running show is asked about this device, because it holds it."""
    return kind in SHOWS_OWN and bool(holder_of(kind, _holders()))
