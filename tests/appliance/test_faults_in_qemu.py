"""What a cart meets on tour, on a Debian 13 in QEMU, judged from outside: devices pulled, a
full disk, a wrong configuration, hangs, updates.

As in test_show_in_qemu: the steps build on one another, but each begins with a show that plays.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, Record
from stage_references import is_lit
from theatre import BOOT_S
from virtual_show import ASK_S, PLACE, VirtualShow

from hypermask_sim.appliance.qemu import KEYPAD, PTU

pytestmark = [pytest.mark.appliance, pytest.mark.timeout(5400)]

STATUS = "/sys/class/drm/card0-Virtual-1/status"
CAMERA = "/dev/v4l/by-path/platform-vivid.0-video-index0"
NEXT = "+next"
FILL = (
    "mkdir -p /var/tmp/ballast; n=0; for size in 1G 128M 16M 2M 256K 32K 4K; do "
    "while fallocate -l $size /var/tmp/ballast/$n 2>/dev/null; do n=$((n + 1)); done; done"
)
"""Takes the disk's last block, those that are kept for root too."""


def test_keypad_unplugged(show: VirtualShow, record: Record) -> None:
    """The keypad is pulled and plugged in again"""
    since = show.mark()
    show.cart.unplug(KEYPAD)
    record.note(show.told("KEY-LOST", since))
    show.shows(PLACE)
    show.cart.plug(KEYPAD)
    record.note(show.told("KEYPAD-BACK", since))
    show.press("8")
    show.shows(PLACE, cue="surprise")
    show.press("0")
    show.shows(PLACE)


def test_pan_tilt_unplugged(show: VirtualShow, record: Record) -> None:
    """The pan-tilt unit is pulled and plugged in again"""
    since = show.mark()
    show.cart.unplug(PTU)
    record.note(show.told("PTU-LOST", since))
    show.shows(PLACE)
    show.cart.plug(PTU)
    record.note(show.told("PANTILT-BACK", since, guest_s=120))


def test_camera_unplugged(show: VirtualShow, record: Record) -> None:
    """The camera is pulled and plugged in again"""
    since = show.mark()
    show.run(f"v4l2-ctl -d {CAMERA} -c disconnect=1")
    record.note(show.told("CAM-LOST", since))
    show.dark()
    show.shows(PLACE, guest_s=120)


def test_display_off_and_on(show: VirtualShow, record: Record) -> None:
    """The display is switched off and on again"""
    since = show.mark()
    show.run(f"echo off >{STATUS}")
    record.note(show.told("PRJ-LOST", since))
    show.run(f"echo detect >{STATUS}")
    show.shows(PLACE, guest_s=120)


def test_full_disk(show: VirtualShow, record: Record) -> None:
    """The disk is full: the show goes on, a worker starts again, nothing is half-written"""
    show.run(FILL, 300)
    record.note(show.run("df / | tail -n 1").strip())
    try:
        said = show.run("hypermask config set stage.brightness_limit=0.9 2>&1; true", 120)
        record.note(said.strip())
        assert "DISK-WRITE" in said
        victim = show.working("show")
        show.run(f"kill -KILL {victim.pid}")
        show.working("show", not_pid=victim.pid)
        show.press_until("8", PLACE, "surprise")
    finally:
        show.run("rm -rf /var/tmp/ballast")
    assert show.run("hypermask config check", 120)
    show.press("0")
    show.shows(PLACE)


def test_wrong_configuration(show: VirtualShow, record: Record) -> None:
    """A wrong configuration: the last good one is used, and that is said loudly"""
    since = show.mark()
    show.run("printf '[camera]\\nwdith = 3\\n' >/etc/hypermask/80-wrong.toml")
    try:
        assert "width" in show.run("hypermask config check 2>&1; test $? = 1", 120)
        show.run("systemctl restart hypermask-tracker hypermask-stage", 300)
        record.note(show.told("CFG-LASTGOOD", since))
        show.shows(PLACE, guest_s=BOOT_S)
    finally:
        show.run("rm /etc/hypermask/80-wrong.toml")
    show.run("hypermask config check", 120)


def test_camera_delivers_nothing(show: VirtualShow, record: Record) -> None:
    """The camera delivers no more frames: it is started anew"""
    since = show.mark()
    show.run(f"v4l2-ctl -d {CAMERA} -c percentage_of_dropped_buffers=100")
    record.note(show.told("CAM-HUNG", since))
    show.dark()
    show.run(f"v4l2-ctl -d {CAMERA} -c percentage_of_dropped_buffers=0")
    show.shows(PLACE, guest_s=120)


