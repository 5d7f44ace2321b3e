"""The units: what the show is promised by systemd, read from their files and by systemd-analyze."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from hypermask.machine.settings import WORKERS

ROOT = Path(__file__).parents[2]
UNITS = sorted((ROOT / "systemd").glob("*.service"))
NAMES = [path.name for path in UNITS]
WORKER_UNITS = [f"hypermask-{name}.service" for name in WORKERS]
CONFIGURED = "/etc/hypermask/*.toml"
analyze = pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="no systemd-analyze here")


def settings(name: str) -> dict[str, list[str]]:
    """All values of each key of a unit, its drop-in folders included."""
    stem = name.split(".")[0]
    files = [ROOT / "systemd" / name]
    for folder in ("hypermask-.service.d", f"{stem}.service.d"):
        files += sorted((ROOT / "systemd" / folder).glob("*.conf"))
    found: dict[str, list[str]] = {}
    for path in files:
        for line in path.read_text("utf-8").splitlines():
            key, equals, value = line.partition("=")
            if equals and not line.startswith("#"):
                found.setdefault(key, []).append(value)
    return found


def only(name: str, key: str) -> str:
    """The value that counts: the last one."""
    return settings(name)[key][-1]


@analyze
@pytest.mark.parametrize("name", NAMES)
def test_exposure_is_at_most_2_5(name: str) -> None:
    done = subprocess.run(
        [
            "systemd-analyze",
            "security",
            "--offline=true",
            "--threshold=25",
            ROOT / "systemd" / name,
        ],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout[-200:] + done.stderr


@analyze
def test_systemd_understands_every_unit() -> None:
    paths = [*UNITS, ROOT / "systemd" / "hypermask.target"]
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", *paths], capture_output=True, text=True
    )
    # What the package installs is not there in a checkout.
    # RestartMode is newer than the systemd of Debian 12.
    ignored = ("is not executable", "'RestartMode'")
    said = [line for line in done.stderr.splitlines() if not any(word in line for word in ignored)]
    assert not [line for line in said if "hypermask" in line], done.stderr


@pytest.mark.parametrize("name", NAMES)
def test_no_service_runs_as_root_except_those_that_must(name: str) -> None:
    root = {"hypermask-code.service", "hypermask-repair.service"}
    assert settings(name).get("User", ["root"])[-1] == ("root" if name in root else "hypermask")


@pytest.mark.parametrize("name", [*NAMES, "hypermask.target"])
def test_nothing_waits_for_a_network_or_a_login(name: str) -> None:
    order = " ".join(
        " ".join(settings(name).get(key, [])) for key in ("After", "Requires", "Wants")
    )
    assert not re.search(r"network|systemd-user-sessions|getty|time-(sync|set)|udev-settle", order)


@pytest.mark.parametrize("name", WORKER_UNITS)
def test_a_worker_is_watched_restarted_and_given_up_with_the_reason_on_record(name: str) -> None:
    assert only(name, "Type") == "notify"
    assert float(only(name, "WatchdogSec")) > 0
    assert only(name, "Restart") == "always"
    # Otherwise OnFailure comes at every restart, not only when the service is given up.
    assert only(name, "RestartMode") == "direct"
    assert only(name, "RestartPreventExitStatus") == "78"
    assert int(only(name, "StartLimitBurst")) > 3
    assert "hypermask-fault@%p.service" in only(name, "OnFailure").split()


@pytest.mark.parametrize("name", WORKER_UNITS)
def test_a_worker_that_hangs_is_given_up_after_as_many_starts_as_one_that_dies(name: str) -> None:
    stop_s = 2 * float(only(name, "TimeoutStopSec"))  # SIGTERM, then SIGKILL
    at_start_s = float(only(name, "TimeoutStartSec")) + stop_s
    at_work_s = float(only(name, "WatchdogSec")) + float(only(name, "TimeoutAbortSec")) + stop_s
    started_s = 30.0
    assert only(name, "RestartSec") == "200ms"
    longest_s = max(at_start_s, started_s + at_work_s) + 0.2
    burst = int(only(name, "StartLimitBurst"))
    assert burst == 10
    assert float(only(name, "StartLimitIntervalSec")) > burst * longest_s


@pytest.mark.parametrize("name", [*WORKER_UNITS, "hypermask-safe.service"])
def test_a_service_that_ends_itself_when_asked_to_has_not_failed(name: str) -> None:
    """hypermask.services.service: a device that does not close in time."""
    assert only(name, "SuccessExitStatus") == "SIGALRM"


@pytest.mark.parametrize("name", ["stage", "tracker", "show"])
def test_without_picture_mask_or_keys_the_show_ends_dark_and_parked(name: str) -> None:
    assert "hypermask-safe.service" in only(f"hypermask-{name}.service", "OnFailure").split()


@pytest.mark.parametrize("name", ["voice", "pantilt", "dresser"])
def test_the_picture_goes_on_without_the_others(name: str) -> None:
    assert "hypermask-safe.service" not in only(f"hypermask-{name}.service", "OnFailure").split()


def test_the_safe_state_takes_projector_and_head_over() -> None:
    conflicts = only("hypermask-safe.service", "Conflicts").split()
    assert {"hypermask-stage.service", "hypermask-pantilt.service"} <= set(conflicts)
    # A restart of the target shall start the stage, not this again.
    assert "hypermask.target" not in settings("hypermask-safe.service").get("PartOf", [""])[-1]
    devices = set(settings("hypermask-safe.service")["DeviceAllow"])
    for name in ("stage", "pantilt"):
        assert set(settings(f"hypermask-{name}.service")["DeviceAllow"]) <= devices


@pytest.mark.parametrize("name", [*WORKER_UNITS, "hypermask.target", "hypermask-code.service"])
def test_it_starts_only_where_there_is_a_configuration(name: str) -> None:
    """A developer's PC has the package and no /etc/hypermask/*.toml."""
    assert only(name, "ConditionPathExistsGlob") == CONFIGURED


