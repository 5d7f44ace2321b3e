"""What the emulated pan-tilt unit says: PTU-D46 User's Manual 2.14, section 4."""

from __future__ import annotations

BANNER = (
    "### Pan-Tilt Controller v2.14.0(D46), (C)1991-2006 Directed Perception, Inc.,"
    " All Rights Reserved\r\n### Initializing, please wait...\r\n"
)
VERSION = "Pan-Tilt Controller v2.14.0(D46), (C)2006 Directed Perception, Inc., All Rights Reserved"
HELP = "Commands: PP TP PO TO PS TS PD TD PA TA PB TB PU TU PL TL PR TR PN PX TN TX A H I S L R"
JAMMED = "!T!T!P!P! Cannot find the origin\r\n"
"""The manual does not tell this sentence; that it begins with `!` follows from section 4.2."""
NAMES = {"P": "Pan", "T": "Tilt"}

SENTENCES = {
    "P": "Current {axis} position is {value}",
    "O": "Target {axis} position is {value}",
    "R": "{value} seconds arc per {axis} position",
    "N": "Minimum {axis} position is {value}",
    "X": "Maximum {axis} position is {value}",
    "S": "Target {axis} speed is {value} positions/sec",
    "D": "Current {axis} speed is {value} positions/sec",
    "A": "{axis} acceleration is {value} positions/sec^2",
    "B": "Current {axis} base speed is {value} positions/sec",
    "U": "Maximum {axis} speed is {value} positions/sec",
    "L": "Minimum {axis} speed is {value} positions/sec",
}
"""The verbose answers to queries of one axis, by the second letter of the command."""


def answer(kind: str, axis: str, value: str, verbose: bool) -> str:
    sentence = SENTENCES[kind].format(axis=NAMES[axis], value=value)
    return f"* {sentence if verbose else value}\r\n"


def beyond(axis: str, low: int, high: int, wanted: int) -> str:
    side, bound = ("Maximum", high) if wanted > high else ("Minimum", low)
    return f"! {side} allowable {NAMES[axis]} position is {bound}\r\n"


def too_fast(axis: str, bound: int) -> str:
    return f"! {NAMES[axis]} speed cannot exceed {bound} positions/sec\r\n"


def too_slow(axis: str, bound: int) -> str:
    return f"! {NAMES[axis]} speed cannot be less than {bound} positions/sec\r\n"
