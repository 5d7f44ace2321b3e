"""How far the mouth's light and the loudspeaker's sound lie apart, for the status."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hypermask.loudspeaker.settings import Loudspeaker

LIP_SYNC = np.dtype(
    [
        ("time_s", "<f8"),
        ("mouth_lag_s", "<f8"),  # from the sound at the microphone to its mouth's light
        ("loudspeaker_delay_s", "<f8"),  # from the sound at the microphone to the loudspeaker's
        ("offset_s", "<f8"),  # positive: the mouth comes after the sound
    ]
)

# Seconds of (sound first, picture first): ATSC IS-191 and ITU-R BT.1359-1 (detectable).
_UNSEEN_S = (0.015, 0.045)
_TOLERATED_S = (0.045, 0.125)


@dataclass(frozen=True)
class LipSync:
    """offset_s: mouth light time minus loudspeaker sound time; positive is the bad side."""

    mouth_lag_s: float
    loudspeaker_delay_s: float

    @property
    def offset_s(self) -> float:
        return self.mouth_lag_s - self.loudspeaker_delay_s

    @property
    def verdict(self) -> str:
        """ "together", "noticeable" or "apart"."""
        for word, (sound_first_s, picture_first_s) in (
            ("together", _UNSEEN_S),
            ("noticeable", _TOLERATED_S),
        ):
            if -picture_first_s <= self.offset_s <= sound_first_s:
                return word
        return "apart"

    def sentence(self) -> str:
        milliseconds = self.offset_s * 1e3
        order = "after" if milliseconds >= 0 else "before"
        return (
            f"The mouth moves {abs(milliseconds):.0f} ms {order} the loudspeaker: {self.verdict}."
        )


class LipSyncMeter:
    """The median lag of the latest mouths (`Picture.mouth_lag_s`) against the loudspeaker.

    air_s: from the loudspeaker to the audience at which the delay was set, 2.9 ms a metre, less
    the light's nothing; 0 for the loudspeaker's own place.
    """

    def __init__(self, loudspeaker: Loudspeaker, air_s: float = 0.0, window: int = 240) -> None:
        self._delay_s = loudspeaker.delay_ms * 1e-3 + air_s
        self._lags_s = np.full(window, np.nan)
        self._next = 0

    def add(self, mouth_lag_s: float | None) -> None:
        """The lag of one picture; None and what is older than half a second says nothing."""
        if mouth_lag_s is None or not 0 <= mouth_lag_s <= 0.5:
            return
        self._lags_s[self._next % len(self._lags_s)] = mouth_lag_s
        self._next += 1

    def measured(self) -> LipSync | None:
        """None before the first mouth."""
        if self._next == 0:
            return None
        return LipSync(float(np.nanmedian(self._lags_s)), self._delay_s)

    def wanted_delay_ms(self) -> float | None:
        """What `loudspeaker.delay_ms` should be for sound and mouth to meet."""
        found = self.measured()
        return None if found is None else round(found.mouth_lag_s * 1e3, 1)

    def record(self, time_s: float) -> NDArray[np.void] | None:
        """For the blackboard, dtype `LIP_SYNC`."""
        found = self.measured()
        if found is None:
            return None
        values = (time_s, found.mouth_lag_s, found.loudspeaker_delay_s, found.offset_s)
        return np.array(values, LIP_SYNC)
