import numpy as np
import pytest
from contract_rigs import RIGS, Rig, implementations

from hypermask_drivers.projector import Projector


@pytest.fixture(params=implementations("projector"))
def rig(request: pytest.FixtureRequest) -> Rig:
    rig = RIGS["projector"][request.param]()
    rig.device.open()
    return rig


def projector_of(rig: Rig) -> Projector:
    assert isinstance(rig.device, Projector)
    return rig.device


def test_the_framebuffer_has_the_modes_size(rig: Rig) -> None:
    projector = projector_of(rig)
    assert projector.framebuffer.size == (projector.mode.width, projector.mode.height)


def test_the_context_is_gles_3(rig: Rig) -> None:
    assert projector_of(rig).context.version_code >= 300


def test_what_is_drawn_can_be_read_back(rig: Rig) -> None:
    projector = projector_of(rig)
    with projector.context:
        projector.framebuffer.clear(1.0, 0.5, 0.0, 1.0)
        pixels = np.frombuffer(projector.framebuffer.read(components=4), np.uint8).reshape(-1, 4)
    assert np.ptp(pixels, axis=0).max() == 0
    assert pixels[0, :3].tolist() == pytest.approx([255, 128, 0], abs=1)


def test_the_next_flip_lies_within_a_period(rig: Rig) -> None:
    projector = projector_of(rig)
    projector.present()
    for _ in range(10):
        rig.wait(0.0213)
        ahead = projector.next_flip_s() - rig.clock.now()
        assert 0 < ahead <= 1 / projector.mode.rate_hz + 1e-6


def test_present_makes_the_flip_that_was_promised(rig: Rig) -> None:
    projector = projector_of(rig)
    for _ in range(5):
        promised = projector.next_flip_s()
        assert projector.present() == pytest.approx(promised, abs=1e-6, rel=0)
        rig.wait(0.02)


def test_each_flip_shows_one_picture(rig: Rig) -> None:
    projector = projector_of(rig)
    flips = [projector.present() for _ in range(4)]
    assert np.diff(flips) == pytest.approx(1 / projector.mode.rate_hz, rel=0.02)


def test_light_comes_after_the_flip(rig: Rig) -> None:
    mode = projector_of(rig).mode
    assert mode.light_delay_s >= 0.5 / mode.rate_hz
