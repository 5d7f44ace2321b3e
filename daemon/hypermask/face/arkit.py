"""ARKit's 52 blendshapes on to action units, the mouth's parameters and the gaze.

Names are those of Apple's `ARFaceAnchor.BlendShapeLocation`; left and right are the face's own.
Values are 0 to 1. Head movements are none of the face's.
"""

from __future__ import annotations

from collections.abc import Mapping

from hypermask.errors import UsageError
from hypermask.face.drive import Drive

_GAZE_RAD = 0.28
"""An eye's share: both eyes at 1 look 0.56 rad aside."""

_BOTH: dict[str, dict[str, float]] = {
    # Written once for both sides: {} takes the side's name there and its letter here.
    "eyeBlink{}": {"43{}": 1.0},
    "eyeSquint{}": {"7{}": 0.8, "6{}": 0.2},
    "eyeWide{}": {"5{}": 1.0},
    "mouthSmile{}": {"12{}": 1.0},
    "mouthFrown{}": {"15{}": 1.0},
    "mouthDimple{}": {"14{}": 1.0},
    "mouthStretch{}": {"20{}": 1.0},
    "mouthPress{}": {"24{}": 1.0},
    "mouthLowerDown{}": {"16{}": 1.0},
    "mouthUpperUp{}": {"10{}": 1.0},
    "browDown{}": {"4{}": 1.0},
    "browOuterUp{}": {"2{}": 1.0},
    "cheekSquint{}": {"6{}": 1.0},
    "noseSneer{}": {"9{}": 1.0},
    "jaw{}": {"30{}": 1.0},
    "mouth{}": {"30{}": 0.3, "14{}": 0.6},
}
_ONE: dict[str, dict[str, float]] = {
    "browInnerUp": {"1": 1.0},
    "cheekPuff": {"34": 1.0},
    "jawForward": {"29": 1.0},
    "jawOpen": {"26": 1.0, "27": 0.35},
    "mouthClose": {"8": 1.0},
    "mouthFunnel": {"22": 1.0},
    "mouthPucker": {"18": 1.0},
    "mouthRollLower": {"lower_lip_lower_vertical": 0.18, "lower_lip_upper_depth": -0.1},
    "mouthRollUpper": {"upper_lip_upper_vertical": -0.16, "upper_lip_lower_depth": -0.1},
    "mouthShrugLower": {"17": 1.0},
    "mouthShrugUpper": {"upper_lip_upper_vertical": 0.10, "upper_lip_lower_vertical": 0.08},
    "tongueOut": {"19": 1.0},
    # The face's left is on the audience's right; "in" is towards the nose.
    "eyeLookUpLeft": {"gaze_up": _GAZE_RAD},
    "eyeLookUpRight": {"gaze_up": _GAZE_RAD},
    "eyeLookDownLeft": {"gaze_up": -_GAZE_RAD},
    "eyeLookDownRight": {"gaze_up": -_GAZE_RAD},
    "eyeLookOutLeft": {"gaze_right": _GAZE_RAD},
    "eyeLookInLeft": {"gaze_right": -_GAZE_RAD},
    "eyeLookOutRight": {"gaze_right": -_GAZE_RAD},
    "eyeLookInRight": {"gaze_right": _GAZE_RAD},
}
BLENDSHAPES: dict[str, dict[str, float]] = {
    **_ONE,
    **{
        name.format(side): {target.format(side[0]): w for target, w in targets.items()}
        for name, targets in _BOTH.items()
        for side in ("Left", "Right")
    },
}
"""Blendshape -> what it adds at 1."""


def from_arkit(values: Mapping[str, float]) -> Drive:
    """Units, mouth and gaze for blendshape values by name; absent ones are 0.

    Names may be written as Apple writes them or with underscores or other capitals.
    Raises `UsageError` FACE-ARKIT for an unknown name or a value that is not 0 to 1.
    """
    drive = Drive()
    for name, value in values.items():
        targets = _KNOWN.get(name.replace("_", "").lower())
        if targets is None:
            raise UsageError(
                "FACE-ARKIT",
                f"there is no blendshape '{name}'",
                "Known are the 52 of ARKit, such as jawOpen and mouthSmileLeft.",
            )
        if not 0 <= float(value) <= 1:
            raise UsageError("FACE-ARKIT", f"{name} is {value}", "Give a number from 0 to 1.")
        for target, share in targets.items():
            drive.add(target, share * float(value))
    return drive.held()


_KNOWN = {name.lower(): targets for name, targets in BLENDSHAPES.items()}
