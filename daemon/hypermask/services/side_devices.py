"""The show service's slow devices, from the machine file."""

from __future__ import annotations

from hypermask.machine.settings import MachineSettings
from hypermask.services.rig import Rig
from hypermask.workers.devices import SideDevices, UsbCare
from hypermask.workers.health import Healths
from hypermask.workers.thermal import read_heat
from hypermask_drivers.lamp import Lamp
from hypermask_drivers.power import Power

USUAL = {"camera": "/dev/hypermask/camera", "pantilt": "/dev/hypermask/ptu"}


def side_devices(rig: Rig) -> SideDevices:
    lamp, power = rig.device("lamp"), rig.device("power")
    assert lamp is None or isinstance(lamp, Lamp)
    assert power is None or isinstance(power, Power)
    return SideDevices(
        rig.board,
        rig.clock,
        rig.report,
        lamp=lamp,
        power=power,
        usb_care=_usb_care(rig),
        heat=read_heat,
    )


def _usb_care(rig: Rig) -> UsbCare | None:
    folder = rig.board.folder
    if folder is None:
        return None
    healths = Healths(folder)

    def faults() -> dict[str, str]:
        """Of the workers whose device is not there, why it is not."""
        return {
            name: bytes(record["fault"].item()).decode(errors="replace")
            for name, record in healths.all().items()
            if not record["ready"]
        }

    return UsbCare(faults, nodes_of(rig.machine))


def nodes_of(machine: MachineSettings) -> dict[str, str]:
    """Device nodes of what may hang at a USB port; not of simulated devices."""
    nodes = {}
    for kind, usual in USUAL.items():
        table = machine.device(kind)
        if table is not None and table.driver != "sim":
            nodes[kind] = str(table.own.get("device", usual))
    return nodes
