"""How the contract tests get at a device: one rig an implementation.

A rig gives a device and takes the hardware away and back. A real driver joins by a rig of its own
over its emulator, added to `RIGS`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from hypermask_drivers.clock import Clock, VirtualClock
from hypermask_drivers.device import Device
from hypermask_drivers.registry import driver_class
from hypermask_drivers.sound.alsa import AlsaSettings, AlsaSoundIn
from hypermask_sim.emulators.alsa import EmulatedAlsa, EmulatedCard
from hypermask_sim.faults import LOSSES
from hypermask_sim.scenario import Scenario
from hypermask_sim.world import World


class Rig(ABC):
    device: Device
    clock: Clock

    @abstractmethod
    def wait(self, seconds: float) -> None:
        """Let time pass."""

    @abstractmethod
    def lose(self) -> None:
        """Take the hardware away."""

    @abstractmethod
    def bring_back(self) -> None: ...


class SimRig(Rig):
    """Under a virtual clock that starts late: devices may not take 0 for the scenario's start.

    The hardware is away from 10 to 20 s of the scenario.
    """

    def __init__(self, kind: str) -> None:
        faults = [{"kind": LOSSES[kind], "from_s": 10.0, "to_s": 20.0}]
        performer = {"keys": [[1.0, "5"], [12.0, "7"]], "motion": "walk"}
        scenario = Scenario.model_validate({"faults": faults, "performer": performer})
        self._origin_s = 1000.0
        self.clock = VirtualClock(self._origin_s)
        world = World(scenario, self._origin_s)
        self.device = driver_class(kind, "sim")(world, self.clock)  # type: ignore[call-arg]

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)

    def lose(self) -> None:
        self.clock.sleep_until(self._origin_s + 10.5)

    def bring_back(self) -> None:
        self.clock.sleep_until(self._origin_s + 20.5)


class AlsaRig(Rig):
    """The ALSA driver on an emulated card."""

    def __init__(self) -> None:
        self.clock = VirtualClock(1000.0)
        self.card = EmulatedCard(self.clock)
        self.device = AlsaSoundIn(
            AlsaSettings(device="hw:CARD=hypermask_mic"), self.clock, EmulatedAlsa([self.card])
        )

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)

    def lose(self) -> None:
        self.card.unplug()

    def bring_back(self) -> None:
        self.card.unplug()
        self.card.plug()


RIGS: dict[str, dict[str, Callable[[], Rig]]] = {
    kind: {"sim": lambda kind=kind: SimRig(kind)}  # type: ignore[misc]
    for kind in LOSSES
}
RIGS["sound"]["alsa"] = AlsaRig


def implementations(kind: str) -> list[str]:
    return list(RIGS[kind])
