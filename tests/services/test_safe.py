"""The safe state on an emulated pan-tilt unit: it is a process of its own, with no master."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from hypermask.neck.settings import NeckSettings
from hypermask.services.safe import SafeLoop, build
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.pantilt.ptu import DirectedPerceptionPtu, PtuSettings
from hypermask_sim.emulators.ptu import PtuData, PtuUnit
from hypermask_sim.emulators.ptu_line import PtuLine


class Cart:
    """Just a head: no projector."""

    def __init__(self, folder: Path) -> None:
        self.clock = VirtualClock(100.0)
        self.unit = PtuUnit(PtuData(baud=None, homing_s=2.0))
        self.line = PtuLine(self.unit, self.clock, folder / "ptu")
        self.line.plug()
        self.machine = SimpleNamespace(neck=NeckSettings(park_deg=(0.0, -10.0)))

    def report(self, time_s: float, code: str, text: str) -> None:
        """What is told is not looked at here."""

    def ptu(self) -> DirectedPerceptionPtu:
        settings = PtuSettings(device=str(self.line.link), silence_s=0.15)
        return DirectedPerceptionPtu(settings, self.clock, self.line.connect)

    def device(self, kind: str) -> DirectedPerceptionPtu | None:
        return self.ptu() if kind == "pantilt" else None

    def turn(self, loop: SafeLoop, seconds: float) -> None:
        end_s = self.clock.now() + seconds
        while self.clock.now() < end_s:
            loop.turn()
            self.line.catch_up()
            self.line.settle()

    def places(self) -> tuple[int, int]:
        axes = self.unit.axes
        return axes["P"].position(self.clock.now()), axes["T"].position(self.clock.now())


@pytest.fixture
def cart(tmp_path: Path) -> Iterator[Cart]:
    cart = Cart(tmp_path)
    yield cart
    cart.line.close()


PARKED = (0, round(-10 * 3600 / 185.1428))


def test_a_head_whose_zero_nobody_knows_is_homed_and_parked(cart: Cart) -> None:
    loop = build(cart)  # type: ignore[arg-type]
    assert isinstance(loop, SafeLoop)
    cart.turn(loop, 12.0)
    assert loop.status() == "dark; the head is parked"
    assert cart.unit.heard.count("R") == 1 and cart.places() == PARKED
    loop.stop()


def test_a_head_that_the_show_left_is_parked_without_homing(cart: Cart) -> None:
    show = cart.ptu()
    show.open()
    show.home()
    cart.line.catch_up()
    cart.clock.sleep_until(103.0)
    cart.line.settle()
    assert show.read().homed
    show.close()
    loop = SafeLoop(cart)  # type: ignore[arg-type]
    cart.turn(loop, 8.0)
    assert loop.status() == "dark; the head is parked"
    assert cart.unit.heard.count("R") == 1 and cart.places() == PARKED
    loop.stop()
