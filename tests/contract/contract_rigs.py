"""How the contract tests get at a device: one rig an implementation.

A rig gives a device and takes the hardware away and back. A real driver joins by a rig of its own
over its emulator, added to `RIGS`.
"""

from __future__ import annotations

import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path

from hypermask_drivers.camera.v4l2 import V4l2Camera
from hypermask_drivers.clock import Clock, VirtualClock
from hypermask_drivers.device import Device
from hypermask_drivers.keypad.i2c_pads import MatrixSettings, Pcf8574Pad, Tca8418Pad
from hypermask_drivers.keypad.layout import MATRIX_4X4
from hypermask_drivers.keypad.usb_pad import UsbPad
from hypermask_drivers.lamp.dlpc34xx import Dlpc34xxLamp, Dlpc34xxSettings
from hypermask_drivers.pantilt.ptu import DirectedPerceptionPtu, PtuSettings
from hypermask_drivers.power.ina2xx import Ina2xxSettings, Ina219, Ina226
from hypermask_drivers.projector.kms import KmsProjector
from hypermask_drivers.projector.kms_settings import KmsSettings
from hypermask_drivers.registry import driver_class
from hypermask_drivers.sound.alsa import AlsaSettings, AlsaSoundIn
from hypermask_sim.display_emulator import EmulatedDisplay, OffscreenBuffers
from hypermask_sim.emulators.alsa import EmulatedAlsa, EmulatedCard
from hypermask_sim.emulators.i2c import Chip, Wires
from hypermask_sim.emulators.i2c_keypad import Pcf8574Matrix, Tca8418Chip
from hypermask_sim.emulators.i2c_lamp import Dlpc34xxChip
from hypermask_sim.emulators.i2c_power import Ina219Chip, Ina226Chip
from hypermask_sim.emulators.keypad import EmulatedHid, EmulatedPad, Fingers
from hypermask_sim.emulators.ptu import PtuData, PtuUnit
from hypermask_sim.emulators.ptu_line import PtuLine
from hypermask_sim.faults import LOSSES
from hypermask_sim.scenario import Scenario
from hypermask_sim.video_emulator import EmulatedVideoSystem
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


class PtuRig(Rig):
    """The driver of real pan-tilt units, over a pty, with an emulated unit that takes no time to
    answer but its time to move."""

    def __init__(self) -> None:
        self.clock = VirtualClock(1000.0)
        self._folder = tempfile.TemporaryDirectory()
        link = Path(self._folder.name) / "ptu"
        self.line = PtuLine(PtuUnit(PtuData(baud=None)), self.clock, link)
        self.line.plug()
        settings = PtuSettings(device=str(link))
        self.device = DirectedPerceptionPtu(settings, self.clock, self.line.connect)

    def wait(self, seconds: float) -> None:
        self.line.catch_up()
        self.clock.sleep_until(self.clock.now() + seconds)
        self.line.settle()

    def lose(self) -> None:
        self.line.unplug()

    def bring_back(self) -> None:
        self.line.unplug()
        self.line.plug()

    def __del__(self) -> None:
        self.device.close()
        self.line.close()


BUS = "/dev/i2c-1"


class I2cRig(Rig):
    """A chip at register level, and the driver of the real one. `power_cycle` of the chip is what
    a loss that nobody saw leaves behind."""

    def __init__(self, address: int, chip: Chip) -> None:
        self.clock = VirtualClock(1000.0)
        self.chip = chip
        self.wires = Wires({address: chip}, BUS)

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)

    def lose(self) -> None:
        self.wires.present = False

    def bring_back(self) -> None:
        self.chip.power_cycle()  # type: ignore[attr-defined]
        self.wires.present = True


def fingers(clock: Clock) -> Fingers:
    """The same keys at the same times as in `SimRig`."""
    found = Fingers(clock)
    found.press("5", 1001.0)
    found.press("7", 1012.0)
    return found


