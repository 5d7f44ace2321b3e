"""The show on a Debian 13 that is switched on in QEMU, judged from outside.

The steps build on one another in this order, but each begins with a show that plays: where the one
before has failed, the machine is started anew. Run with `make appliance-test`; the report is
build/appliance-report/index.html.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Record
from stage_references import Place, is_lit, likeness
from virtual_show import CART, PLACE, WORKERS, VirtualShow, codes

from hypermask_sim.appliance.image import Image as Disk
from hypermask_sim.appliance.qemu import KEYPAD, PTU

pytestmark = [pytest.mark.appliance, pytest.mark.timeout(5400)]

WORK = ROOT / "build/appliance/show"
BOOT_S = 400.0
FADE_S = 3.0
"""From the first light to a face that is judged right; what is seen longer before is no face."""
ELSEWHERE = Place(1.7, right_m=0.12, up_m=-0.06, roll=12, pitch=5, yaw=20)
FAULTS = 20
SEED = 5
STATUS = "/sys/class/drm/card0-Virtual-1/status"
CAMERA = "/dev/v4l/by-path/platform-vivid.0-video-index0"
NEXT = "+next"
FILL = (
    "mkdir -p /var/tmp/ballast; n=0; for size in 1G 128M 16M 2M 256K 32K 4K; do "
    "while fallocate -l $size /var/tmp/ballast/$n 2>/dev/null; do n=$((n + 1)); done; done"
)
"""Takes the disk's last block, those that are kept for root too."""


class Theatre:
    """The machine that the steps share."""

    def __init__(self, disk: Disk) -> None:
        self._disk = disk
        self.show: VirtualShow | None = None
        self.plays = False

    def switch_on(self) -> VirtualShow:
        self.close()
        self.show = VirtualShow(self._disk, WORK, keep_disk=True)
        return self.show

    def playing(self) -> VirtualShow:
        """A show with a face: the one that runs, or one on a machine that is started anew."""
        if self.show is not None and self.plays:
            return self.show
        show = self.switch_on()
        show.cart.wait_booted(3600)
        show.shows(PLACE, guest_s=BOOT_S)
        return show

    def close(self) -> None:
        if self.show is not None:
            self.show.close()
        self.show = None


@pytest.fixture(scope="module")
def theatre(disk: Disk) -> Iterator[Theatre]:
    theatre = Theatre(disk)
    yield theatre
    theatre.close()


@pytest.fixture(autouse=True)
def _kept(theatre: Theatre, record: Record, request: pytest.FixtureRequest) -> Iterator[None]:
    """The picture and the journal at the end of each step; a step that failed leaves a machine
    that is not trusted."""
    yield
    show = theatre.show
    failed = getattr(request.node, "failed", True)
    theatre.plays = not failed
    if show is None:
        return
    try:
        record.picture(show.picture(), "at the end of the step")
        record.log(show.journal(400 if failed else 60))
    except Exception as error:
        theatre.plays = False
        record.log(f"the machine does not answer: {error}")


@pytest.fixture
def show(theatre: Theatre) -> VirtualShow:
    return theatre.playing()


def test_cold_boot(theatre: Theatre, record: Record) -> None:
    """Cold boot, without network or login: black, then the face"""
    show = theatre.switch_on()
    agent_s = show.cart.wait_booted(3600)
    picture, verdict = show.shows(PLACE, guest_s=BOOT_S)
    face_s = show.watcher.now_s
    record.note(f"agent after {agent_s:.0f} s of the host's time")
    record.note(f"face {show.watcher.now_s:.0f} s of guest time after power-on")
    record.note(f"overlap {verdict.overlap:.3f}, {verdict.shift_px:.1f} px off")
    record.picture(picture, "the first face")
    record.picture(CART.reference(PLACE, "mean"), "where it must be")
    seen = [glance for glance in show.watcher.glances if glance.height == CART.height]
    light_s = next(glance.before_s for glance in seen if glance.lit > 0)
    record.note(f"black until {light_s:.1f} s, the face by {face_s:.1f} s")
    assert face_s - light_s <= FADE_S, "something was on the screen before the face"
    assert show.run("ls /sys/class/net").split() == ["lo"]
    assert show.run("loginctl list-sessions --no-legend; true").strip() == ""
    assert {worker.state for worker in show.all_work().values()} == {"active"}


def test_follows_the_leds(show: VirtualShow, record: Record) -> None:
    """The face follows the LEDs to another place"""
    show.hold(ELSEWHERE)
    picture, verdict = show.shows(ELSEWHERE)
    record.picture(picture, f"overlap {verdict.overlap:.3f}, {verdict.shift_px:.1f} px off")
    record.picture(CART.reference(ELSEWHERE, "mean"), "where it must be")
    show.hold(PLACE)
    show.shows(PLACE)


def test_dark_without_a_mask(show: VirtualShow) -> None:
    """No mask, no light; the mask again, the face again"""
    show.light(CART.dark_frames())
    show.dark()
    show.hold(PLACE)
    show.shows(PLACE)


def test_a_key_changes_the_expression(show: VirtualShow, record: Record) -> None:
    """A key changes the expression"""
    show.press("8")
    record.picture(show.shows(PLACE, cue="surprise")[0], "after the key 8, surprise")
    show.press("0")
    show.shows(PLACE)


