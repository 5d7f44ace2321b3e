"""The simulated infrared camera."""

from __future__ import annotations

import math
from collections import deque

from hypermask_drivers.camera import Camera, CameraMode, Frame
from hypermask_drivers.clock import Clock, VirtualClock
from hypermask_sim.devices.base import SimDevice
from hypermask_sim.optics import Sensor
from hypermask_sim.world import World

_LINE_S = 1e-5  # exposure is set in whole lines
_PHASE_STEP = 0.02  # a sensor stretches its vertical blanking by about this share of a period


class SimCamera(SimDevice, Camera):
    """Renders the LEDs of where the mask WAS at mid-exposure.

    Frame j is exposed about phase + j / rate and can be read `available_ms` later. A frame that
    finds all buffers full is lost, as with V4L2: the sequence number shows the gap.
    """

    kind, code, noun = "camera", "CAM", "camera"

    def __init__(self, world: World, clock: Clock) -> None:
        super().__init__(world, clock)
        settings = world.scenario.camera
        self._settings = settings
        self._period_s = 1 / (settings.rate_hz * (1 + settings.rate_error_ppm * 1e-6))
        self._exposure_s = self._allowed(settings.exposure_ms * 1e-3)
        self._sensor = Sensor(
            world.camera.size, settings.ambient, settings.read_noise, world.scenario.seed
        )
        self._ready: deque[tuple[int, float]] = deque()
        self._sequence = 0
        self._next_s = 0.0  # mid-exposure of the next frame, scenario time
        self._offset_s = 0.0  # phase: nominal and shifted
        self._arrival_s = 0.0  # when the next frame can be read, scenario time
        self._shift_s = 0.0  # phase shift still to be made
        self._ahead: Frame | None = None

    @property
    def mode(self) -> CameraMode:
        self._check()
        width, height = self.world.camera.size
        return CameraMode(width, height, self._settings.rate_hz, self._exposure_s)

    def _opened(self, now_s: float) -> None:
        self._offset_s = self._settings.phase_ms * 1e-3
        self._sequence = max(0, math.ceil((now_s - self._offset_s) / self._period_s - 1e-9))
        self._next_s = self._offset_s + self._sequence * self._period_s
        self._shift_s = 0.0
        self._ready.clear()
        self._ahead = None
        self._arrival_s = self._arrival(0.0)

    def _arrival(self, earliest_s: float) -> float:
        late = self.world.faults.delay_s(self._sequence, self._next_s)
        return max(earliest_s, self._next_s + self._settings.available_ms * 1e-3 + late)

    def _advance(self, now_s: float) -> None:
        """Take in every frame that has arrived by now; what finds no buffer is lost."""
        while self._arrival_s <= now_s + 1e-9:
            dropped = self.world.faults.dropped(self._sequence, self._next_s)
            if not dropped and len(self._ready) < self._settings.buffers:
                self._ready.append((self._sequence, self._next_s))
            limit = _PHASE_STEP * self._period_s
            step = min(max(self._shift_s, -limit), limit)
            self._shift_s -= step
            self._offset_s += step
            self._sequence += 1
            self._next_s = self._offset_s + self._sequence * self._period_s
            self._arrival_s = self._arrival(self._arrival_s)

    def next_arrival_s(self) -> float:
        """Clock time at which the next frame can be read (it may still turn out dropped)."""
        self._advance(self._check())
        return self.world.origin_s + (self.now() if self._ready else self._arrival_s)

    def read(self, timeout_s: float) -> Frame | None:
        if timeout_s > 0 and not isinstance(self.clock, VirtualClock):
            self._expose_ahead()
        return self._wait_for(self._take, self.next_arrival_s, timeout_s)

    def _take(self, now_s: float) -> Frame | None:
        self._advance(now_s)
        if not self._ready:
            return None
        sequence, middle_s = self._ready.popleft()
        ahead, self._ahead = self._ahead, None
        if ahead is not None and ahead.sequence == sequence:
            return ahead
        return self._frame(sequence, middle_s)

    def _expose_ahead(self) -> None:
        """In real time the coming frame is made before it arrives: making it is no work of a real
        camera's program, and must not count as such."""
        self._advance(self._check())
        if not self._ready:
            self._ahead = self._frame(self._sequence, self._next_s)

    def _frame(self, sequence: int, middle_s: float) -> Frame:
        time_s = middle_s + self.world.origin_s
        spots = self.world.spots(time_s, self._exposure_s)
        flash = self.world.faults.flash(middle_s)
        return Frame(self._sensor.expose(spots, flash, sequence), time_s, sequence)

    def _allowed(self, exposure_s: float) -> float:
        longest = 0.95 * self._period_s
        return round(min(max(exposure_s, 2 * _LINE_S), longest) / _LINE_S) * _LINE_S

    def set_exposure(self, exposure_s: float) -> float:
        self._check()
        self._exposure_s = self._allowed(exposure_s)
        self._ahead = None
        return self._exposure_s

    def shift_phase(self, delay_s: float) -> float:
        """At most half a period; made over the coming frames, 2 % of a period each."""
        self._advance(self._check())
        if not self._settings.shiftable:
            return 0.0
        half = self._period_s / 2
        delay = min(max(delay_s, -half), half)
        self._shift_s += delay
        return delay
