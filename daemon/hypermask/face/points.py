"""Which of the 468 landmarks is what. Left and right are the audience's (the photograph's)."""

from __future__ import annotations

OVAL = (
    *(10, 338, 297, 332, 284, 251, 389, 356, 454, 323, 361, 288, 397, 365, 379, 378, 400, 377),
    *(152, 148, 176, 149, 150, 136, 172, 58, 132, 93, 234, 127, 162, 21, 54, 103, 67, 109),
)
"""Outline of the face, clockwise as seen, from the middle of the forehead."""

UPPER_LIP_OUTER = (61, 185, 40, 39, 37, 0, 267, 269, 270, 409, 291)
UPPER_LIP_INNER = (78, 191, 80, 81, 82, 13, 312, 311, 310, 415, 308)
LOWER_LIP_INNER = (78, 95, 88, 178, 87, 14, 317, 402, 318, 324, 308)
LOWER_LIP_OUTER = (61, 146, 91, 181, 84, 17, 314, 405, 321, 375, 291)
"""Eleven points each from the left corner to the right one; corners are shared."""

LIPS_INNER = UPPER_LIP_INNER + LOWER_LIP_INNER[-2:0:-1]
LIPS_OUTER = UPPER_LIP_OUTER + LOWER_LIP_OUTER[-2:0:-1]

LIP_COLUMNS = (
    *((61, 76, 62, 78), (185, 184, 183, 191), (40, 74, 42, 80), (39, 73, 41, 81)),
    *((37, 72, 38, 82), (0, 11, 12, 13), (267, 302, 268, 312), (269, 303, 271, 311)),
    *((270, 304, 272, 310), (409, 408, 407, 415), (291, 306, 292, 308), (146, 77, 96, 95)),
    *((91, 90, 89, 88), (181, 180, 179, 178), (84, 85, 86, 87), (17, 16, 15, 14)),
    *((314, 315, 316, 317), (405, 404, 403, 402), (321, 320, 319, 318), (375, 307, 325, 324)),
)
"""Across each lip from its outer to its inner outline."""

LEFT_LID_UPPER = (33, 246, 161, 160, 159, 158, 157, 173, 133)
LEFT_LID_LOWER = (33, 7, 163, 144, 145, 153, 154, 155, 133)
RIGHT_LID_UPPER = (362, 398, 384, 385, 386, 387, 388, 466, 263)
RIGHT_LID_LOWER = (362, 382, 381, 380, 374, 373, 390, 249, 263)
"""Nine points each from left to right; corners are shared."""

LEFT_EYE = LEFT_LID_UPPER + LEFT_LID_LOWER[-2:0:-1]
RIGHT_EYE = RIGHT_LID_UPPER + RIGHT_LID_LOWER[-2:0:-1]
OPENINGS = (LEFT_EYE, RIGHT_EYE, LIPS_INNER)

JAW = (58, 172, 136, 150, 149, 176, 148, 152, 377, 400, 378, 379, 365, 397, 288)
"""Outline of the lower jaw from left to right."""

LEFT_BROW = (70, 63, 105, 66, 107, 55, 65, 52, 53, 46)
RIGHT_BROW = (300, 293, 334, 296, 336, 285, 295, 282, 283, 276)
NOSE = (168, 6, 197, 195, 5, 4, 1, 2, 98, 327, 129, 358, 64, 294, 48, 278)

FEATURES = {
    "brow_inner_left": 107,
    "brow_inner_low_left": 55,
    "brow_middle_left": 105,
    "brow_outer_left": 70,
    "lid_upper_inner_left": 157,
    "lid_upper_left": 159,
    "lid_upper_outer_left": 161,
    "lid_lower_inner_left": 154,
    "lid_lower_left": 145,
    "lid_lower_outer_left": 163,
    "eye_inner_left": 133,
    "eye_outer_left": 33,
    "cheek_left": 50,
    "fold_left": 205,
    "nose_wing_left": 129,
    "nose_side_left": 198,
    "ear_left": 234,
    "forehead_left": 67,
    "brow_inner_right": 336,
    "brow_inner_low_right": 285,
    "brow_middle_right": 334,
    "brow_outer_right": 300,
    "lid_upper_inner_right": 384,
    "lid_upper_right": 386,
    "lid_upper_outer_right": 388,
    "lid_lower_inner_right": 381,
    "lid_lower_right": 374,
    "lid_lower_outer_right": 390,
    "eye_inner_right": 362,
    "eye_outer_right": 263,
    "cheek_right": 280,
    "fold_right": 425,
    "nose_wing_right": 358,
    "nose_side_right": 420,
    "ear_right": 454,
    "forehead_right": 297,
    "forehead": 10,
    "nose_root": 168,
    "nose_tip": 4,
}
"""Feature points outside the mouth; the mouth's are the lips' outlines and the jaw above."""