def test_the_login_prompt_leaves_the_projector_on_a_cart_alone() -> None:
    drop = (ROOT / "systemd" / "getty@tty1.service.d" / "50-hypermask.conf").read_text("utf-8")
    assert f"ConditionPathExistsGlob=!{CONFIGURED}" in drop


@pytest.mark.parametrize("name", WORKER_UNITS)
def test_the_target_has_all_workers(name: str) -> None:
    assert only(name, "WantedBy") == "hypermask.target"
    assert "hypermask.target" in only(name, "PartOf").split()


@pytest.mark.parametrize("name", WORKER_UNITS)
def test_a_worker_runs_the_shows_own_copy_of_the_code(name: str) -> None:
    assert "PYTHONPATH=/run/hypermask/code/python" in " ".join(settings(name)["Environment"])
    assert "hypermask-code.service" in only(name, "PartOf").split()
    assert "hypermask-code.service" in only(name, "After").split()


@pytest.mark.parametrize(
    ("name", "devices"),
    [
        ("stage", {"char-drm", "char-fb", "/dev/tty0"}),
        ("tracker", {"char-video4linux", "char-media"}),
        ("voice", {"char-alsa"}),
        ("pantilt", {"char-ttyUSB", "char-ttyACM", "char-ttyS", "char-ttyAMA"}),
        ("show", {"char-usb_device", "char-i2c"}),
        ("dresser", set()),
    ],
)
def test_a_worker_gets_its_own_devices_and_no_others(name: str, devices: set[str]) -> None:
    found = settings(f"hypermask-{name}.service")
    assert found["DevicePolicy"][-1] == "closed"
    assert {value.split()[0] for value in found.get("DeviceAllow", [])} == devices


def test_the_kinds_of_devices_are_known_before_the_workers_start() -> None:
    """A device that comes later is allowed only if its kind was known when the service started."""
    modules = (ROOT / "debian" / "modules.conf").read_text("utf-8").split()
    assert {"usbserial", "cdc-acm", "i2c-dev", "videodev", "snd", "drm"} <= set(modules)
    for name in ("stage", "tracker", "voice", "pantilt", "show"):
        after = only(f"hypermask-{name}.service", "After").split()
        assert "systemd-modules-load.service" in after


def test_only_a_boot_repairs_what_dpkg_left() -> None:
    """The package's postinst starts hypermask.target, and then dpkg has not ended yet."""
    wanted = [
        path.name
        for path in [*UNITS, ROOT / "systemd" / "hypermask.target"]
        if "hypermask-repair.service" in " ".join(
            " ".join(settings(path.name).get(key, [])) for key in ("Wants", "Requires", "Upholds")
        )
    ]  # fmt: skip
    assert wanted == []
    assert only("hypermask-repair.service", "WantedBy") == "multi-user.target"
    assert only("hypermask.target", "WantedBy") == "multi-user.target"
    assert "hypermask-code.service" in only("hypermask-repair.service", "Before").split()
    assert "!/run/hypermask/code" in settings("hypermask-repair.service")["ConditionPathExists"]


def test_a_repair_hides_systemd_from_maintainer_scripts_and_not_from_itself() -> None:
    """A "+" before a command does not take it out of the mounts of its service."""
    found = settings("hypermask-repair.service")
    assert found["TemporaryFileSystem"] == ["/run/systemd"]
    (after,) = found["ExecStartPost"]
    assert after.startswith("-+/usr/bin/nsenter --mount=/proc/1/ns/mnt ")
    assert after.endswith("systemctl daemon-reload")


def test_voice_and_loudspeaker_share_the_microphone() -> None:
    """dsnoop is System V memory of one user."""
    for name in ("hypermask-voice.service", "hypermask-loudspeaker.service"):
        found = settings(name)
        assert not {"PrivateIPC", "RemoveIPC", "DynamicUser"} & set(found)
        assert found["User"][-1] == "hypermask"


@pytest.mark.parametrize("name", WORKERS[:-1])
def test_real_time_is_allowed_without_capabilities(name: str) -> None:
    found = settings(f"hypermask-{name}.service")
    assert int(found["LimitRTPRIO"][-1]) >= 90
    assert found["LimitMEMLOCK"][-1] == "infinity"
    assert "RestrictRealtime" not in found
    assert found["CapabilityBoundingSet"][-1] == ("CAP_SYS_TTY_CONFIG" if name == "stage" else "")


def test_the_hardware_watchdog_is_armed() -> None:
    text = (ROOT / "systemd" / "watchdog.conf").read_text("utf-8")
    assert re.search(r"^RuntimeWatchdogSec=\d+s$", text, re.MULTILINE)
