"""The V4L2 camera over a video device made of Python."""

import errno

import cv2
import numpy as np
import pytest

from hypermask_drivers.camera.v4l2 import V4l2Camera, V4l2Settings
from hypermask_drivers.camera.v4l2_formats import grey
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.errors import DeviceAbsent, DeviceError, DeviceLost
from hypermask_sim.video_emulator import EmulatedCamera, EmulatedVideoSystem

WIDTH, HEIGHT = 640, 480


def rig(
    camera: EmulatedCamera | None = None, **settings: object
) -> tuple[V4l2Camera, EmulatedVideoSystem, VirtualClock]:
    clock = VirtualClock(500.0)
    system = EmulatedVideoSystem(clock, camera)
    return V4l2Camera(V4l2Settings.model_validate(settings), clock, system), system, clock


def codes(camera: V4l2Camera) -> list[str]:
    return [each.code for each in camera.shortfalls]


def ramp() -> np.ndarray:
    return (np.add.outer(np.arange(HEIGHT), np.arange(WIDTH)) % 256).astype(np.uint8)


def packed(name: str) -> bytes:
    """The ramp in a camera's pixel format."""
    image = ramp()
    if name == "GREY":
        return image.tobytes()
    if name == "MJPG":
        return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1])
    if name == "YUYV":
        return np.dstack([image, np.full_like(image, 128)]).tobytes()
    shift = {"Y10 ": 2, "Y16 ": 8}[name]
    noise = np.arange(WIDTH) % 2**shift  # the low bits do not matter
    return ((image.astype("<u2") << shift) + noise.astype("<u2")).tobytes()


# Pictures


@pytest.mark.parametrize("name", ["GREY", "Y10 ", "Y16 ", "YUYV", "MJPG"])
def test_every_format_becomes_grey(name: str) -> None:
    emulated = EmulatedCamera(formats={name: (60.0,)}, frames=lambda *_: packed(name), vblank=False)
    camera, _, _ = rig(emulated)
    camera.open()
    frame = camera.read(0.1)
    assert frame is not None and camera.pixel_format == name
    error = np.abs(frame.image.astype(int) - ramp())
    assert np.median(error) <= (3 if name == "MJPG" else 0)
    assert name == "MJPG" or error.max() == 0


