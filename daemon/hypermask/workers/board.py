"""The topics of the blackboard: who writes what, in which layout."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hypermask.blackboard import LocalTopic, SharedTopic, Topic
from hypermask.loudspeaker.offset import LIP_SYNC
from hypermask.neck.record import HEAD, NECK
from hypermask.show.scene import SCENE
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


@dataclass(frozen=True)
class Board:
    """track: by the tracker; mouth: by the voice; scene and neck: by the show; pace, curtain and
    lip_sync: by the stage; wardrobe: by the dresser, whose costumes lie in the folder; head: by
    the pan-tilt worker; lesson: by whoever teaches the voice, lesson_result: by the voice."""

    track: Topic
    mouth: Topic
    scene: Topic
    pace: Topic
    wardrobe: Topic
    curtain: Topic
    lip_sync: Topic
    neck: Topic
    head: Topic
    lesson: Topic
    lesson_result: Topic
    folder: Path | None = None

    @staticmethod
    def local(folder: Path | None = None) -> Board:
        track, mouth, scene, pace = (LocalTopic() for _ in range(4))
        wardrobe, curtain, lip_sync, neck, head = (LocalTopic() for _ in range(5))
        return Board(
            track, mouth, scene, pace, wardrobe, curtain, lip_sync, neck, head,
            lesson=LocalTopic(), lesson_result=LocalTopic(), folder=folder,
        )  # fmt: skip

    @staticmethod
    def shared(folder: Path) -> Board:
        """Memory-mapped files in `folder` (on the appliance /run/hypermask)."""
        return Board(
            SharedTopic(folder / "track", TRACK),
            SharedTopic(folder / "mouth", MOUTH),
            SharedTopic(folder / "scene", SCENE),
            SharedTopic(folder / "pace", PACE),
            SharedTopic(folder / "wardrobe", WARDROBE),
            SharedTopic(folder / "curtain", CURTAIN),
            SharedTopic(folder / "lip_sync", LIP_SYNC),
            SharedTopic(folder / "neck", NECK),
            SharedTopic(folder / "head", HEAD),
            SharedTopic(folder / "lesson", LESSON),
            SharedTopic(folder / "lesson_result", LESSON_RESULT),
            folder,
        )