def test_a_key_changes_the_character(show: VirtualShow, record: Record) -> None:
    """Another key changes the character"""
    show.press("star")
    record.picture(show.shows(PLACE, character="noh")[0], "after the key *, the next character")
    show.press("1")
    show.shows(PLACE)


def test_the_voice_moves_the_mouth(show: VirtualShow, record: Record) -> None:
    """Sound moves the mouth"""
    quiet = _mouth_moves(show)
    time_s = np.arange(16000 * 2) / 16000
    pitch = np.sign(np.sin(2 * np.pi * 120 * time_s)) * 0.3
    show.sound(pitch * (np.sin(2 * np.pi * 1.5 * time_s) > 0))
    try:
        moved = show.until(
            lambda: (now if (now := _mouth_moves(show)) > 2 * quiet + 1 else None), 90,
            "the mouth moves",
        )  # fmt: skip
        record.note(f"mouth's change {quiet:.2f} grey levels in silence, {moved:.2f} with sound")
    finally:
        show.silence()
        show.rest(5)


def _mouth_moves(show: VirtualShow) -> float:
    """How much the pixels round the mouth change, grey levels."""
    world = CART.world(PLACE)
    rotation, position = world.camera_from_mask(0.0)
    box = np.array([[-0.03, -0.035, 0.02], [0.03, -0.085, 0.02]]) @ rotation.T + position
    (left, top), (right, bottom) = np.round(world.projector.project(box)).astype(int)
    looks = [show.picture()[top:bottom, left:right].astype(float) for _ in range(10)]
    return float(np.std(looks, axis=0).mean())


def test_workers_killed_and_stopped(show: VirtualShow, record: Record) -> None:
    """kill -9 and kill -STOP of each worker, 20 times in random order"""
    before = show.leaks()
    show.sway()
    show.face()
    for faults in _faults():
        victims = [show.working(name) for name, _ in faults]
        start_s = show.watcher.now_s
        show.run("; ".join(
            f"kill -{signal} {victim.pid}"
            for victim, (_, signal) in zip(victims, faults, strict=True)
        ))  # fmt: skip
        for victim in victims:
            show.working(victim.name, not_pid=victim.pid)
        show.face(120)
        frozen_s = _freeze(show.watcher.between(start_s, show.watcher.now_s))
        record.note(
            f"{', '.join(f'{name} {signal}' for name, signal in faults)}: at work again after "
            f"{show.watcher.now_s - start_s:.0f} s of guest time, the picture stood for at most "
            f"{frozen_s:.2f} s"
        )
        if "stage" not in {victim.name for victim in victims}:
            assert frozen_s <= 1.0, f"the picture stood for {frozen_s:.2f} s"
    show.hold(PLACE)
    show.shows(PLACE)
    after = show.leaks()
    record.note(f"before: {before}")
    record.note(f"after: {after}")
    assert after["zombies"] <= before["zombies"]
    assert after["files in /run"] <= before["files in /run"] + 4
    for name in WORKERS:
        assert after[f"fds {name}"] <= before[f"fds {name}"] + 2, name
        assert after[f"kB {name}"] <= before[f"kB {name}"] * 1.25 + 8192, name


def _faults() -> list[list[tuple[str, str]]]:
    """Every worker by both signals, then some again, in random order: two workers at a time, but
    the stage alone, for while it is away the picture stands."""
    choice = random.Random(SEED)
    all_of_them = [(name, signal) for name in WORKERS for signal in ("KILL", "STOP")]
    order = [*all_of_them, *choice.sample(all_of_them, FAULTS - len(all_of_them))]
    choice.shuffle(order)
    rounds = [[fault] for fault in order if fault[0] == "stage"]
    others = [fault for fault in order if fault[0] != "stage"]
    while others:
        first = others.pop(0)
        second = next((fault for fault in others if fault[0] != first[0]), None)
        if second is not None:
            others.remove(second)
        rounds.append([first] if second is None else [first, second])
    choice.shuffle(rounds)
    return rounds


def _freeze(glances: Any) -> float:
    from hypermask_sim.appliance.watch import longest_freeze_s

    return longest_freeze_s(glances)


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
    show.until(lambda: show.worker("tracker").pid != victim.pid, 120, "the watchdog ends it", 1.0)
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
    show.run("echo 0 >/proc/sys/kernel/panic; sync; (sleep 1; echo c >/proc/sysrq-trigger) &")
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
    show.run(f"hypermask update install {names}", 900)
    told = update_status(show)
    glances = show.watcher.between(start_s, show.watcher.now_s)
    record.note(f"installed in {show.watcher.now_s - start_s:.0f} s of guest time")
    assert told["installed"].endswith(NEXT) and told["waits_for_idle"]
    assert told["playing_release"] == old["installed_release"]
    assert min(glance.lit for glance in glances) > 0.005, "the picture was missing"
    assert _freeze(glances) <= 1.0
    victim = show.working("show")
    show.run(f"kill -KILL {victim.pid}")
    show.working("show", not_pid=victim.pid)
    assert update_status(show)["playing_release"] == old["playing_release"]
    show.hold(PLACE)
    show.shows(PLACE)
    since = show.mark()
    show.press("enter")
    show.dark()
    show.until(lambda: not update_status(show)["waits_for_idle"], 300, "the takeover", 3.0)
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


__all__ = ["codes", "likeness"]
