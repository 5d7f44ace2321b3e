"""What the stage may still believe as time passes: where the mask is, and what the mouth does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from hypermask.stage.settings import StageSettings

Array = NDArray[np.float64]

STANDSTILL_S = 0.1
"""A stage that showed nothing new for longer stood still."""


def smoothstep(x: float) -> float:
    """0 up to x = 0, 1 from x = 1, and 3x^2 - 2x^3 between: no jump in value or slope."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3 - 2 * x)


class MaskFade:
    """Black when nobody knows where the mask is; back without a flash when it is seen again.

    Not seen for `mask_lost_after_s`: fades out within `fade_out_s`. Seen again: is back at full
    light `fade_in_s` after the last update without it, from whatever level it had.

    While the machine stands still (its memory is full, its disk holds it up), nobody looks and
    nothing new is shown: such a time is no proof that the mask is gone, and a black frame at its
    end would be a flash. So the latest one does not count.
    """

    def __init__(self, settings: StageSettings | None = None) -> None:
        self._settings = settings or _default_settings()
        self._phase = 0.0
        self._updated_s: float | None = None
        self._blind = (-np.inf, -np.inf)
        """From when to when the stage stood still the last time."""

    def update(self, time_s: float, last_seen_s: float | None) -> float:
        """The level 0..1 at `time_s`; last_seen_s: of the latest frame with the mask in it.

        Both on the same clock; `time_s` may be the moment of the light. Times do not go back.
        """
        settings = self._settings
        began_s = time_s if self._updated_s is None else min(self._updated_s, time_s)
        passed = time_s - began_s
        self._updated_s = time_s
        if passed > STANDSTILL_S:
            self._blind = (began_s, time_s)
        unseen = self._unseen_for(time_s, last_seen_s)
        if unseen > settings.mask_lost_after_s:
            lost_for = min(passed, unseen - settings.mask_lost_after_s)
            self._phase = max(self._phase - lost_for / settings.fade_out_s, 0.0)
        else:
            self._phase = min(self._phase + passed / settings.fade_in_s, 1.0)
        return smoothstep(self._phase)

    def _unseen_for(self, time_s: float, last_seen_s: float | None) -> float:
        if last_seen_s is None:
            return np.inf
        from_s, to_s = self._blind
        return time_s - last_seen_s - max(to_s - max(from_s, last_seen_s), 0.0)


def live_mouth(parameters: ArrayLike, age_s: float, settings: StageSettings | None = None) -> Array:
    """Mouth parameters (13,), offsets from the closed mouth, as they may still be believed.

    Older than `mouth_stale_after_s` (the voice worker died, the microphone vanished) the mouth
    closes within `mouth_closing_s`. Values that are not finite close it at once.
    """
    limits = settings or _default_settings()
    values = np.asarray(parameters, float)
    if not (np.isfinite(values).all() and np.isfinite(age_s)):
        return np.zeros(values.shape)
    closed = smoothstep((age_s - limits.mouth_stale_after_s) / limits.mouth_closing_s)
    return np.asarray(values * (1 - closed))


def _default_settings() -> StageSettings:
    from hypermask.stage.settings import StageSettings

    return StageSettings()
