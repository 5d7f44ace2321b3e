"""What every device of every kind does: open, close, be absent, get lost, come back."""

import re

import pytest
from contract_rigs import RIGS, Rig

from hypermask_drivers.device import Device, DeviceState
from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost
from hypermask_drivers.registry import kinds

EVERY = [(kind, name) for kind in RIGS for name in RIGS[kind]]


@pytest.fixture(params=EVERY, ids=[f"{kind}-{name}" for kind, name in EVERY])
def case(request: pytest.FixtureRequest) -> tuple[str, Rig]:
    kind, name = request.param
    return kind, RIGS[kind][name]()


def use(kind: str, device: Device) -> object:
    """One plain use of a device."""
    actions = {
        "camera": lambda: device.read(0.0),  # type: ignore[attr-defined]
        "keypad": lambda: device.read(0.0),  # type: ignore[attr-defined]
        "sound": lambda: device.read(0.0),  # type: ignore[attr-defined]
        "projector": lambda: device.present(),  # type: ignore[attr-defined]
    }
    return actions.get(kind, lambda: device.read())()  # type: ignore[attr-defined]


def test_every_kind_of_device_has_a_contract() -> None:
    assert set(RIGS) == set(kinds())


def test_opens_and_closes(case: tuple[str, Rig]) -> None:
    kind, rig = case
    states = [rig.device.state]
    rig.device.open()
    states.append(rig.device.state)
    use(kind, rig.device)
    rig.device.close()
    states.append(rig.device.state)
    assert states == [DeviceState.ABSENT, DeviceState.READY, DeviceState.ABSENT]


def test_close_never_raises(case: tuple[str, Rig]) -> None:
    _, rig = case
    rig.device.close()
    rig.device.open()
    rig.lose()
    rig.device.close()
    rig.device.close()
    assert rig.device.state is DeviceState.ABSENT


def test_is_a_context_manager(case: tuple[str, Rig]) -> None:
    kind, rig = case
    with rig.device as device:
        use(kind, device)
    assert rig.device.state is DeviceState.ABSENT


def test_use_of_a_closed_device_is_an_error(case: tuple[str, Rig]) -> None:
    kind, rig = case
    with pytest.raises(DeviceError) as caught:
        use(kind, rig.device)
    assert not isinstance(caught.value, DeviceLost | DeviceAbsent)
    assert caught.value.code.endswith("-CLOSED")


def test_open_without_hardware_says_absent(case: tuple[str, Rig]) -> None:
    _, rig = case
    rig.lose()
    with pytest.raises(DeviceAbsent):
        rig.device.open()
    assert rig.device.state is DeviceState.ABSENT


def test_lost_and_back(case: tuple[str, Rig]) -> None:
    kind, rig = case
    rig.device.open()
    use(kind, rig.device)
    rig.lose()
    for _ in range(2):
        with pytest.raises(DeviceLost):
            use(kind, rig.device)
        assert rig.device.state is DeviceState.LOST
    with pytest.raises(DeviceAbsent):
        rig.device.open()
    rig.bring_back()
    rig.device.open()
    assert rig.device.state is DeviceState.READY
    use(kind, rig.device)
    rig.device.close()


def test_a_loss_that_nobody_saw_is_still_a_loss(case: tuple[str, Rig]) -> None:
    kind, rig = case
    rig.device.open()
    use(kind, rig.device)
    rig.bring_back()
    with pytest.raises(DeviceLost):
        use(kind, rig.device)


def test_errors_have_a_code_and_a_remedy(case: tuple[str, Rig]) -> None:
    kind, rig = case
    rig.device.open()
    rig.lose()
    with pytest.raises(DeviceLost) as caught:
        use(kind, rig.device)
    assert re.fullmatch(r"[A-Z]{3}-LOST: [^.]+\. \S.*\.", str(caught.value))
