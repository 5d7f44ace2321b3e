"""MPEG-4 face animation parameters on to action units, the mouth's parameters and the gaze.

The 66 low-level parameters of ISO/IEC 14496-2, Annex C (table of FAP definitions; 1 and 2 are the
high-level visemes and expressions): whole numbers, 1024 of which are one of the face's own
distances (FAPU), angles in 1e-5 rad; left and right are the face's own. Numbers, names, units and
positive directions agree, for all 66, with the tables of two players of such streams, Xface (the
direction of every parameter) and Greta (direction, unit and feature point of every parameter). The
distances are those of the standard's feature points, as both players measure them:
IRISD0 = 3.1.y - 3.3.y (the lids' distance), ES0 = 3.5.x - 3.6.x, ENS0 = 3.5.y - 9.15.y,
MNS0 = 9.15.y - 2.2.y, MW0 = 8.3.x - 8.4.x.

Head rotations (48 to 50), the pupils' size, thrust eyeballs, the tongue's height and roll, a bent
nose and the ears move nothing here and are accepted.
"""

from __future__ import annotations

from collections.abc import Mapping

from hypermask.errors import UsageError
from hypermask.face.drive import Drive

FAPU_MM = {"MNS": 22.7, "MW": 55.5, "IRISD": 11.5, "ENS": 58.7, "ES": 62.0}
"""Mouth to nose, mouth width, between the lids, eye to nose, between the eyes: of the mesh at rest.

The nose's point is 9.15, where it meets the upper lip.
"""
_HALF_WIDTH_MM = 27.73
_ANGLE = 1e-5

Row = tuple[str, str, tuple[tuple[float, str], ...]]
"""Name, FAPU, and (mm at which it is 1, target) each; a negative length takes negative values."""


def _m(sign: float, target: str) -> tuple[float, str]:
    """A mouth parameter: its unit is the half width, and it takes both signs."""
    return sign * _HALF_WIDTH_MM, target