@pytest.mark.parametrize("name", ["GREY", "Y10 ", "Y16 ", "YUYV"])
def test_a_picture_is_a_copy_of_the_drivers_memory(name: str) -> None:
    memory = bytearray(packed(name))
    image = grey(memory, name, WIDTH, HEIGHT, len(memory) // HEIGHT)
    memory[:] = bytes(len(memory))
    assert image is not None and np.array_equal(image, ramp())


def test_lines_may_have_padding() -> None:
    padded = np.zeros((HEIGHT, WIDTH + 32), np.uint8)
    padded[:, :WIDTH] = ramp()
    emulated = EmulatedCamera(padding=32, frames=lambda *_: padded.tobytes())
    camera, _, _ = rig(emulated)
    camera.open()
    frame = camera.read(0.1)
    assert frame is not None and np.array_equal(frame.image, ramp())


def test_packed_ten_bits_give_their_upper_eight() -> None:
    image = grey(bytes([10, 20, 30, 40, 0xFF, 50, 60, 70, 80, 0xFF]), "Y10P", 8, 1, 10)
    assert image is not None and image.tolist() == [[10, 20, 30, 40, 50, 60, 70, 80]]


@pytest.mark.parametrize("data", [b"", b"\xff\xd8 no picture", bytes(1000)])
@pytest.mark.parametrize("name", ["GREY", "YUYV", "MJPG"])
def test_what_is_no_whole_picture_is_none(data: bytes, name: str) -> None:
    assert grey(data, name, WIDTH, HEIGHT, WIDTH) is None


def test_the_format_that_reaches_the_rate_is_chosen() -> None:
    formats = {"YUYV": (30.0, 10.0), "MJPG": (60.0, 30.0)}
    camera, _, _ = rig(EmulatedCamera(formats=formats, vblank=False))
    camera.open()
    assert camera.pixel_format == "MJPG" and camera.mode.rate_hz == pytest.approx(60)
    assert codes(camera) == []


def test_the_cheapest_of_two_that_reach_it_is_chosen() -> None:
    formats = {"MJPG": (60.0,), "YUYV": (60.0,), "GREY": (60.0,)}
    camera, _, _ = rig(EmulatedCamera(formats=formats))
    camera.open()
    assert camera.pixel_format == "GREY"


# What is delivered


def test_a_lower_rate_is_said() -> None:
    camera, _, _ = rig(EmulatedCamera(formats={"GREY": (30.0,)}, vblank=False), rate_hz=120.0)
    camera.open()
    assert codes(camera) == ["CAM-RATE"]
    assert camera.mode.rate_hz == pytest.approx(30)
    assert "30.0 frames/s instead of 120" in str(camera.shortfalls[0])


def test_a_rate_that_is_promised_and_not_kept_is_said() -> None:
    camera, _, _ = rig(EmulatedCamera(true_rate_hz=48.0, vblank=False))
    camera.open()
    assert codes(camera) == []
    for _ in range(80):
        camera.read(0.1)
    assert camera.measured_rate_hz == pytest.approx(48.0, rel=0.01)
    assert codes(camera) == ["CAM-RATE"]


def test_another_size_is_said() -> None:
    camera, _, _ = rig(EmulatedCamera(sizes=((640, 480),)), width=1280, height=800)
    camera.open()
    assert (camera.mode.width, camera.mode.height) == (640, 480)
    assert "CAM-SIZE" in codes(camera)


def test_exposure_in_lines_is_read_back_in_seconds() -> None:
    camera, system, _ = rig(exposure_ms=2.0)
    camera.open()
    assert system.exposure_s == pytest.approx(2e-3, rel=0.01)
    assert camera.mode.exposure_s == pytest.approx(system.exposure_s)
    assert camera.set_exposure(4e-3) == pytest.approx(system.exposure_s)


def test_exposure_of_a_webcam_is_in_tenths_of_milliseconds() -> None:
    camera, system, _ = rig(EmulatedCamera(vblank=False), exposure_ms=0.32)
    camera.open()
    assert system.exposure_s == pytest.approx(0.3e-3)
    assert camera.mode.exposure_s == pytest.approx(0.3e-3)


def test_an_exposure_that_cannot_be_set_is_said() -> None:
    camera, _, _ = rig(EmulatedCamera(exposure=False))
    camera.open()
    assert codes(camera) == ["CAM-EXPOSURE"]
    assert camera.set_exposure(5e-3) == camera.mode.exposure_s


def test_gain_is_read_back() -> None:
    camera, _, _ = rig(gain=100)
    camera.open()
    assert camera.gain == 100 and codes(camera) == []
    camera, _, _ = rig(gain=1000)
    camera.open()
    assert camera.gain == 240 and codes(camera) == ["CAM-GAIN"]


# Times


@pytest.mark.parametrize("stamp", ["start", "end", "unknown"])
def test_time_is_mid_exposure_whatever_the_stamp_means(stamp: str) -> None:
    emulated = EmulatedCamera(stamp=stamp, phase_s=500.003)
    camera, system, _ = rig(emulated, exposure_ms=3.0, readout_ms=8.0)
    camera.open()
    frame = camera.read(0.1)
    assert frame is not None
    offset = (frame.time_s - 500.003) / system.period_s
    # Without a usable stamp the delivery (1 ms) and the polling (0.5 ms) are in the time.
    margin = 2e-3 if stamp == "unknown" else 2e-6
    assert offset == pytest.approx(round(offset), abs=margin / system.period_s)
    assert codes(camera) == (["CAM-CLOCK"] if stamp == "unknown" else [])


def test_a_rolling_shutter_exposes_its_middle_half_a_readout_later() -> None:
    times = []
    for shutter in ("global", "rolling"):
        camera, _, _ = rig(EmulatedCamera(phase_s=500.0), shutter=shutter, readout_ms=8.0)
        camera.open()
        frame = camera.read(0.1)
        assert frame is not None
        times.append(frame.time_s)
    assert times[1] - times[0] == pytest.approx(4e-3)


# Frames that are missing


def test_dropped_frames_are_counted() -> None:
    camera, _, clock = rig(newest_only=False)
    camera.open()
    assert camera.read(0.1) is not None
    clock.sleep_until(clock.now() + 1.0)
    while camera.read(0.0) is not None:
        pass
    frame = camera.read(0.1)
    assert frame is not None
    assert camera.dropped == frame.sequence + 1 - 6  # one read, four buffers, this one


def test_of_waiting_frames_the_newest_is_given() -> None:
    for newest, expected in ((True, 3), (False, 0)):
        camera, _, clock = rig(newest_only=newest)
        camera.open()
        clock.sleep_until(clock.now() + 1.0)
        frame = camera.read(0.0)
        assert frame is not None and frame.sequence == expected
        assert camera.skipped == expected and camera.dropped == 0


def test_frames_marked_as_wrong_are_passed_over() -> None:
    camera, _, _ = rig(EmulatedCamera(corrupt=frozenset({1, 2})))
    camera.open()
    sequence = [frame.sequence for _ in range(3) if (frame := camera.read(0.2)) is not None]
    assert sequence == [0, 3, 4]
    assert camera.corrupt == 2 and camera.dropped == 0


def test_the_sequence_goes_on_over_its_wrap() -> None:
    camera, system, _ = rig()
    camera.open()
    system._sequence = 2**32 - 2
    frames = [camera.read(0.2) for _ in range(4)]
    numbers = [frame.sequence for frame in frames if frame is not None]
    assert np.diff(numbers).tolist() == [1, 1, 1] and camera.dropped == 0


def test_read_waits_no_longer_than_it_may() -> None:
    camera, system, clock = rig()
    camera.open()
    system.hung = True
    before = clock.now()
    assert camera.read(0.25) is None
    assert clock.now() - before == pytest.approx(0.25)


# Loss


def test_a_hung_camera_is_lost_and_back() -> None:
    camera, system, _ = rig(hung_s=1.0)
    camera.open()
    assert camera.read(0.1) is not None
    system.hung = True
    with pytest.raises(DeviceLost) as caught:
        for _ in range(20):
            camera.read(0.1)
    assert caught.value.code == "CAM-HUNG" and camera.state is DeviceState.LOST
    system.hung = False
    camera.open()
    assert camera.read(0.1) is not None


def test_unplugged_while_waiting() -> None:
    camera, system, _ = rig()
    camera.open()
    system.unplug()
    with pytest.raises(DeviceLost) as caught:
        camera.read(1.0)
    assert caught.value.code == "CAM-LOST"


@pytest.mark.parametrize(
    ("number", "code"),
    [(errno.EACCES, "CAM-RIGHTS"), (errno.EBUSY, "CAM-BUSY"), (errno.ENOENT, "CAM-ABSENT")],
)
def test_why_it_does_not_open(number: int, code: str) -> None:
    camera, system, _ = rig()
    system.open_error = number
    with pytest.raises(DeviceAbsent) as caught:
        camera.open()
    assert caught.value.code == code and camera.state is DeviceState.ABSENT


def test_a_camera_without_a_known_format() -> None:
    camera, _, _ = rig(formats=["MJPG"])
    with pytest.raises(DeviceError) as caught:
        camera.open()
    assert caught.value.code == "CAM-FORMAT" and "it has GREY" in str(caught.value)


# Phase


def test_a_webcam_cannot_shift_its_phase() -> None:
    camera, _, _ = rig(EmulatedCamera(vblank=False))
    camera.open()
    assert camera.shift_phase(1e-3) == 0.0


@pytest.mark.parametrize("delay_ms", [-5.0, -0.3, 0.3, 4.0])
def test_phase_shift_by_the_vertical_blanking(delay_ms: float) -> None:
    camera, system, _ = rig()
    camera.open()
    period, nominal = system.period_s, system.controls[0x009E0901].value
    first = camera.read(0.1)
    applied = camera.shift_phase(delay_ms * 1e-3)
    assert applied == pytest.approx(delay_ms * 1e-3, abs=15e-6)
    for _ in range(60):
        last = camera.read(0.1)
    assert first is not None and last is not None
    drift = last.time_s - first.time_s - (last.sequence - first.sequence) * period
    assert drift == pytest.approx(applied, abs=20e-6)
    assert system.controls[0x009E0901].value == nominal
