"""What a calibration session tells the operator, line by line."""

from __future__ import annotations

from hypermask.calibration.outcome import Outcome
from hypermask.calibration.positions import Position
from hypermask.errors import HypermaskError
from hypermask.geometry import Array
from hypermask.mask import LED_NAMES


def placing(number: int, total: int, target: Position, now: Array | None) -> list[str]:
    """now: (3,) where the mask is in the camera frame, None where it is not seen."""
    return [
        f"Position {number} of {total}: mask {target}",
        guidance(target, now) if now is not None else "The camera does not see the mask.",
        "enter: start here   0: skip   backspace: back   star: finish",
    ]


def clicking(led: int, done: int, total: int, step_px: int, seen: bool) -> list[str]:
    name = "nose" if LED_NAMES[led] == "label" else LED_NAMES[led].replace("_", " ")
    return [
        *([] if seen else ["The camera does not see the mask."]),
        f"Lay the cross on the {name} LED ({done + 1} of {total})",
        f"8 2 4 6: move   5: step ({step_px})   enter: accept   backspace: undo   0: skip",
    ]


def reviewing(outcome: Outcome | None, problem: HypermaskError | None) -> list[str]:
    if outcome is not None:
        return [*outcome.lines(), "enter: accept   plus: one more position   backspace: back"]
    return [str(problem), "enter: one more position   backspace: back"]


def guidance(target: Position, now: Array) -> str:
    """Which way to bring the mask; the last line when it is about right."""
    parts = []
    nearer = float(now[2]) - target.distance_m
    right = target.x_m - float(now[0])
    up = float(now[1]) - target.y_m
    if abs(nearer) > 0.1:
        parts.append(f"{abs(nearer) * 100:.0f} cm {'nearer' if nearer > 0 else 'farther'}")
    if abs(right) > 0.08:
        parts.append(f"{abs(right) * 100:.0f} cm to the {'right' if right > 0 else 'left'}")
    if abs(up) > 0.08:
        parts.append(f"{abs(up) * 100:.0f} cm {'up' if up > 0 else 'down'}")
    return "Move it " + ", ".join(parts) if parts else "The mask is in place."
