import itertools

import pytest
from contract_rigs import RIGS, Rig, implementations

from hypermask_drivers.pantilt import PanTilt


@pytest.fixture(params=implementations("pantilt"))
def rig(request: pytest.FixtureRequest) -> Rig:
    rig = RIGS["pantilt"][request.param]()
    rig.device.open()
    head_of(rig).home()
    rig.wait(4.0)
    return rig


def head_of(rig: Rig) -> PanTilt:
    assert isinstance(rig.device, PanTilt)
    return rig.device


def test_homing_ends_at_zero(rig: Rig) -> None:
    state = head_of(rig).read()
    assert (state.pan_rad, state.tilt_rad, state.moving) == (0.0, 0.0, False)
    assert state.time_s == pytest.approx(rig.clock.now())


def test_move_returns_at_once_and_arrives(rig: Rig) -> None:
    before = rig.clock.now()
    head_of(rig).move(0.5, -0.3, 1.0)
    assert rig.clock.now() == before
    assert head_of(rig).read().moving
    rig.wait(2.0)
    state = head_of(rig).read()
    assert (state.pan_rad, state.tilt_rad) == pytest.approx((0.5, -0.3), abs=2e-3)
    assert not state.moving


def test_targets_are_clamped_to_the_limits(rig: Rig) -> None:
    limits = head_of(rig).limits
    head_of(rig).move(100.0, -100.0, limits.speed_rad_s)
    rig.wait(5.0)
    state = head_of(rig).read()
    assert state.pan_rad == pytest.approx(limits.pan_rad[1], abs=2e-3)
    assert state.tilt_rad == pytest.approx(limits.tilt_rad[0], abs=2e-3)


def test_it_is_never_faster_than_told(rig: Rig) -> None:
    head_of(rig).move(1.0, 0.0, 0.6)
    places = []
    for _ in range(100):
        rig.wait(0.01)
        places.append(head_of(rig).read().pan_rad)
    most = 0.6 * 0.01 + head_of(rig).limits.step_rad
    assert max(b - a for a, b in itertools.pairwise(places)) <= most + 1e-6


def test_halt_stops_at_once(rig: Rig) -> None:
    head_of(rig).move(1.0, 0.0, 0.6)
    rig.wait(0.5)
    head_of(rig).halt()
    stopped = head_of(rig).read()
    rig.wait(1.0)
    later = head_of(rig).read()
    assert 0 < stopped.pan_rad < 1
    assert later.pan_rad == pytest.approx(stopped.pan_rad, abs=1e-6) and not later.moving
