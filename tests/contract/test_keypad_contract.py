import pytest
from contract_rigs import RIGS, Rig, implementations

from hypermask_drivers.keypad import KEYS, KeyEvent, Keypad


@pytest.fixture(params=implementations("keypad"))
def rig(request: pytest.FixtureRequest) -> Rig:
    rig = RIGS["keypad"][request.param]()
    rig.device.open()
    return rig


def events(rig: Rig) -> list[KeyEvent]:
    assert isinstance(rig.device, Keypad)
    found = []
    while (event := rig.device.read(0.0)) is not None:
        found.append(event)
    return found


def test_read_with_no_timeout_never_waits(rig: Rig) -> None:
    before = rig.clock.now()
    assert events(rig) == []
    assert rig.clock.now() == before


def test_a_key_is_pressed_and_then_released(rig: Rig) -> None:
    start = rig.clock.now()
    rig.wait(3.0)
    press, release = events(rig)
    assert (press.key, press.pressed, release.key, release.pressed) == ("5", True, "5", False)
    assert press.key in KEYS
    assert start <= press.time_s <= release.time_s <= rig.clock.now()


def test_keys_pressed_while_unplugged_never_arrive(rig: Rig) -> None:
    rig.device.close()
    rig.lose()
    rig.bring_back()
    rig.device.open()
    assert events(rig) == []
