"""What a session of clicks ends with: the calibration and how good it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from hypermask.calibration import planar
from hypermask.calibration.fixed import Fixed
from hypermask.calibration.parameters import ProCam, ProjectorPrior, point_jacobian
from hypermask.calibration.placements import Placement
from hypermask.calibration.planar import Planar
from hypermask.calibration.procam import solve
from hypermask.calibration.quality import Quality, assess
from hypermask.errors import DataError
from hypermask.geometry import Pinhole
from hypermask.mask import Mask

Method = Literal["click", "affine", "projective", "fixed"]
METHODS: tuple[Method, ...] = ("click", "affine", "projective", "fixed")


@dataclass(frozen=True)
class Cart:
    """What is known before the first click: the mask, the camera, the projector's data sheet
    (`nominal`) with its uncertainty, the operator's error an axis, the working distances."""

    mask: Mask
    camera: Pinhole
    nominal: ProCam
    prior: ProjectorPrior = field(default_factory=ProjectorPrior)
    sigma_px: float = 1.0
    distances_m: tuple[float, ...] = (1.2, 1.8, 2.4)


@dataclass(frozen=True)
class Outcome:
    """A finished calibration; quality is None for the planar kinds, whose band says it all, and
    for a fixed screen, of which `notes` says which points were left out."""

    calibration: ProCam | Planar | Fixed
    quality: Quality | None
    placements: tuple[Placement, ...]
    notes: tuple[str, ...] = ()

    @property
    def expected_mm(self) -> float:
        """Expected rms error: over the working volume, or at a planar kind's own distance."""
        if self.quality is not None:
            return self.quality.expected_mm
        if isinstance(self.calibration, Fixed):
            return self.calibration.expected_mm
        assert isinstance(self.calibration, Planar)
        return self.calibration.expected_error_m(self.calibration.distance_m) * 1e3

    def lines(self) -> list[str]:
        """For the operator."""
        if self.quality is not None:
            return self.quality.lines()
        if isinstance(self.calibration, Fixed):
            return [f"{self.expected_mm:.2f} mm expected on the screen", *self.notes]
        assert isinstance(self.calibration, Planar)
        return planar_lines(self.calibration)


def planar_lines(calibration: Planar) -> list[str]:
    near, far = calibration.band_m
    error = calibration.expected_error_m(calibration.distance_m) * 1e3
    first = f"{error:.1f} mm expected at {calibration.distance_m:.2f} m"
    if not np.isfinite(far):
        return [first, "holds at every distance: camera and projector share their axis"]
    return [first, f"holds from {near:.2f} to {far:.2f} m; beyond, the face slides by over 2 mm"]


def conclude(method: Method, placements: Sequence[Placement], cart: Cart) -> Outcome:
    """Solve what was clicked. Raises `DataError` CAL-FEW, CAL-DEPTH, CAL-CLICKS, CAL-PLANAR."""
    if method == "click":
        return _click(placements, cart)
    corners = np.arange(planar.CORNERS)
    for placement in reversed(placements):
        if set(corners) <= set(placement.clicked):
            return Outcome(_planar(method, placement, cart), None, tuple(placements))
    raise DataError(
        "CAL-FEW",
        "not all four corner LEDs were clicked at one position of the mask",
        "Hold the mask still and click the four corners again.",
    )


def _click(placements: Sequence[Placement], cart: Cart) -> Outcome:
    solution = solve(placements, cart.mask.leds, cart.nominal, cart.prior, cart.sigma_px)
    quality = assess(solution, cart.mask, cart.camera, cart.distances_m)
    return Outcome(solution.procam, quality, tuple(placements))


def _planar(method: Method, placement: Placement, cart: Cart) -> Planar:
    assert method in ("affine", "projective")
    corners = slice(0, planar.CORNERS)
    points = placement.points[corners]
    predicted = cart.camera.project(placement.pose.apply(cart.mask.leds))[corners]
    by_point = point_jacobian(cart.nominal, placement.pose.translation[None])[0]
    pixel_m = float(1 / np.linalg.norm(by_point, axis=1).mean())
    return planar.calibrate(
        method,
        np.where(np.isfinite(points), points, predicted),
        placement.pixels[corners],
        placement.pose,
        cart.nominal.projector_from_camera.inverse().translation,
        cart.mask,
        aim_m=cart.sigma_px * pixel_m,
    )
