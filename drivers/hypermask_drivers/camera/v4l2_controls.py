"""Exposure, gain and blanking of a camera: set, read back, in seconds.

A webcam has its exposure in steps of 100 us; a raw sensor in lines, whose length follows from the
pixel rate and the blanking. Source: kernel documentation, "Image source control reference" and
"Camera control reference".
"""

from __future__ import annotations

from collections.abc import Sequence

from hypermask_drivers.camera import v4l2_abi as abi
from hypermask_drivers.camera.v4l2_node import VideoNode

_ABSOLUTE_UNIT_S = 1e-4
_LONGEST = 0.95  # of the period: a longer exposure would lower the frame rate
_PHASE_STEP = 0.02  # of the period: how much one frame may be longer or shorter


class CameraControls:
    """nodes: where to look for a control, in order: the sensor's own sub-device, the video node."""

    def __init__(self, nodes: Sequence[VideoNode], size: tuple[int, int]) -> None:
        self._nodes = nodes
        self._width, self._height = size

    def _with(self, control: int) -> VideoNode | None:
        return next((n for n in self._nodes if n.control_range(control) is not None), None)

    def _get(self, control: int) -> int | None:
        values = (node.get(control) for node in self._nodes)
        return next((value for value in values if value is not None), None)

    def _set(self, control: int, value: int) -> int | None:
        node = self._with(control)
        return None if node is None else node.set(control, value)

    def line_s(self) -> float | None:
        """Time from a sensor line to the next, None where the sensor does not tell."""
        rates = (node.get64(abi.CID_PIXEL_RATE) for node in self._nodes)
        pixel_rate = next((rate for rate in rates if rate), None)
        blanking = self._get(abi.CID_HBLANK)
        if not pixel_rate or blanking is None:
            return None
        return (self._width + blanking) / pixel_rate

    def readout_s(self) -> float | None:
        line = self.line_s()
        return None if line is None else line * self._height

    # Exposure and gain

    def set_exposure(self, exposure_s: float, period_s: float) -> float | None:
        """Manual exposure of at most 95 % of the period; what the camera then says it uses.

        None from a camera whose exposure cannot be set. Raises `DeviceLost`.
        """
        exposure_s = min(exposure_s, _LONGEST * period_s)
        self._set(abi.CID_EXPOSURE_AUTO, abi.EXPOSURE_MANUAL)
        self._set(abi.CID_EXPOSURE_AUTO_PRIORITY, 0)
        for control, unit_s in self._exposure_units():
            steps = max(1, round(exposure_s / unit_s))
            while steps > 1 and steps * unit_s > period_s:
                steps -= 1
            used = self._set(control, steps)
            if used is not None:
                return used * unit_s
        return None

    def exposure_s(self) -> float | None:
        for control, unit_s in self._exposure_units():
            value = self._get(control)
            if value is not None:
                return value * unit_s
        return None

    def _exposure_units(self) -> list[tuple[int, float]]:
        line = self.line_s()
        lines = [] if line is None else [(abi.CID_EXPOSURE, line)]
        return [*lines, (abi.CID_EXPOSURE_ABSOLUTE, _ABSOLUTE_UNIT_S)]

    def set_gain(self, gain: int) -> int | None:
        """In the camera's own steps; what it then says it uses, None without such a control."""
        self._set(abi.CID_AUTOGAIN, 0)
        for control in (abi.CID_ANALOGUE_GAIN, abi.CID_GAIN):
            used = self._set(control, gain)
            if used is not None:
                return used
        return None

    # Frame rate and phase by the vertical blanking

    def set_rate_by_blanking(self, rate_hz: float) -> float | None:
        """The sensor's frame rate through its vertical blanking; None where it has none."""
        line = self.line_s()
        if line is None or self._with(abi.CID_VBLANK) is None:
            return None
        blanking = self._set(abi.CID_VBLANK, round(1 / (rate_hz * line)) - self._height)
        return None if blanking is None else 1 / ((self._height + blanking) * line)

    def phase_shifter(self) -> PhaseShifter | None:
        """None where the vertical blanking cannot be set."""
        node, line = self._with(abi.CID_VBLANK), self.line_s()
        if node is None or line is None:
            return None
        return PhaseShifter(node, line, self._height)


class PhaseShifter:
    """Delays the coming frames by a few frames that are longer or shorter.

    A blanking takes effect some frames after it was set, but as many frames after it is taken
    back; so what counts is the number of frames between the two.
    """

    def __init__(self, node: VideoNode, line_s: float, height: int) -> None:
        limits = node.control_range(abi.CID_VBLANK)
        assert limits is not None
        self._least, self._most, _ = limits
        self._node = node
        self._line_s = line_s
        self._nominal = node.get(abi.CID_VBLANK) or self._least
        self._period_lines = self._nominal + height
        self._left = 0  # lines still to be added
        self._step = 0  # lines added to every frame now
        self._since = 0  # sequence number at which the step was set
        self._sequence = 0

    def shift(self, delay_s: float) -> float:
        """Start a delay of at most half a period; returns what will really be made of it."""
        half = self._period_lines // 2
        lines = min(max(round(delay_s / self._line_s), -half), half)
        if lines < 0 and self._nominal <= self._least:
            lines += self._period_lines  # cannot be shorter: come almost a period later
        self._left += lines
        self._choose()
        return lines * self._line_s

    def frame(self, sequence: int) -> None:
        """Tell that a frame arrived."""
        if self._step and sequence > self._sequence:
            self._left -= self._step * (sequence - self._since)
        self._since = self._sequence = sequence
        self._choose()

    def _choose(self) -> None:
        limit = max(1, int(_PHASE_STEP * self._period_lines))
        step = min(max(self._left, -limit), limit)
        step = min(max(step, self._least - self._nominal), self._most - self._nominal)
        if step != self._step:
            used = self._node.set(abi.CID_VBLANK, self._nominal + step)
            self._step = 0 if used is None else used - self._nominal
