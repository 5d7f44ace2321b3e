import numpy as np
import pytest
from contract_rigs import RIGS, Rig, implementations

from hypermask_drivers.camera import Camera, Frame


@pytest.fixture(params=implementations("camera"))
def rig(request: pytest.FixtureRequest) -> Rig:
    rig = RIGS["camera"][request.param]()
    rig.device.open()
    return rig


def camera_of(rig: Rig) -> Camera:
    assert isinstance(rig.device, Camera)
    return rig.device


def next_frame(rig: Rig) -> Frame:
    """Poll as a program would, a hundredth of a period at a time."""
    camera = camera_of(rig)
    for _ in range(1000):
        frame = camera.read(0.0)
        if frame is not None:
            return frame
        rig.wait(0.01 / camera.mode.rate_hz)
    raise AssertionError("no frame within ten periods")


def test_read_with_no_timeout_never_waits(rig: Rig) -> None:
    before = rig.clock.now()
    while camera_of(rig).read(0.0) is not None:
        pass
    assert camera_of(rig).read(0.0) is None
    assert rig.clock.now() == before


def test_frames_are_grey_of_the_delivered_mode(rig: Rig) -> None:
    mode = camera_of(rig).mode
    frame = next_frame(rig)
    assert frame.image.shape == (mode.height, mode.width)
    assert frame.image.dtype == np.uint8
    assert not frame.image.flags.writeable


def test_sequence_counts_and_times_step_by_the_period(rig: Rig) -> None:
    frames = [next_frame(rig) for _ in range(5)]
    assert [f.sequence - frames[0].sequence for f in frames] == list(range(5))
    steps = np.diff([f.time_s for f in frames])
    assert steps == pytest.approx(1 / camera_of(rig).mode.rate_hz, rel=0.02)


def test_mid_exposure_lies_in_the_past(rig: Rig) -> None:
    frame = next_frame(rig)
    assert 0 < rig.clock.now() - frame.time_s < 0.05


def test_a_slow_reader_sees_a_gap_in_the_sequence(rig: Rig) -> None:
    first = next_frame(rig)
    rig.wait(1.0)
    later = [next_frame(rig) for _ in range(20)]
    gaps = np.diff([first.sequence, *(f.sequence for f in later)])
    assert gaps.min() == 1 and gaps.max() > 10


def test_exposure_is_read_back(rig: Rig) -> None:
    camera = camera_of(rig)
    used = camera.set_exposure(0.5e-3)
    assert used == pytest.approx(0.5e-3, rel=0.1)
    assert camera.mode.exposure_s == used
    assert camera.set_exposure(10.0) <= 1 / camera.mode.rate_hz


def test_phase_shift_moves_the_coming_frames_by_what_it_says(rig: Rig) -> None:
    period = 1 / camera_of(rig).mode.rate_hz
    before = next_frame(rig)
    applied = camera_of(rig).shift_phase(0.3 * period)
    for _ in range(60):
        after = next_frame(rig)
    drift = (after.time_s - before.time_s) - (after.sequence - before.sequence) * period
    assert drift == pytest.approx(applied, abs=0.01 * period)
