"""The modes that the show service offers: what the keypad can be lent to, by name.

The names are those of `workers.modes.HELD`: a key that is held begins its mode.
"""

from __future__ import annotations

from collections.abc import Callable

from hypermask.services.rig import Rig
from hypermask.workers.modes import Mode


def modes_of(rig: Rig) -> dict[str, Callable[[], Mode]]:
    """Called once; each mode is made anew whenever it is begun."""
    return {}