FAPS: dict[int, Row] = {
    3: ("open_jaw", "MNS", (_m(-1, "jaw_vertical"),)),
    4: ("lower_t_midlip", "MNS", (_m(-1, "upper_lip_lower_vertical"),)),
    5: ("raise_b_midlip", "MNS", (_m(1, "lower_lip_upper_vertical"),)),
    6: ("stretch_l_cornerlip", "MW", (_m(2, "corner_horizontal"),)),
    7: ("stretch_r_cornerlip", "MW", (_m(2, "corner_horizontal"),)),
    8: ("lower_t_lip_lm", "MNS", ((-12.0, "10L"), (12.0, "24L"))),
    9: ("lower_t_lip_rm", "MNS", ((-12.0, "10R"), (12.0, "24R"))),
    10: ("raise_b_lip_lm", "MNS", ((-10.0, "16L"), (12.0, "24L"))),
    11: ("raise_b_lip_rm", "MNS", ((-10.0, "16R"), (12.0, "24R"))),
    12: ("raise_l_cornerlip", "MNS", ((10.0, "12L"), (-9.8, "15L"))),
    13: ("raise_r_cornerlip", "MNS", ((10.0, "12R"), (-9.8, "15R"))),
    14: ("thrust_jaw", "MNS", ((8.0, "29"),)),
    15: ("shift_jaw", "MW", ((9.5, "30R"), (-9.5, "30L"))),
    16: ("push_b_lip", "MNS", (_m(1, "lower_lip_upper_depth"), _m(1, "lower_lip_lower_depth"))),
    17: ("push_t_lip", "MNS", (_m(1, "upper_lip_upper_depth"), _m(1, "upper_lip_lower_depth"))),
    18: ("depress_chin", "MNS", ((5.5, "17"),)),
    19: ("close_t_l_eyelid", "IRISD", ((11.5, "43L"), (-4.6, "5L"))),
    20: ("close_t_r_eyelid", "IRISD", ((11.5, "43R"), (-4.6, "5R"))),
    21: ("close_b_l_eyelid", "IRISD", ((2.6, "7L"),)),
    22: ("close_b_r_eyelid", "IRISD", ((2.6, "7R"),)),
    23: ("yaw_l_eyeball", "AU", ((2.0, "gaze_right"),)),
    24: ("yaw_r_eyeball", "AU", ((2.0, "gaze_right"),)),
    25: ("pitch_l_eyeball", "AU", ((-2.0, "gaze_up"),)),
    26: ("pitch_r_eyeball", "AU", ((-2.0, "gaze_up"),)),
    27: ("thrust_l_eyeball", "ES", ()),
    28: ("thrust_r_eyeball", "ES", ()),
    29: ("dilate_l_pupil", "IRISD", ()),
    30: ("dilate_r_pupil", "IRISD", ()),
    31: ("raise_l_i_eyebrow", "ENS", ((12.5, "1L"), (-11.2, "4L"))),
    32: ("raise_r_i_eyebrow", "ENS", ((12.5, "1R"), (-11.2, "4R"))),
    33: ("raise_l_m_eyebrow", "ENS", ((19.0, "2L"), (-12.0, "4L"))),
    34: ("raise_r_m_eyebrow", "ENS", ((19.0, "2R"), (-12.0, "4R"))),
    35: ("raise_l_o_eyebrow", "ENS", ((13.0, "2L"), (-6.0, "44L"))),
    36: ("raise_r_o_eyebrow", "ENS", ((13.0, "2R"), (-6.0, "44R"))),
    37: ("squeeze_l_eyebrow", "ES", ((4.5, "4L"),)),
    38: ("squeeze_r_eyebrow", "ES", ((4.5, "4R"),)),
    39: ("puff_l_cheek", "ES", ((7.0, "34L"), (-5.0, "35L"))),
    40: ("puff_r_cheek", "ES", ((7.0, "34R"), (-5.0, "35R"))),
    41: ("lift_l_cheek", "ENS", ((5.0, "6L"),)),
    42: ("lift_r_cheek", "ENS", ((5.0, "6R"),)),
    43: ("shift_tongue_tip", "MW", ((20.0, "37R"), (-20.0, "37L"))),
    44: ("raise_tongue_tip", "MNS", ()),
    45: ("thrust_tongue_tip", "MW", ((20.0, "19"),)),
    46: ("raise_tongue", "MNS", ()),
    47: ("tongue_roll", "AU", ()),
    48: ("head_pitch", "AU", ()),
    49: ("head_yaw", "AU", ()),
    50: ("head_roll", "AU", ()),
    51: ("lower_t_midlip_o", "MNS", (_m(-1, "upper_lip_upper_vertical"),)),
    52: ("raise_b_midlip_o", "MNS", (_m(1, "lower_lip_lower_vertical"),)),
    53: ("stretch_l_cornerlip_o", "MW", ((18.0, "20L"), (-22.0, "18L"))),
    54: ("stretch_r_cornerlip_o", "MW", ((18.0, "20R"), (-22.0, "18R"))),
    55: ("lower_t_lip_lm_o", "MNS", ((-12.0, "10L"), (6.8, "23L"))),
    56: ("lower_t_lip_rm_o", "MNS", ((-12.0, "10R"), (6.8, "23R"))),
    57: ("raise_b_lip_lm_o", "MNS", ((-11.0, "16L"), (6.8, "23L"))),
    58: ("raise_b_lip_rm_o", "MNS", ((-11.0, "16R"), (6.8, "23R"))),
    59: ("raise_l_cornerlip_o", "MNS", ((9.5, "13L"), (-19.0, "15L"))),
    60: ("raise_r_cornerlip_o", "MNS", ((9.5, "13R"), (-19.0, "15R"))),
    61: ("stretch_l_nose", "ENS", ((3.6, "38L"), (-4.4, "39L"))),
    62: ("stretch_r_nose", "ENS", ((3.6, "38R"), (-4.4, "39R"))),
    63: ("raise_nose", "ENS", ((4.8, "9"),)),
    64: ("bend_nose", "ENS", ()),
    65: ("raise_l_ear", "ENS", ()),
    66: ("raise_r_ear", "ENS", ()),
    67: ("pull_l_ear", "ENS", ()),
    68: ("pull_r_ear", "ENS", ()),
}
_NUMBER = {row[0]: number for number, row in FAPS.items()}


def from_mpeg4(values: Mapping[str | int, float]) -> Drive:
    """Units, mouth and gaze for parameters by number or name; absent ones are 0.

    Raises `UsageError` FACE-FAP for an unknown one (1 and 2, visemes and expressions, are no
    low-level parameters) or a value that is no number.
    """
    drive = Drive()
    for key, value in values.items():
        number = _NUMBER.get(key, -1) if isinstance(key, str) else key
        if number not in FAPS or not abs(float(value)) < 1e7:
            raise UsageError(
                "FACE-FAP",
                f"'{key}' = {value} is no face animation parameter",
                "Known are the low-level ones, 3 to 68, by number or name, such as open_jaw.",
            )
        _, fapu, targets = FAPS[number]
        size = float(value) * (_ANGLE if fapu == "AU" else FAPU_MM[fapu] / 1024)
        for full, target in targets:
            share = size / full
            if share > 0 or not target[0].isdigit():
                drive.add(target, share)
    return drive.held()
