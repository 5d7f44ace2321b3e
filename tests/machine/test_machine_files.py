"""The machine's layers: what the owner wrote goes over what is packaged, and nothing that is wrong
is ever used."""

from __future__ import annotations

import os
import shutil
import stat
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hypermask import paths
from hypermask.cli.main import app
from hypermask.errors import ConfigError, HypermaskError
from hypermask.machine import files
from hypermask.machine.devices import device_settings, make_device
from hypermask.machine.settings import MachineSettings
from hypermask.services.playbill import playable_show
from hypermask_drivers.camera.v4l2 import V4l2Camera, V4l2Settings
from hypermask_drivers.clock import VirtualClock

PACKAGED = sorted(path.stem for path in (paths.configs() / "machines").glob("*.toml"))


@pytest.fixture(autouse=True)
def _folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "etc").mkdir()
    monkeypatch.setenv("HYPERMASK_ETC", str(tmp_path / "etc"))
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path / "home"))


def write(name: str, text: str) -> None:
    (files.etc() / name).write_text(text, "utf-8")


def told() -> tuple[MachineSettings, list[str]]:
    codes: list[str] = []
    return files.load_machine(lambda code, text: codes.append(code)), codes


# --- what is packaged ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", PACKAGED)
def test_every_packaged_machine_can_be_used(name: str) -> None:
    write("machine.toml", f'machine = "{name}"')
    machine, codes = told()
    assert machine.name == name and codes == []


def test_there_are_the_machines_that_are_promised() -> None:
    assert {"cart", "qemu", "sim"} <= set(PACKAGED)


def test_a_cart_is_what_a_fresh_installation_is() -> None:
    assert told()[0].name == "cart"


# --- layers -------------------------------------------------------------------------------------


def test_the_owners_files_go_over_the_packaged_one_in_the_order_of_their_names() -> None:
    write("machine.toml", 'machine = "cart"')
    write("50-mine.toml", "[camera]\nrate_hz = 90.0\nwidth = 640")
    write("90-set.toml", "[camera]\nrate_hz = 60.0")
    camera = told()[0].camera
    assert camera is not None
    assert (camera.own["rate_hz"], camera.own["width"], camera.own["height"]) == (60.0, 640, 800)


def test_another_driver_starts_from_nothing() -> None:
    """The settings of a camera on USB mean nothing to a simulated one."""
    write("50.toml", 'scenario = "still"\n[camera]\ndriver = "sim"')
    camera = told()[0].camera
    assert camera is not None and camera.own == {}


def test_a_device_can_be_taken_away() -> None:
    write("50.toml", '[pantilt]\ndriver = "none"')
    assert told()[0].pantilt is None


def test_hidden_files_of_editors_are_no_layer() -> None:
    write(".50.toml.swp.toml", "not TOML")
    assert told()[1] == []


# --- what is wrong ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("[camera\n", "CFG-SYNTAX"),
        ('machine = "boat"', "CFG-MACHINE"),
        ("[camera]\nwidht = 640", "CFG-KEY"),
        ("[camera]\nwidth = -1", "CFG-VALUE"),
        ('[camera]\ndriver = "v5l2"', "DRV-NAME"),
        ('[camera]\ndriver = "sim"', "CFG-SCENARIO"),
        ("[stage]\nbrightness = 1", "CFG-KEY"),
        ("[workers.tracker]\npriority = 99", "CFG-VALUE"),
        ("version = 2", "CFG-VALUE"),
        ('[sound]\ndriver = "alsa"\ndevice = "hw:1"', "CFG-VALUE"),
        ('mask = "nobody"', "MASK-ABSENT"),
        (f'mask = "{"a" * 300}"', "MASK-ABSENT"),
        (f'machine = "{"a" * 300}"', "CFG-MACHINE"),
        ('machine = "sim"\nscenario = "opera"', "CFG-ABSENT"),
        (f"name = {'[' * 3000}", "CFG-SYNTAX"),
        (f"[camera]\nwidth = {'1' * 5000}", "CFG-SYNTAX"),
    ],
)
def test_each_mistake_is_found_before_it_is_used(text: str, code: str) -> None:
    write("50.toml", text)
    with pytest.raises(ConfigError) as found:
        files.validated(files.merged(), files.source())
    assert found.value.code == code