class UsbPadRig(Rig):
    def __init__(self) -> None:
        self.clock = VirtualClock(1000.0)
        self.pad = EmulatedPad(fingers(self.clock))
        self.device = UsbPad(None, self.clock, EmulatedHid(self.pad))

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)

    def lose(self) -> None:
        self.clock.sleep_until(1010.5)
        self.pad.unplug()

    def bring_back(self) -> None:
        self.clock.sleep_until(1020.5)
        self.pad.plug()


class MatrixPadRig(I2cRig):
    """Looked at every 5 ms, as a worker does, because a matrix has no memory."""

    device: Pcf8574Pad | Tca8418Pad

    def __init__(
        self, driver: type[Pcf8574Pad | Tca8418Pad], chip: type[Pcf8574Matrix | Tca8418Chip]
    ) -> None:
        address = driver._default_address
        clock = VirtualClock(1000.0)
        super().__init__(address, chip(fingers(clock), MATRIX_4X4))
        self.clock = clock
        self.device = driver(MatrixSettings(device=BUS), self.clock, self.wires.connect)

    def wait(self, seconds: float) -> None:
        end_s = self.clock.now() + seconds
        while self.clock.now() < end_s:
            super().wait(min(0.005, end_s - self.clock.now()))
            self.device.poll()

    def bring_back(self) -> None:
        self.clock.sleep_until(1020.5)
        super().bring_back()


class LampRig(I2cRig):
    def __init__(self) -> None:
        super().__init__(0x1B, Dlpc34xxChip())
        self.device = Dlpc34xxLamp(Dlpc34xxSettings(device=BUS), self.clock, self.wires.connect)


class PowerRig(I2cRig):
    def __init__(self, driver: type[Ina219 | Ina226], chip: type[Ina219Chip | Ina226Chip]) -> None:
        super().__init__(0x40, chip(lambda: (12.4, 5.0), 0.01))
        settings = Ina2xxSettings(device=BUS, shunt_ohm=0.01, most_a=8.0)
        self.device = driver(settings, self.clock, self.wires.connect)


class V4l2Rig(Rig):
    """The driver for V4L2 over a video device made of Python."""

    def __init__(self) -> None:
        self.clock = VirtualClock(1000.0)
        self._system = EmulatedVideoSystem(self.clock)
        self.device = V4l2Camera(clock=self.clock, system=self._system)

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)

    def lose(self) -> None:
        self._system.unplug()

    def bring_back(self) -> None:
        self._system.plug()


class KmsRig(Rig):
    """The driver for KMS over a display card made of Python."""

    def __init__(self) -> None:
        self.clock = VirtualClock(1000.0)
        self._display = EmulatedDisplay(self.clock)
        settings = KmsSettings(card="/dev/dri/card0", silence_console=False)
        self.device = KmsProjector(
            settings,
            self.clock,
            self._display.open,  # type: ignore[arg-type]
            OffscreenBuffers,  # type: ignore[arg-type]
        )

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)

    def lose(self) -> None:
        self._display.plugged = False

    def bring_back(self) -> None:
        self._display.generation += 1
        self._display.plugged = True


RIGS: dict[str, dict[str, Callable[[], Rig]]] = {
    kind: {"sim": lambda kind=kind: SimRig(kind)}  # type: ignore[misc]
    for kind in LOSSES
}
RIGS["sound"]["alsa"] = AlsaRig
RIGS["camera"]["v4l2"] = V4l2Rig
RIGS["projector"]["kms"] = KmsRig
RIGS["keypad"]["usb"] = UsbPadRig
RIGS["keypad"]["pcf8574"] = lambda: MatrixPadRig(Pcf8574Pad, Pcf8574Matrix)
RIGS["keypad"]["tca8418"] = lambda: MatrixPadRig(Tca8418Pad, Tca8418Chip)
RIGS["pantilt"]["ptu"] = PtuRig
RIGS["lamp"]["dlpc34xx"] = LampRig
RIGS["power"]["ina219"] = lambda: PowerRig(Ina219, Ina219Chip)
RIGS["power"]["ina226"] = lambda: PowerRig(Ina226, Ina226Chip)


def implementations(kind: str) -> list[str]:
    return list(RIGS[kind])
