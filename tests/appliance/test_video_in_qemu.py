"""The camera and projector drivers in a Debian 13 that runs in QEMU, judged from outside.

Takes some minutes: run with ``pytest -m appliance tests/appliance``. Under emulation function,
order and content can be judged, speed cannot.
"""

import hashlib
import json
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stage_picture import draw_mask

from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.projector import ProjectorMode
from hypermask_drivers.projector.offscreen import OffscreenProjector
from hypermask_sim.appliance.image import Image
from hypermask_sim.appliance.qemu import Machine, VirtualCart

ROOT = Path(__file__).parents[2]
WORK = ROOT / "build/appliance/video"
SCREEN = (1280, 800)
ALONE = tuple(
    f"systemd.mask={unit}"
    for unit in ("hypermask.target", "cart-camera.service", "cart-voice.service")
)
"""The drivers alone, without the show and what plays its devices."""
VIVID = "modprobe vivid && udevadm settle"
PYTHON = "OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1 python3 /source/tests/appliance"
STATUS = "/sys/class/drm/card0-Virtual-1/status"

pytestmark = [pytest.mark.appliance, pytest.mark.timeout(3600)]


@pytest.fixture(scope="module")
def cart(disk: Image) -> Iterator[VirtualCart]:
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    with VirtualCart(Machine(disk, WORK, ROOT, screen=SCREEN, kernel_arguments=ALONE)) as cart:
        cart.wait_booted(600)
        cart.run("udevadm settle", timeout_s=120)
        yield cart


def pictures() -> np.ndarray:
    """Eight pictures (8, 480, 640), every grey level in each, all different."""
    rng = np.random.default_rng(20)
    return rng.integers(0, 256, (8, 480, 640), np.uint8)


@pytest.fixture(scope="module")
def camera(cart: VirtualCart) -> dict[str, Any]:
    (WORK / "frames.grey").write_bytes(pictures().tobytes())
    cart.run(VIVID, timeout_s=120)
    cart.run(f"{PYTHON}/guest_camera.py", timeout_s=600)
    return dict(json.loads((WORK / "camera.json").read_text()))


def exact(frames: list[dict[str, Any]]) -> list[bool]:
    """Which frames are pixel for pixel one of the pictures that were played.

    vivid puts a test picture of its own in where the player was late with the next.
    """
    sent = {hashlib.sha256(picture.tobytes()).hexdigest() for picture in pictures()}
    return [frame["hash"] in sent for frame in frames]


def test_frames_come_back_pixel_for_pixel(camera: dict[str, Any]) -> None:
    assert camera["format"] == "GREY"
    assert np.mean(exact(camera["frames"])) >= 0.95
    assert len({frame["hash"] for frame in camera["frames"]}) >= len(pictures())


def test_no_picture_is_torn(camera: dict[str, Any]) -> None:
    """A picture that was not played has no line of one that was: it is vivid's own."""
    played = pictures()
    for path in WORK.glob("odd-*.grey"):
        odd = np.fromfile(path, np.uint8).reshape(480, 640)
        assert not (odd == played).all(axis=2).any(), path.name


def test_time_stamps_rise_by_the_period_and_lie_in_the_past(camera: dict[str, Any]) -> None:
    times = np.array([frame["time_s"] for frame in camera["frames"]])
    numbers = np.array([frame["sequence"] for frame in camera["frames"]])
    period = 1 / camera["mode"]["rate_hz"]
    drift = times - times[0] - (numbers - numbers[0]) * period
    assert (np.diff(times) > 0).all() and (np.diff(numbers) > 0).all()
    assert np.median(np.abs(drift - np.median(drift))) < period
    ages = np.array([frame["age_s"] for frame in camera["frames"]])
    assert ages.min() > 0 and np.median(ages) < 1.0


def test_the_stamps_source_is_honoured(camera: dict[str, Any]) -> None:
    """Mid-exposure of 1 ms lies half of it before the frame's end, or after its start."""
    assert camera["stamp_at_end"] == [False, pytest.approx(-0.5e-3, abs=1e-6)]
    assert camera["stamp_at_start"] == [True, pytest.approx(0.5e-3, abs=1e-6)]


def test_rate_and_gain_are_read_back(camera: dict[str, Any]) -> None:
    assert camera["mode"]["width"] == 640 and camera["mode"]["height"] == 480
    assert camera["mode"]["rate_hz"] == pytest.approx(59.94, abs=0.1)
    assert camera["gain"] == [50, "gain: 50"]
    assert [text.split(":")[0] for text in camera["shortfalls"]] == ["CAM-EXPOSURE"]
    assert any(text.startswith("CAM-RATE") for text in camera["shortfalls_at_120"])