def test_camera_hangs_in_the_kernel(show: VirtualShow, record: Record) -> None:
    """A read of the camera hangs in the kernel: the watchdog ends it, the show goes on"""
    victim = show.working("tracker")
    show.run(
        "systemd-run --unit=cart-hang -q python3 /source/tests/appliance/guest_hang.py "
        f"{CAMERA} && sleep 1 && systemctl is-active cart-hang"
    )
    show.dark()
    stacks = show.run(f"cat /proc/{victim.pid}/task/*/stack 2>/dev/null; true")
    record.log(f"where the tracker hangs:\n{stacks}\n")
    show.until(lambda: show.worker("tracker").pid != victim.pid, 120, "the watchdog ends it", ASK_S)
    show.run("systemctl stop cart-hang")
    show.working("tracker", not_pid=victim.pid)
    show.shows(PLACE, guest_s=120)
    assert (
        "watchdog"
        in show.run(
            "journalctl -b --no-pager -o cat UNIT=hypermask-tracker.service | tail -n 40"
        ).lower()
    )


def test_hung_stage(show: VirtualShow, record: Record) -> None:
    """The stage hangs: the watchdog starts it anew"""
    victim = show.working("stage")
    start_s = show.watcher.now_s
    show.run(f"kill -STOP {victim.pid}")
    show.working("stage", not_pid=victim.pid)
    show.shows(PLACE, guest_s=120)
    record.note(f"the face is back after {show.watcher.now_s - start_s:.0f} s of guest time")


def test_hung_system(show: VirtualShow, record: Record) -> None:
    """The whole system hangs: the hardware watchdog resets it, and the show is back"""
    start_s = show.watcher.now_s
    show.cart.forget_events()
    show.run(
        "echo 0 >/proc/sys/kernel/panic; sync; (sleep 1; echo c >/proc/sysrq-trigger) "
        ">/dev/null 2>&1 &"
    )
    event = show.cart.wait_event("WATCHDOG", 3600)
    assert event["data"]["action"] == "reset"
    record.note(f"reset {show.watcher.now_s - start_s:.0f} s of guest time after the hang")
    show.cart.wait_booted(3600)
    show.shows(PLACE, guest_s=BOOT_S)
    record.note(f"the face is back after {show.watcher.now_s - start_s:.0f} s of guest time")
    show.all_work()


def update_status(show: VirtualShow) -> dict[str, Any]:
    return dict(json.loads(show.run("hypermask update status --json", 120)))


def test_upgrade(show: VirtualShow, record: Record, next_debs: list[Path]) -> None:
    """A new version in the middle of the show: it goes on, and the new one comes when it is dark"""
    show.all_work()
    old = update_status(show)
    names = " ".join(f"/source/{deb.relative_to(ROOT)}" for deb in next_debs)
    show.sway()
    show.face()
    start_s = show.watcher.now_s
    with show.never_dark():
        show.run(f"hypermask update install {names}", 900)
        told = update_status(show)
    record.note(f"installed in {show.watcher.now_s - start_s:.0f} s of guest time")
    assert told["installed"].endswith(NEXT) and told["waits_for_idle"]
    assert told["playing_release"] == old["installed_release"]
    victim = show.working("show")
    show.run(f"kill -KILL {victim.pid}")
    show.working("show", not_pid=victim.pid)
    assert update_status(show)["playing_release"] == old["playing_release"]
    show.hold(PLACE)
    show.shows(PLACE)
    since = show.mark()
    show.press("enter")
    show.dark()
    show.until(lambda: not update_status(show)["waits_for_idle"], 300, "the takeover", 2 * ASK_S)
    record.note(show.told("UPD-TAKEOVER", since))
    show.all_work()
    if not is_lit(show.picture()).any():  # a blackout may outlive the takeover
        show.press("enter")
    show.shows(PLACE, guest_s=BOOT_S)


def test_rollback(show: VirtualShow, record: Record) -> None:
    """Back to the version before"""
    before = update_status(show)
    assert before["installed"].endswith(NEXT), "the upgrade is the step before this one"
    show.run("hypermask update rollback --now", 900)
    after = update_status(show)
    assert after["installed"] == before["previous"]
    assert after["playing_release"] == after["installed_release"]
    record.note(f"{before['installed']} -> {after['installed']}")
    show.all_work()
    show.shows(PLACE, guest_s=BOOT_S)


def test_purge(show: VirtualShow, record: Record) -> None:
    """Purged, nothing is left behind"""
    show.run("dpkg --purge hypermask-sim hypermask", 600)
    show.dark()
    left = show.run(
        "find / -xdev -path /proc -prune -o -path /host -prune -o -path /source -prune -o "
        "-iname '*hypermask*' -print; find /run /dev -iname '*hypermask*'; "
        "pgrep -af '[h]ypermask.services'; dpkg-query -W 'hypermask*' 2>/dev/null; true",
        300,
    )
    left = "\n".join(line for line in left.splitlines() if "/var/log/journal" not in line)
    record.log(f"left behind:\n{left}\n")
    assert left.strip() == ""