def test_a_driver_says_which_of_its_keys_was_meant() -> None:
    write("50.toml", "[camera]\nwidht = 640")
    with pytest.raises(ConfigError, match=r"\[camera\].*'widht'.*Did you mean 'width'"):
        files.validated(files.merged(), files.source())


def test_the_last_good_configuration_is_used_in_the_place_of_a_broken_one() -> None:
    write("50.toml", "[stage]\nbrightness_limit = 0.4")
    assert files.keep_good(told()[0])
    write("50.toml", "[stage]\nbrightness_limit = 4")
    machine, codes = told()
    assert machine.stage.brightness_limit == 0.4
    assert codes == ["CFG-LASTGOOD"]


def test_without_a_last_good_one_the_packaged_machine_is_used() -> None:
    write("machine.toml", 'machine = "qemu"')
    write("50.toml", "[stage]\nbrightness_limit = 4")
    loaded = files.load()
    assert (loaded.origin, loaded.machine.name) == ("packaged", "qemu")


def test_a_damaged_last_good_file_is_not_believed() -> None:
    files.keep_good(told()[0])
    files.last_good_path().write_bytes(files.last_good_path().read_bytes()[:40] + b"\0")
    write("50.toml", "x = 1")
    assert files.load().origin == "packaged"


def test_nothing_at_all_can_be_used_when_even_the_machine_is_unknown() -> None:
    write("machine.toml", 'machine = "boat"')
    with pytest.raises(ConfigError) as found:
        files.load()
    assert found.value.code == "CFG-MACHINE"


def test_the_last_good_configuration_is_written_only_when_it_is_another_one() -> None:
    machine, _ = told()
    assert files.keep_good(machine)
    assert not files.keep_good(machine)


def test_the_last_good_configuration_says_the_same_as_the_one_it_was_made_from() -> None:
    write("50.toml", '[keypad]\ndriver = "pcf8574"\nlayout = [["1", "2"], ["", "enter"]]')
    machine, _ = told()
    files.keep_good(machine)
    write("50.toml", "x = 1")
    assert files.load().machine == machine


# --- devices ------------------------------------------------------------------------------------


def test_a_device_is_made_with_its_own_settings() -> None:
    write("50.toml", "[camera]\nwidth = 320\nheight = 240\ngain = 7")
    table = told()[0].camera
    assert table is not None
    device = make_device("camera", table, VirtualClock(), None)
    assert isinstance(device, V4l2Camera) and isinstance(device.settings, V4l2Settings)
    assert (device.settings.width, device.settings.gain) == (320, 7)
    assert device_settings("camera", table) == device.settings


# --- changing it --------------------------------------------------------------------------------


def test_a_value_is_set_in_a_file_of_its_own() -> None:
    machine = files.set_value("stage.brightness_limit=0.5")
    assert machine.stage.brightness_limit == 0.5
    files.set_value("camera.rate_hz=60.0")
    assert told()[0].stage.brightness_limit == 0.5
    assert (files.etc() / files.SET_FILE).read_text() == (
        "[stage]\nbrightness_limit = 0.5\n\n[camera]\nrate_hz = 60.0\n"
    )
    assert stat.S_IMODE((files.etc() / files.SET_FILE).stat().st_mode) == 0o644


def test_what_would_break_the_configuration_is_not_set() -> None:
    files.set_value("stage.brightness_limit=0.5")
    before = (files.etc() / files.SET_FILE).read_bytes()
    wrongs = (
        "stage.brightness_limit=5", "stage.brigtness_limit=1", "camera.x=1", "nothing",
        "mask=nobody", f"camera.width={'1' * 5000}", f"name={'[' * 3000}", "machine=boat",
    )  # fmt: skip
    for wrong in wrongs:
        with pytest.raises(ConfigError):
            files.set_value(wrong)
    assert (files.etc() / files.SET_FILE).read_bytes() == before


