"""The udev rules give the names that the drivers look for, and udev finds nothing wrong."""

import re
import shutil
import subprocess
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from hypermask_drivers.keypad.i2c_pads import MatrixSettings
from hypermask_drivers.lamp.dlpc34xx import Dlpc34xxSettings
from hypermask_drivers.pantilt.ptu import PtuSettings
from hypermask_drivers.power.ina2xx import Ina2xxSettings

RULES = Path(__file__).parents[2] / "configs/udev/60-hypermask.rules"
SOUND = RULES.with_name("90-hypermask-sound.rules")


def lines() -> list[str]:
    text = RULES.read_text().replace("\\\n", " ")
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


@pytest.mark.parametrize(
    "device",
    [
        settings().device
        for settings in (PtuSettings, MatrixSettings, Dlpc34xxSettings, Ina2xxSettings)
    ],
)
def test_the_drivers_names_are_made(device: str) -> None:
    made = re.findall(r'SYMLINK\+="([^"]+)"', RULES.read_text())
    assert device.removeprefix("/dev/") in made


@pytest.mark.parametrize("name", ["camera", "ptu", "i2c", "sound"])
def test_every_kind_of_device_has_a_stable_name(name: str) -> None:
    assert f'SYMLINK+="hypermask/{name}"' in RULES.read_text()


def test_every_jump_has_its_label_further_down() -> None:
    text = "\n".join(lines())
    jumps = set(re.findall(r'GOTO="(\w+)"', text))
    assert jumps
    for label in jumps:
        assert text.rindex(f'GOTO="{label}"') < text.index(f'LABEL="{label}"')


def test_nothing_is_open_to_everybody() -> None:
    modes = re.findall(r'MODE="(\d+)"', RULES.read_text())
    assert modes and all(mode.startswith("06") and mode.endswith("0") for mode in modes)


@pytest.mark.parametrize(
    ("interfaces", "is_camera"),
    [(":0e0100:0e0200:", True), (":010100:0e0100:0e0200:", True), (":0300e0:030101:", False)],
)
def test_a_camera_may_be_made_to_start_anew(interfaces: str, is_camera: bool) -> None:
    """Its USB device belongs to the show's group, by the class of its interfaces: 0e is video."""
    (rule,) = [line for line in lines() if "ID_USB_INTERFACES" in line]
    pattern = re.search(r'ENV\{ID_USB_INTERFACES\}=="([^"]+)"', rule)
    assert pattern is not None
    assert fnmatchcase(interfaces, pattern[1]) is is_camera
    assert 'ENV{DEVTYPE}=="usb_device"' in rule
    assert 'GROUP="hypermask", MODE="0660"' in rule


def test_one_file_alone_names_sound_cards() -> None:
    """A second name in between would be there for whoever opens the card then."""
    assert "ATTR{id}" not in "\n".join(lines())


def test_udev_finds_nothing_wrong() -> None:
    udevadm = shutil.which("udevadm")
    if udevadm is None:
        pytest.skip("udevadm is not installed")
    command = [udevadm, "verify", "--resolve-names=never", str(RULES), str(SOUND)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "Unknown command" in done.stderr:
        pytest.skip("this udevadm is older than 254 and cannot verify")
    assert done.returncode == 0, done.stdout + done.stderr
