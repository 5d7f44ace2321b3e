"""The topics of the blackboard: who writes what, in which layout."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hypermask.blackboard import LocalTopic, ReadTopic, SharedTopic, Topic
from hypermask.loudspeaker.offset import LIP_SYNC
from hypermask.neck.record import HEAD, NECK
from hypermask.show.scene import SCENE
from hypermask.stage.marks import OVERLAY
from hypermask.tracking.motion import MOTION
from hypermask.tracking.paper import POINT_MOTION
from hypermask.workers.lesson_record import LESSON, LESSON_RESULT

KEPT = 200_000
"""How many of its latest figures a worker remembers, so that a long night does not fill memory."""

TRACK = np.dtype(
    [
        ("motion", MOTION),
        ("points", POINT_MOTION),  # the paper's per-point Kalman filter
        ("seen_s", "<f8"),  # mid-exposure of the last frame in which the mask was found
        ("time_s", "<f8"),  # mid-exposure of the last frame
        ("locked", "?"),
        ("frames", "<i8"),
        ("dropped", "<i8"),
        ("camera_ready", "?"),
    ]
)
MOUTH = np.dtype(
    [
        ("time_s", "<f8"),
        ("parameters", "<f8", (13,)),
        ("level_db", "<f8"),
        ("arousal", "<f8"),  # 0 to 1, see hypermask.voice.arousal
    ]
)
PACE = np.dtype([("flip_s", "<f8"), ("period_s", "<f8"), ("latch_lead_s", "<f8")])
WARDROBE = np.dtype(
    [
        ("latest", "<i8"),
        (
            "costumes",
            [
                ("version", "<i8"),  # counts all that were ever made; 0 is none
                ("name", "S64"),
                ("file", "S96"),  # in the board's folder
                ("appear", "?"),
                ("ordered_s", "<f8"),
            ],
            (16,),
        ),
    ]
)
CURTAIN = np.dtype([("dressed", "<i8")])  # the last version that can be drawn

WORDS = np.dtype([("time_s", "<f8"), ("mode", "S24"), ("words", "S160")])
MACHINE = np.dtype(
    [
        ("time_s", "<f8"),
        # Of each device: none (this machine has no such), ready, lost.
        ("power", "S8"),
        ("volts", "<f8"),
        ("amps", "<f8"),
        ("charge", "<f8"),  # 0 to 1, NaN where the monitor cannot tell
        ("level", "S16"),  # good, low, critical, unknown
        ("lamp", "S8"),
        ("lamp_on", "?"),
        ("lamp_c", "<f8"),  # NaN where it does not say
        ("lamp_faults", "S96"),
        ("temperature_c", "<f8"),  # of the processor, NaN where the kernel does not say
        ("throttled", "<u4"),  # the firmware's flags, see workers.thermal
        ("throttling_known", "?"),
        ("usb_resets", "<i4"),
        ("key", "S16"),  # the key that was last pressed, and when
        ("key_s", "<f8"),
    ]
)

LAYOUTS: dict[str, np.dtype[np.void]] = {
    "track": TRACK,
    "mouth": MOUTH,
    "scene": SCENE,
    "pace": PACE,
    "wardrobe": WARDROBE,
    "curtain": CURTAIN,
    "lip_sync": LIP_SYNC,
    "neck": NECK,
    "head": HEAD,
    "words": WORDS,
    "machine": MACHINE,
    "lesson": LESSON,
    "lesson_result": LESSON_RESULT,
    "overlay": OVERLAY,
}
"""Every topic by its name, which is its file's and its field's in `Board` too."""


@dataclass(frozen=True)
class Board:
    """track: by the tracker; mouth: by the voice; scene, neck, words, machine and overlay: by the
    show; pace, curtain and lip_sync: by the stage; wardrobe: by the dresser, whose costumes lie in
    the folder; head: by the pan-tilt worker; lesson: by whoever teaches the voice, lesson_result:
    by the voice."""

    track: Topic
    mouth: Topic
    scene: Topic
    pace: Topic
    wardrobe: Topic
    curtain: Topic
    lip_sync: Topic
    neck: Topic
    head: Topic
    words: Topic
    machine: Topic
    lesson: Topic
    lesson_result: Topic
    overlay: Topic
    folder: Path | None = None

    @staticmethod
    def local(folder: Path | None = None) -> Board:
        return Board(folder=folder, **{name: LocalTopic() for name in LAYOUTS})

    @staticmethod
    def shared(folder: Path) -> Board:
        """Memory-mapped files in `folder` (on the appliance /run/hypermask)."""
        return Board(folder=folder, **{name: _shared(folder, name) for name in LAYOUTS})

    @staticmethod
    def reading(folder: Path, but: str | None = None) -> Board:
        """For somebody who only looks: makes no file and needs no right to write. but: a topic that
        he publishes."""
        topics: dict[str, Topic] = {
            name: _shared(folder, name) if name == but else ReadTopic(folder / name, dtype)
            for name, dtype in LAYOUTS.items()
        }
        return Board(folder=folder, **topics)


def _shared(folder: Path, name: str) -> SharedTopic:
    """A lesson may be given by everybody who may steer the show."""
    return SharedTopic(folder / name, LAYOUTS[name], 0o660 if name == "lesson" else 0o640)