def test_what_a_later_file_overrules_is_not_set() -> None:
    write("95-more.toml", "[stage]\nbrightness_limit = 0.3")
    with pytest.raises(ConfigError, match=r"SET-OVERRULED.*95-more\.toml"):
        files.set_value("stage.brightness_limit=0.5")
    assert not (files.etc() / files.SET_FILE).exists()


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "etc").rmdir()
    (tmp_path / "etc").write_text("a file")
    with pytest.raises(HypermaskError):
        files.set_value("stage.brightness_limit=0.5")


# --- the command --------------------------------------------------------------------------------

run = CliRunner().invoke


def test_config_check_is_content_with_a_good_configuration() -> None:
    result = run(app, ["config", "check"])
    assert result.exit_code == 0 and "good" in result.output


def test_config_check_fails_and_says_what_is_used_instead() -> None:
    files.keep_good(told()[0])
    write("50.toml", "[camera]\nwidht = 640")
    result = run(app, ["config", "check"])
    assert result.exit_code == 1
    assert "CFG-LASTGOOD" in result.output and "width" in result.output
    assert "last good configuration is used" in result.output


def test_config_check_looks_at_the_show_too() -> None:
    write("50.toml", 'show = "operetta"')
    result = run(app, ["config", "check", "--json"])
    assert result.exit_code == 1 and "SHOW-NAME" in result.output


def test_config_check_looks_into_the_mask_too(tmp_path: Path) -> None:
    shutil.copytree(paths.configs() / "masks" / "reference", tmp_path / "mask")
    write("50.toml", f'mask = "{tmp_path / "mask"}"')
    assert run(app, ["config", "check"]).exit_code == 0
    (tmp_path / "mask" / "relief.png").write_bytes(b"")
    result = run(app, ["config", "check"])
    assert result.exit_code == 1 and "MASK-RELIEF" in result.output


@pytest.mark.parametrize("name", ["operetta", "a" * 300, "/nowhere/operetta.toml"])
def test_a_show_that_cannot_play_is_not_set(name: str) -> None:
    result = run(app, ["config", "set", f"show={name}"])
    assert result.exit_code == 2 and "SHOW-NAME" in result.output
    assert not (files.etc() / files.SET_FILE).exists()


def test_a_place_that_no_service_sees_is_said_to_be_one() -> None:
    result = run(app, ["config", "set", "show=/home/anna/show.toml"])
    assert "/var/lib/hypermask" in result.output


def test_a_folder_that_may_not_be_entered_holds_no_show(monkeypatch: pytest.MonkeyPatch) -> None:
    stat_of = Path.stat

    def refused(path: Path, **options: bool) -> os.stat_result:
        if path.is_relative_to("/home/anna"):
            raise PermissionError(13, "Permission denied")
        return stat_of(path, **options)

    monkeypatch.setattr(Path, "stat", refused)
    monkeypatch.setattr(Path, "is_file", lambda path: stat.S_ISREG(path.stat().st_mode))
    told: list[str] = []
    playable_show("/home/anna/show.toml", lambda time_s, code, text: told.append(code), 0.0)
    assert told == ["SHOW-FALLBACK"]


def test_a_name_is_printed_as_it_is() -> None:
    write("50.toml", 'name = "Cart [/A] :smile:"')
    result = run(app, ["config", "check"])
    assert result.exit_code == 0 and "Cart [/A] :smile:" in result.output


def test_config_show_prints_what_can_be_read_again() -> None:
    write("50.toml", "[stage]\nbrightness_limit = 0.4")
    result = run(app, ["config", "show"])
    assert result.exit_code == 0 and "brightness_limit = 0.4" in result.output


def test_config_set_refuses_with_exit_code_2() -> None:
    result = run(app, ["config", "set", "camera.widht=3"])
    assert result.exit_code == 2 and "CFG-KEY" in result.output
