"""The show on a Debian 13 that is switched on in QEMU, judged from outside.

The steps build on one another in this order, but each begins with a show that plays: where the one
before has failed, the machine is started anew. Run with `make appliance-test`; the report is
build/appliance-report/index.html.
"""

from __future__ import annotations

import random

import numpy as np
import pytest
from conftest import Record
from stage_references import Place
from theatre import BOOT_S, Theatre
from virtual_show import CART, PLACE, WORKERS, VirtualShow

from hypermask_sim.appliance.watch import longest_freeze_s

pytestmark = [pytest.mark.appliance, pytest.mark.timeout(5400)]

FADE_S = 3.0
"""From the first light to a face that is judged right; what is seen longer before is no face."""
ELSEWHERE = Place(1.7, right_m=0.12, up_m=-0.06, roll=12, pitch=5, yaw=20)
FAULTS = 20
AT_A_TIME = 3
SEED = 3
STANDSTILLS = (0.37, 0.4, 0.43, 0.5, 0.75)
"""Seconds of guest time; from 0.35 on an absent mask would have faded out."""


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
    record.picture(show.watcher.first_light[CART.height], "the first light")
    early = [glance for glance in seen if glance.lit > 0 and glance.before_s < face_s - FADE_S]
    record.note(f"the face by {face_s:.1f} s, {len(early)} of {len(seen)} looks saw light before")
    # A look may fall into the middle of a mode's change; what stands is seen by two.
    assert len(early) <= 1, f"something was on the screen before the face: {early}"
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


def test_machine_stands_still(show: VirtualShow) -> None:
    """The whole machine stands still for a moment: the picture goes on without a black frame"""
    show.sway()
    show.rest(2)
    for guest_s in STANDSTILLS:
        with show.never_dark():
            show.rest(0.3)
            show.cart.stand_still(guest_s * show.cart.machine.slowness)
            show.rest(0.7)
    show.hold(PLACE)
    show.shows(PLACE)


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
        frozen_s = longest_freeze_s(show.looks_since(start_s))
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
        # A start that was prepared opens some of the blackboard twice.
        assert after[f"fds {name}"] <= before[f"fds {name}"] + 5, name
        assert after[f"kB {name}"] <= before[f"kB {name}"] * 1.25 + 8192, name


def _faults() -> list[list[tuple[str, str]]]:
    """Every worker by both signals, then some again, in random order: up to three workers at a
    time, but the stage alone, for while it is away the picture stands."""
    choice = random.Random(SEED)
    all_of_them = [(name, signal) for name in WORKERS for signal in ("KILL", "STOP")]
    order = [*all_of_them, *choice.sample(all_of_them, FAULTS - len(all_of_them))]
    choice.shuffle(order)
    rounds = [[fault] for fault in order if fault[0] == "stage"]
    others = [fault for fault in order if fault[0] != "stage"]
    while others:
        group: dict[str, tuple[str, str]] = {}
        for fault in others:
            if len(group) < AT_A_TIME:
                group.setdefault(fault[0], fault)
        for fault in group.values():
            others.remove(fault)
        rounds.append(list(group.values()))
    choice.shuffle(rounds)
    return rounds
