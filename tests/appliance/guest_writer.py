"""Runs inside the guest: writes a calibration, a character and a configuration, again and again.

Each carries the number of its round. What has been written is told to the host line by line in
/host/written, before the next is begun. `guest_writer.py FIRST_ROUND` tells before, as JSON in
/host/found, what is there; `guest_writer.py check` does no more than that.
"""

import json
import os
import sys
from pathlib import Path

import numpy as np

from hypermask import paths
from hypermask.calibration import storage
from hypermask.calibration.outcome import Outcome
from hypermask.calibration.parallax import Parallax
from hypermask.calibration.planar import Planar
from hypermask.face.character import Character, load_character, save_character
from hypermask.geometry import FACING, Pose
from hypermask.machine import files
from hypermask_drivers.mask import load_mask

TOLD = Path("/host/written")
FOUND = Path("/host/found")
NAME = "cutlass"
SIDE = 512
DISTANCE_M = 1.4


def calibration(number: int) -> Outcome:
    """The virtual cart's own at 1.4 m, so that a show can play; its number in the distance."""
    table = files.load().machine.optics
    camera, projector = table.camera, table.projector
    scale = projector.focal_px / camera.focal_px
    middle = (camera.width - 1) / 2, (camera.height - 1) / 2
    centre = (projector.width - 1) / 2, projector.height - 0.5
    left = projector.focal_px * projector.position_m[0] / DISTANCE_M
    homography = np.array([
        [scale, 0, centre[0] - scale * middle[0] - left],
        [0, scale, centre[1] - scale * middle[1]],
        [0, 0, 1],
    ])  # fmt: skip
    distance_m = DISTANCE_M + number * 1e-4
    mask = load_mask(paths.configs() / "masks" / "reference")
    pose = Pose(FACING, np.array([0.0, 0.0, distance_m]))
    parallax = Parallax.of(pose, np.array(projector.position_m), mask, 0.001)
    planar = Planar(homography, "affine", distance_m, (1.3, 1.5), parallax, 1.0)
    return Outcome(planar, None, ())


def character(number: int) -> Character:
    texture = np.full((SIDE, SIDE, 3), number % 251, np.uint8)
    eyes = np.zeros((112, 320, 3), np.uint8)
    return Character(NAME, f"round {number}", "2000-01-01", texture, eyes)


def write_for_ever(first: int) -> None:
    with TOLD.open("a") as told:
        number = first
        while True:
            storage.save(calibration(number), "affine")
            _tell(told, "calibration", number)
            save_character(character(number), paths.home() / "characters" / NAME, compression=1)
            _tell(told, "character", number)
            files.set_value(f"stage.fade_in_s={_setting(number):.6f}")
            _tell(told, "configuration", number)
            number += 1


def _setting(number: int) -> float:
    return 0.01 + number * 1e-6


def _tell(told, kind: str, number: int) -> None:
    told.write(f"{kind} {number}\n")
    told.flush()
    os.fsync(told.fileno())


def check() -> dict:
    stored, warning = storage.load_current()
    texture = load_character(paths.home() / "characters" / NAME)
    loaded = files.load()
    half = [str(path) for path in paths.home().rglob(".*") if path.is_file() or path.is_dir()]
    return {
        "calibration": round((stored.calibration.distance_m - DISTANCE_M) * 1e4),
        "warning": warning,
        "damaged": [entry.name for entry in storage.history() if entry.problem],
        "character": int(texture.source.split()[1]),
        "texture": bool((texture.texture == int(texture.source.split()[1]) % 251).all()),
        "configuration": round((loaded.machine.stage.fade_in_s - 0.01) * 1e6),
        "origin": loaded.origin,
        "half": half,
    }


def tell_what_is_there() -> None:
    part = FOUND.with_name("found.part")
    part.write_text(json.dumps(check()))
    part.rename(FOUND)


if __name__ == "__main__":
    if sys.argv[1] == "check":
        tell_what_is_there()
    else:
        first = int(sys.argv[1])
        if first > 1:
            tell_what_is_there()
        write_for_ever(first)
