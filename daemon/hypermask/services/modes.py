"""The modes that the show service offers: what the keypad can be lent to, by name.

The names are those of `workers.modes.HELD`: a key that is held begins its mode.
"""

from __future__ import annotations

from collections.abc import Callable

from hypermask.calibration.outcome import Cart
from hypermask.services.rig import Rig, nominal_projector, nominal_screen
from hypermask.workers.calibration_mode import Subject, calibration_modes
from hypermask.workers.lesson import VoiceLesson
from hypermask.workers.modes import Mode


def modes_of(rig: Rig) -> dict[str, Callable[[], Mode]]:
    """Called once; each mode is made anew whenever it is begun."""
    modes = dict(calibration_modes(_subject(rig), rig.board, rig.report))
    if rig.machine.device("sound") is not None:
        modes[VoiceLesson.name] = lambda: VoiceLesson(rig.board)
    return modes


def _subject(rig: Rig) -> Subject:
    machine = rig.machine
    has_camera = machine.device("camera") is not None

    def cart() -> Cart:
        return Cart(rig.mask, rig.camera_model, nominal_projector(machine))

    fixed = machine.mapping == "fixed"
    return Subject(
        machine.mapping,
        lambda: rig.mask,
        cart if has_camera and not fixed else None,
        (lambda: nominal_screen(machine)) if fixed else None,
    )
