"""Power cuts while characters, calibrations and configurations are being written.

A program in the guest writes all three, round after round, and tells the host what it has written;
at a random moment QEMU is killed and the same disk is booted again. Most boots only look at the
disk; in the last one the show must play with what was written.
"""

from __future__ import annotations

import json
import random
import time
from collections.abc import Callable
from typing import Any

import pytest
from conftest import ROOT, Record
from virtual_show import VirtualShow

from hypermask_sim.appliance.image import Image as Disk

pytestmark = [pytest.mark.appliance, pytest.mark.timeout(5400)]

WORK = ROOT / "build/appliance/cuts"
CUTS = 20
SEED = 11
PYTHON = (
    "OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1 PYTHONPATH=/usr/share/hypermask/python "
    "HYPERMASK_HOME=/var/lib/hypermask python3 /source/tests/appliance/guest_writer.py"
)
WRITTEN, FOUND = WORK / "written", WORK / "found"
KINDS = ("calibration", "character", "configuration")


def rounds() -> dict[str, int]:
    """The last round of each kind that the writer told of."""
    lines = WRITTEN.read_text("utf-8").splitlines() if WRITTEN.exists() else []
    return {kind: int(number) for kind, number in (line.split() for line in lines)}


def test_power_cuts(disk: Disk, record: Record) -> None:
    """Power cut at 20 random moments while characters, calibration, configuration are written"""
    choice = random.Random(SEED)
    show = VirtualShow(disk, WORK, keep_disk=True, show=False)
    try:
        for number in range(1, CUTS + 1):
            show.cart.wait_booted(3600)
            told = rounds()
            next_round = max(told.values(), default=0) + 1
            show.run(f"{PYTHON} {next_round} >/host/writer.log 2>&1 & echo started")
            if number > 1:
                _check(told, record, f"cut {number - 1}")
            _wait_for_rounds(next_round)
            time.sleep(choice.uniform(0.0, 6.0))
            show.power_cut()
            if number == CUTS:
                show.with_a_show()
            show.switch_on()
        show.cart.wait_booted(3600)
        show.run(f"{PYTHON} check", 300)
        _check(rounds(), record, f"cut {CUTS}")
        picture = show.face(400)
        record.picture(picture, "the show after the last power cut")
        assert "CAL-READ" not in show.journal(400)
        show.all_work()
    finally:
        show.close()


def _wait_for_rounds(number: int) -> None:
    """Until the first round is written: from then on a cut hits a program that writes."""
    _wait(lambda: rounds().get("configuration", 0) >= number)


def _wait(reached: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 900
    while not reached():
        if time.monotonic() > deadline:
            log = WORK / "writer.log"
            raise AssertionError(
                f"the writer stands still: {log.read_text() if log.exists() else ''}"
            )
        time.sleep(0.1)


def _check(told: dict[str, int], record: Record, when: str) -> None:
    """Everything that was told is there, whole, or something newer is."""
    _wait(FOUND.exists)
    found: dict[str, Any] = json.loads(FOUND.read_text("utf-8"))
    FOUND.unlink()
    record.note(f"{when}: written {told}, found { {kind: found[kind] for kind in KINDS} }")
    for kind in KINDS:
        assert told[kind] <= found[kind] <= told[kind] + 1, f"{when}: {kind}"
    assert found["warning"] is None and found["damaged"] == [], when
    assert found["texture"] and found["origin"] == "configured", when
