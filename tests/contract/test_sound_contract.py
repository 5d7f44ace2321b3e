import itertools

import numpy as np
import pytest
from contract_rigs import RIGS, Rig, implementations

from hypermask_drivers.sound import SoundBlock, SoundIn


@pytest.fixture(params=implementations("sound"))
def rig(request: pytest.FixtureRequest) -> Rig:
    rig = RIGS["sound"][request.param]()
    rig.device.open()
    return rig


def blocks(rig: Rig) -> list[SoundBlock]:
    assert isinstance(rig.device, SoundIn)
    found = []
    while (block := rig.device.read(0.0)) is not None:
        found.append(block)
    return found


def test_read_with_no_timeout_never_waits(rig: Rig) -> None:
    before = rig.clock.now()
    blocks(rig)
    assert blocks(rig) == []
    assert rig.clock.now() == before


def test_blocks_join_without_a_gap(rig: Rig) -> None:
    rig.wait(0.2)
    found = blocks(rig)
    assert len(found) > 5
    for block, following in itertools.pairwise(found):
        assert block.samples.dtype == np.float32 and block.samples.ndim == 1
        assert following.time_s - block.time_s == pytest.approx(len(block.samples) / block.rate_hz)


def test_a_block_is_heard_before_it_is_read(rig: Rig) -> None:
    rig.wait(0.2)
    last = blocks(rig)[-1]
    assert last.time_s + len(last.samples) / last.rate_hz <= rig.clock.now()


def test_a_slow_reader_is_told_what_it_lost(rig: Rig) -> None:
    rig.wait(0.1)
    before = blocks(rig)[-1]
    rig.wait(5.0)
    found = blocks(rig)
    if not found:  # a stream that overran stops; it begins anew when it is read
        rig.wait(0.1)
        found = blocks(rig)
    after = found[0]
    step = len(before.samples) / before.rate_hz
    assert before.overruns == 0
    assert after.overruns == round((after.time_s - before.time_s) / step) - 1 > 0
