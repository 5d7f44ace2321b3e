"""The doctor names cause and remedy, and mends only what is safe, saying what it did."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from hypermask.errors import HypermaskError
from hypermask.technician import checks, checks_appliance
from hypermask.technician.doctor import AT_HOME, EVERYWHERE, ON_THE_CART, Check, examine
from hypermask.technician.units import TARGET, units
from hypermask.workers.board import Board
from hypermask.workers.health import Health
from hypermask_drivers.clock import RealClock


@pytest.fixture(autouse=True)
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("HOME", "RUN", "ETC"):
        monkeypatch.setenv(f"HYPERMASK_{name}", str(tmp_path / name.lower()))
        (tmp_path / name.lower()).mkdir()
    return tmp_path


class Systemd:
    """Answers as systemctl does; `asked` is what it was told to do."""

    def __init__(self, **states: str) -> None:
        self.states = {
            TARGET: "active", **{f"hypermask-{name}.service": "active" for name in
            ("stage", "tracker", "voice", "pantilt", "show", "dresser")},
            "hypermask-safe.service": "inactive",
        }  # fmt: skip
        self.states |= {f"hypermask-{name}.service": state for name, state in states.items()}
        self.enabled = "enabled"
        self.asked: list[list[str]] = []

    def __call__(self, command: Sequence[str]) -> tuple[int, str]:
        if command[1] == "show":
            names = [word for word in command[2:] if not word.startswith("-")]
            return 0, "\n\n".join(self._unit(name) for name in names)
        self.asked.append(list(command[1:]))
        if command[1] == "restart":
            self.states |= dict.fromkeys(command[2:], "active")
        if command[1] == "enable":
            self.enabled = "enabled"
        return 0, ""

    def _unit(self, name: str) -> str:
        state = self.states.get(name, "")
        result = "watchdog" if state == "failed" else "success"
        return "\n".join(
            (f"Id={name}", f"LoadState={'loaded' if state else 'not-found'}",
             f"ActiveState={state}", "SubState=x", f"Result={result}", "NRestarts=2",
             f"UnitFileState={self.enabled}")
        )  # fmt: skip


def refused(check: object, *arguments: object) -> HypermaskError:
    with pytest.raises(HypermaskError) as caught:
        check(*arguments)  # type: ignore[operator]
    assert caught.value.remedy.strip() and caught.value.remedy.strip().endswith(".")
    return caught.value


# --- services -------------------------------------------------------------------------------------


def test_units_are_read_as_systemd_prints_them() -> None:
    found = units(run_it=Systemd(voice="failed"))
    assert found["hypermask-voice.service"].result == "watchdog"
    assert found["hypermask-voice.service"].restarts == 2


def test_a_failed_service_is_named_and_started_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    systemd = Systemd(voice="failed")
    assert "hypermask-voice.service (watchdog)" in refused(checks_appliance.services, systemd).what
    check = Check(
        "services",
        lambda: checks_appliance.services(systemd),
        lambda: checks_appliance.restart_failed(systemd),
    )
    (finding,) = examine(fix=True, chosen=(check,))
    assert finding.fine and finding.fixed == "restarted hypermask-voice.service"
    assert systemd.asked == [
        ["reset-failed", "hypermask-voice.service"], ["restart", "hypermask-voice.service"],
    ]  # fmt: skip


def test_a_show_that_somebody_stopped_is_not_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    systemd = Systemd()
    systemd.states = dict.fromkeys(systemd.states, "inactive")
    assert refused(checks_appliance.services, systemd).code == "DOC-STOPPED"
    assert refused(checks_appliance.restart_failed, systemd).code == "DOC-FIX"
    assert systemd.asked == []


def test_what_failed_before_the_show_was_stopped_is_not_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    systemd = Systemd(stage="failed")
    systemd.states[TARGET] = "inactive"
    assert refused(checks_appliance.restart_failed, systemd).code == "DOC-FIX"
    assert systemd.asked == []


def test_a_safe_state_that_failed_does_not_end_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    systemd = Systemd(safe="failed", voice="failed")
    checks_appliance.restart_failed(systemd)
    safe, voice = "hypermask-safe.service", "hypermask-voice.service"
    assert ["restart", voice] in systemd.asked
    assert {safe, voice} == set(systemd.asked[0][1:]) and systemd.asked[0][0] == "reset-failed"
    assert not any(safe in asked for asked in systemd.asked[1:])


def test_the_safe_state_is_named() -> None:
    assert refused(checks_appliance.services, Systemd(safe="active")).code == "DOC-SAFE"


def test_nobody_but_root_restarts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    systemd = Systemd(voice="failed")
    assert refused(checks_appliance.restart_failed, systemd).code == "DOC-ROOT"
    assert systemd.asked == []


def test_a_show_that_does_not_start_with_the_machine_is_enabled(
    machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    systemd = Systemd()
    systemd.enabled = "disabled"
    assert refused(checks_appliance.start_up, systemd).code == "DOC-DISABLED"
    assert TARGET in checks_appliance.enable(systemd)
    assert refused(checks_appliance.start_up, systemd).code == "DOC-MACHINE"
    (machine / "etc" / "machine.toml").write_text('machine = "sim"\n')
    assert "starts with the machine" in checks_appliance.start_up(systemd)


# --- folders, blackboard, disk --------------------------------------------------------------------


def test_missing_folders_are_made_and_named(machine: Path) -> None:
    assert refused(checks.folders).code == "DOC-FOLDER"
    (finding,) = examine(fix=True, chosen=(Check("f", checks.folders, checks.make_folders),))
    assert finding.fine and str(machine / "home" / "characters") in finding.fixed
    assert (machine / "home" / "shows").is_dir()


def test_a_finding_without_fix_changes_nothing(machine: Path) -> None:
    (finding,) = examine(chosen=(Check("f", checks.folders, checks.make_folders),))
    assert not finding.fine and finding.fixable and finding.fixed == ""
    assert not (machine / "home" / "shows").exists()


def stale_board(machine: Path) -> Path:
    board = machine / "run" / "board"
    Board.shared(board)
    data = bytearray((board / "scene").read_bytes())
    data[8] ^= 0xFF
    (board / "scene").write_bytes(data)
    return board


def test_a_blackboard_of_another_version_is_removed(machine: Path) -> None:
    board = stale_board(machine)
    assert refused(checks.blackboard).code == "BOARD-LAYOUT"
    check = Check("b", checks.blackboard, checks.remove_blackboard)
    (finding,) = examine(fix=True, chosen=(check,))
    assert finding.fine and "removed" in finding.fixed and not board.exists()


def test_a_blackboard_in_use_is_left_alone(machine: Path) -> None:
    board = stale_board(machine)
    Health(board, "stage", RealClock()).publish(now=True)
    check = Check("b", checks.blackboard, checks.remove_blackboard)
    (finding,) = examine(fix=True, chosen=(check,))
    assert not finding.fine and "in use by stage" in finding.message and board.exists()


def test_a_full_disk_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    import shutil

    usage = shutil.disk_usage("/")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=50_000_000))
    assert refused(checks.disk).code == "DOC-DISK"


# --- the rest -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("states", "code"),
    [({}, "DOC-WATCHDOG-NONE"), ({"watchdog0": "inactive"}, "DOC-WATCHDOG")],
)
def test_a_watchdog_that_is_not_armed_is_told(
    tmp_path: Path, states: dict[str, str], code: str
) -> None:
    for name, state in states.items():
        folder = tmp_path / "sys/class/watchdog" / name
        folder.mkdir(parents=True)
        (folder / "state").write_text(f"{state}\n")
    assert refused(checks_appliance.watchdog, tmp_path).code == code


def test_one_armed_watchdog_is_enough(tmp_path: Path) -> None:
    for name, state in (("watchdog0", "inactive"), ("watchdog1", "active")):
        folder = tmp_path / "sys/class/watchdog" / name
        folder.mkdir(parents=True)
        (folder / "state").write_text(state)
        (folder / "timeout").write_text("20\n")
    assert checks_appliance.watchdog(tmp_path) == "watchdog1 is armed, 20 s"


def test_a_clock_of_1970_is_told() -> None:
    assert "1970-01-01" in refused(checks_appliance.clock, 100.0).what
    assert checks_appliance.clock(time.time())


def test_heat_is_told(tmp_path: Path) -> None:
    zone = tmp_path / "class/thermal/thermal_zone0"
    zone.mkdir(parents=True)
    (zone / "temp").write_text("85000")
    assert refused(checks.heat, tmp_path).code == "DOC-HEAT"
    (zone / "temp").write_text("55000")
    assert checks.heat(tmp_path).startswith("55 degrees C")


def test_a_sound_card_is_looked_for(tmp_path: Path, machine: Path) -> None:
    (machine / "etc" / "m.toml").write_text('machine = "cart"\n')
    (tmp_path / "proc/asound").mkdir(parents=True)
    cards = tmp_path / "proc/asound/cards"
    cards.write_text("--- no soundcards ---\n")
    assert refused(checks_appliance.sound, tmp_path).code == "DOC-SOUND"
    cards.write_text(" 0 [hypermask      ]: USB-Audio - Mic\n                      Mic at usb\n")
    assert checks_appliance.sound(tmp_path) == "hypermask"


def test_a_broken_configuration_is_told_with_what_is_used(machine: Path) -> None:
    (machine / "etc" / "m.toml").write_text('machine = "sim"\ncolour = 3\n')
    error = refused(checks.configuration)
    assert error.code == "CFG-LASTGOOD" and "colour" in error.what


def test_devices_that_are_not_there_are_named(machine: Path) -> None:
    (machine / "etc" / "m.toml").write_text('machine = "cart"\n')
    error = refused(checks_appliance.devices)
    assert error.code == "DOC-DEVICES" and "/dev/hypermask/camera" in error.what


def test_a_cart_without_a_calibration_is_told(machine: Path) -> None:
    assert refused(checks_appliance.calibration).code == "CAL-NONE"


def test_a_recent_fault_is_told_and_an_old_one_remembered(machine: Path) -> None:
    assert checks_appliance.last_fault() == "none on record"
    folder = machine / "home" / "faults"
    folder.mkdir()
    (folder / "000001-hypermask-voice.json").write_text(
        '{"unit": "hypermask-voice", "how": "its work stood still", "utc": "2026-01-02T03:04:05Z",'
        ' "last": ["a", "SND-LOST: the microphone vanished."]}'
    )
    assert "SND-LOST" in refused(checks_appliance.last_fault).what
    assert "its work stood still" in checks_appliance.last_fault(time.time() + 30 * 86400)
    (folder / "000002-x.json").write_text("\x00")
    assert "cannot be read" in checks_appliance.last_fault()


def test_who_asks_is_told_what_they_may_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert checks_appliance.operator() == "root"


def test_one_check_that_breaks_hides_no_other() -> None:
    def broken() -> str:
        raise RuntimeError("boom")

    findings = examine(chosen=(Check("a", broken), Check("b", lambda: "fine")))
    assert [(finding.fine, finding.code) for finding in findings] == [
        (False, "DOC-CHECK"), (True, ""),
    ]  # fmt: skip


def test_every_check_has_a_name_of_its_own() -> None:
    for checks_of in ((*EVERYWHERE, *ON_THE_CART), (*EVERYWHERE, *AT_HOME)):
        names = [check.name for check in checks_of]
        assert len(set(names)) == len(names)
