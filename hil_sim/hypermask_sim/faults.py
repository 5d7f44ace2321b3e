"""What goes wrong, and when: a pure function of scenario time (seconds) and frame number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hypermask_drivers.mask import LED_NAMES
from hypermask_drivers.settings import Settings

Array = NDArray[np.float64]
Seconds = Annotated[float, Field(ge=0, le=86400)]
Milliseconds = Annotated[float, Field(ge=0, le=1000)]

LOSSES = {
    "camera": "camera_lost",
    "projector": "projector_lost",
    "keypad": "keypad_unplugged",
    "sound": "sound_lost",
    "pantilt": "pantilt_lost",
    "lamp": "lamp_lost",
    "power": "power_lost",
}
"""From a kind of device to the fault that takes it away."""


SOUND_TROUBLES = (
    "sound_silent", "sound_clipped", "sound_nan", "sound_stuck", "sound_garbled", "sound_resampled",
)  # fmt: skip
"""What a microphone that is there can send: nothing but zeros, the voice 40 dB too loud, no
numbers, its greatest value for ever, blocks of absurd sizes, 192 kHz."""


_FAULT_KEYS: dict[str, frozenset[str]] = {
    "leds_hidden": frozenset({"leds"}),
    "extra_blobs": frozenset({"count", "peak"}),
    "flash": frozenset({"level"}),
    "frames_dropped": frozenset({"fraction", "frames"}),
    "frames_late": frozenset({"fraction", "frames", "delay_ms"}),
    "camera_lost": frozenset(),
    "projector_lost": frozenset(),
    "keypad_unplugged": frozenset(),
    "sound_lost": frozenset(),
    "pantilt_lost": frozenset(),
    "lamp_lost": frozenset(),
    "power_lost": frozenset(),
    **dict.fromkeys(SOUND_TROUBLES, frozenset()),
}


class FaultSettings(Settings):
    """Something that goes wrong from `from_s` until `to_s`.

    leds: names, all without it. fraction: of the frames in that time; frames: their sequence
    numbers instead. delay_ms: how much later the frame arrives. level: grey levels added.
    """

    kind: Literal[
        "leds_hidden", "extra_blobs", "flash", "frames_dropped", "frames_late", "camera_lost",
        "projector_lost", "keypad_unplugged", "sound_lost", "pantilt_lost", "lamp_lost",
        "power_lost", "sound_silent", "sound_clipped", "sound_nan", "sound_stuck", "sound_garbled",
        "sound_resampled",
    ]  # fmt: skip
    from_s: Seconds = 0.0
    to_s: Seconds = 86400.0
    leds: tuple[str, ...] = LED_NAMES
    count: int = Field(10, ge=1, le=200)
    peak: float = Field(200.0, gt=0, le=10000)
    level: float = Field(255.0, ge=0, le=255)
    fraction: float = Field(1.0, ge=0, le=1)
    frames: tuple[int, ...] | None = None
    delay_ms: Milliseconds = 8.0

    @model_validator(mode="after")
    def _belongs_together(self) -> FaultSettings:
        extra = self.model_fields_set - {"kind", "from_s", "to_s"} - _FAULT_KEYS[self.kind]
        if extra:
            raise ValueError(f"'{sorted(extra)[0]}' means nothing for a {self.kind} fault")
        if self.to_s <= self.from_s:
            raise ValueError("to_s must be later than from_s")
        unknown = set(self.leds) - set(LED_NAMES)
        if unknown:
            raise ValueError(f"no LED '{sorted(unknown)[0]}'; they are {', '.join(LED_NAMES)}")
        return self


def chance(*numbers: int) -> float:
    """A number in [0, 1) that depends on `numbers` alone (splitmix64): noise without a state."""
    state = 0
    for number in numbers:
        state = (state + number + 0x9E3779B97F4A7C15) & 0xFFFFFFFFFFFFFFFF
        state = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & 0xFFFFFFFFFFFFFFFF
        state = ((state ^ (state >> 27)) * 0x94D049BB133111EB) & 0xFFFFFFFFFFFFFFFF
        state ^= state >> 31
    return state / 2**64


@dataclass(frozen=True)
class Blobs:
    """Bright blobs that wander through the camera's picture.

    centre, swing, rate_hz, phase: (n, 2) pixels, pixels, Hz and turns; peaks: (n,) grey levels.
    """

    centre: Array
    swing: Array
    rate_hz: Array
    phase: Array
    peaks: Array

    @staticmethod
    def scattered(count: int, peak: float, size: tuple[int, int], seed: int) -> Blobs:
        random = np.random.default_rng(seed)
        extent = np.array(size, float)
        return Blobs(
            extent * random.uniform(0.2, 0.8, (count, 2)),
            extent * random.uniform(0.05, 0.3, (count, 2)),
            random.uniform(0.1, 0.7, (count, 2)),
            random.uniform(0, 1, (count, 2)),
            peak * random.uniform(0.6, 1.2, count),
        )

    def at(self, times_s: Array) -> Array:
        """Image points (n, m, 2) at times (m,)."""
        turns = self.rate_hz[:, None] * times_s[:, None] + self.phase[:, None]
        points: Array = self.centre[:, None] + self.swing[:, None] * np.sin(2 * np.pi * turns)
        return points


class Faults:
    """The scenario's faults, asked by time. picture: the camera's size in pixels."""

    def __init__(
        self, faults: tuple[FaultSettings, ...], seed: int, picture: tuple[int, int]
    ) -> None:
        self._faults = faults
        self._seed = seed
        self._blobs = {
            index: Blobs.scattered(fault.count, fault.peak, picture, seed * 1000 + index)
            for index, fault in enumerate(faults)
            if fault.kind == "extra_blobs"
        }

    def _active(self, kind: str, time_s: float) -> Iterator[tuple[int, FaultSettings]]:
        for index, fault in enumerate(self._faults):
            if fault.kind == kind and fault.from_s <= time_s < fault.to_s:
                yield index, fault

    def hidden_leds(self, time_s: float) -> NDArray[np.bool_]:
        """(5,) in `LED_NAMES` order."""
        hidden = {name for _, fault in self._active("leds_hidden", time_s) for name in fault.leds}
        return np.array([name in hidden for name in LED_NAMES])

    def blobs(self, time_s: float) -> list[Blobs]:
        return [self._blobs[index] for index, _ in self._active("extra_blobs", time_s)]

    def flash(self, time_s: float) -> float:
        """Grey levels added to the whole picture."""
        return max((fault.level for _, fault in self._active("flash", time_s)), default=0.0)

    def dropped(self, sequence: int, time_s: float) -> bool:
        return any(
            self._hits(index, fault, sequence)
            for index, fault in self._active("frames_dropped", time_s)
        )

    def delay_s(self, sequence: int, time_s: float) -> float:
        """How much later than usual the frame arrives."""
        return max(
            (
                fault.delay_ms * 1e-3
                for index, fault in self._active("frames_late", time_s)
                if self._hits(index, fault, sequence)
            ),
            default=0.0,
        )

    def sound_troubles(self, time_s: float) -> list[str]:
        """Those of `SOUND_TROUBLES` that there are."""
        return [
            fault.kind
            for fault in self._faults
            if fault.kind in SOUND_TROUBLES and fault.from_s <= time_s < fault.to_s
        ]

    def _hits(self, index: int, fault: FaultSettings, sequence: int) -> bool:
        if fault.frames is not None:
            return sequence in fault.frames
        return chance(self._seed, index, sequence) < fault.fraction

    def lost(self, device: str, from_s: float, to_s: float) -> bool:
        """Whether a kind of device (`LOSSES`) was away at any time from `from_s` to `to_s`."""
        return any(
            fault.kind == LOSSES[device] and fault.from_s <= to_s and from_s < fault.to_s
            for fault in self._faults
        )