def test_missing_and_wrong_frames_are_counted(camera: dict[str, Any]) -> None:
    assert camera["dropped"] >= camera["sequence_gap"] > 3
    assert camera["corrupt"] >= 1


def test_the_camera_is_lost_and_comes_back(camera: dict[str, Any]) -> None:
    assert camera["lost"].startswith("CAM-LOST: ") and camera["state"] == "lost"
    # vivid is away until its last user has left, which the player may have done by then
    assert camera["while_away"] in ("CAM-ABSENT", "opened")
    assert np.mean(exact(camera["back"])) >= 0.75


class Show:
    """The projector's program in the guest, and what the screen showed at each of its steps."""

    def __init__(self, cart: VirtualCart) -> None:
        self._cart = cart
        cart.run(f"({PYTHON}/guest_projector.py 1280x800 replug >/host/projector.log 2>&1 &)")
        self.screens: dict[str, np.ndarray] = {}
        for step in ("opened", "drawn", "moved"):
            self.look(step)
        self._wait("unplug.reached")
        cart.run(f"echo off >{STATUS}")
        self._wait("replug.reached")
        cart.run(f"echo detect >{STATUS}")
        for step in ("back", "closed"):
            self.look(step)
        time.sleep(3)  # the program has ended and the kernel has its card back
        self.screens["after"] = cart.screenshot("after")
        self.told: dict[str, Any] = json.loads((WORK / "projector.json").read_text())

    def _wait(self, name: str, log: str = "projector.log") -> None:
        deadline = time.monotonic() + 300
        while not (WORK / name).exists():
            if time.monotonic() > deadline:
                raise AssertionError(f"{name}: {(WORK / log).read_text()}")
            time.sleep(0.1)

    def look(self, step: str, log: str = "projector.log") -> np.ndarray:
        """The screen at a step of the guest's program, which then goes on."""
        self._wait(f"{step}.reached", log)
        time.sleep(0.3)
        self.screens[step] = self._cart.screenshot(step)
        (WORK / f"{step}.seen").touch()
        return self.screens[step]


@pytest.fixture(scope="module")
def show(cart: VirtualCart) -> Show:
    return Show(cart)


def bands(picture: np.ndarray, shift: int) -> bool:
    """Whether the picture is exactly the one that the guest drew."""
    wanted = np.zeros((800, 1280, 3), np.uint8)
    wanted[:100, shift : shift + 200] = (255, 0, 0)
    wanted[:100, shift + 300 : shift + 500] = (0, 255, 0)
    wanted[-50:, shift : shift + 200] = (0, 0, 255)
    return bool(np.array_equal(picture, wanted))


def test_black_at_open_and_at_close(show: Show) -> None:
    for step in ("opened", "closed", "after"):
        assert show.screens[step].max() == 0, step


def test_what_is_drawn_is_seen_from_outside(show: Show) -> None:
    assert bands(show.screens["drawn"], 0)
    assert bands(show.screens["moved"], 640)


def test_what_is_drawn_can_be_read_back(show: Show) -> None:
    assert show.told["read_back"] == {"red": [255, 0, 0], "blue": [0, 0, 255], "black": [0, 0, 0]}
    assert show.told["version_code"] >= 300
    assert show.told["framebuffer"] == [1280, 800]


def test_flip_times_rise_by_no_less_than_a_period(show: Show) -> None:
    flips = np.array(show.told["flips"])
    period = 1 / show.told["mode"]["rate_hz"]
    assert np.diff(flips).min() > 0.5 * period
    assert (flips - np.array(show.told["promised"])).min() > -1e-3


def test_a_display_that_was_away_comes_back_with_the_same_context(show: Show) -> None:
    assert show.told["lost"].startswith("PRJ-LOST: ")
    assert show.told["away"].startswith("PRJ-ABSENT: ")
    assert show.told["same_context"]
    assert bands(show.screens["back"], 320)


def test_the_stage_draws_on_it_as_off_screen(cart: VirtualCart, show: Show) -> None:
    cart.run(f"({PYTHON}/guest_stage.py >/host/stage.log 2>&1 &)")
    shown = show.look("stage", "stage.log")
    projector = OffscreenProjector(
        ProjectorMode(shown.shape[1], shown.shape[0], 60.0, 0.02), VirtualClock()
    )
    projector.open()
    draw_mask(projector, ROOT)
    wanted = projector.read_picture().astype(int)
    projector.close()
    assert wanted.mean() > 3
    # The two software renderers are of different versions: edges may differ by a little.
    difference = np.abs(shown - wanted)
    assert difference.mean() < 0.1 and np.percentile(difference, 99.9) < 16
