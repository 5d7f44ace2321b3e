"""What the camera's sensor makes of points of light.

Each light is a disc blurred by the lens, smeared by its motion during the exposure. The disc's
second moment is folded into the blur (diameter^2 / 16 an axis), the smear is a sum over moments
within the exposure, and each pixel integrates over its area, so centroids are right to a few
thousandths of a pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.mask import Mask
from hypermask_sim.faults import chance

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

_AZIMUTHS = 360
_REACH = 4.0  # standard deviations of a spot that are drawn
_LONGEST_SMEAR_PX = 50.0
_MARGIN = 256  # how far the noise picture can be shifted

_NORMAL_X = np.linspace(-6, 6, 6001)
_NORMAL_CDF = np.array([0.5 * (1 + math.erf(x / math.sqrt(2))) for x in _NORMAL_X])


@dataclass(frozen=True)
class Spots:
    """Points of light on the sensor.

    points: (n, m, 2) pixels at m moments of the exposure; weights: (m,) their shares, sum 1;
    peaks: (n,) grey levels of the brightest pixel when still; sizes: (n,) standard deviation, px.
    """

    points: Array
    weights: Array
    peaks: Array
    sizes: Array


@lru_cache(maxsize=16)
def exposure_moments(exposure_s: float) -> tuple[Array, Array]:
    """Offsets (m,) s from mid-exposure and weights (m,): Gauss-Legendre, more for longer ones."""
    count = 3 if exposure_s <= 2e-3 else 9
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes * exposure_s / 2, weights / 2


class Sensor:
    """Turns spots into 8-bit frames with ambient light and read noise.

    size: (width, height). The noise picture is made once and shifted for each frame, as drawing a
    million normal numbers takes 10 ms.
    """

    def __init__(self, size: tuple[int, int], ambient: float, noise: float, seed: int) -> None:
        self.size = size
        self._seed = seed
        width, height = size
        random = np.random.default_rng(seed)
        shape = (height + _MARGIN, width + _MARGIN)
        level = ambient + noise * random.standard_normal(shape, dtype=np.float32)
        self._background = np.clip(np.rint(level), 0, 255).astype(np.uint8)
        self._dither = random.random((_MARGIN, _MARGIN), dtype=np.float32)
        self._frame = np.empty((height, width), np.uint8)

    def expose(self, spots: Spots | None, flash: float, sequence: int) -> Grey:
        """The frame (height, width); read-only, valid until the next call."""
        width, height = self.size
        x = int(chance(self._seed, sequence, 1) * _MARGIN)
        y = int(chance(self._seed, sequence, 2) * _MARGIN)
        frame = self._frame
        frame.flags.writeable = True
        np.copyto(frame, self._background[y : y + height, x : x + width])
        if flash > 0:
            np.copyto(frame, np.minimum(frame.astype(np.uint16) + round(flash), 255), "unsafe")
        if spots is not None:
            self._add(frame, spots, x, y)
        frame.flags.writeable = False
        return frame

    def _add(self, frame: Grey, spots: Spots, x: int, y: int) -> None:
        """Random rounding (dither) keeps the faint rim of a spot, and so its centroid, right."""
        patches, corners = patches_of(spots)
        side = patches.shape[1]
        dither = self._dither[y % 128 : y % 128 + side, x % 128 : x % 128 + side]
        levels = np.minimum(patches + dither, 255).astype(np.uint8)
        width, height = self.size
        for patch, (left, top) in zip(levels, corners.tolist(), strict=True):
            if 0 <= left <= width - side and 0 <= top <= height - side:
                area = frame[top : top + side, left : left + side]
                cv2.add(area, patch, dst=area)
            else:
                self._add_cut(frame, patch, left, top)

    def _add_cut(self, frame: Grey, patch: Grey, left: int, top: int) -> None:
        """A patch that sticks out of the picture."""
        width, height = self.size
        x0, y0 = max(left, 0), max(top, 0)
        x1, y1 = min(left + len(patch), width), min(top + len(patch), height)
        if x0 < x1 and y0 < y1:
            area = frame[y0:y1, x0:x1]
            cv2.add(area, patch[y0 - top : y1 - top, x0 - left : x1 - left], dst=area)


def patches_of(spots: Spots) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Light of each spot, (n, side, side) grey levels, and top left corners (n, 2) x, y."""
    centre = np.einsum("nmk,m->nk", spots.points, spots.weights)
    smear = float(np.abs(spots.points - centre[:, None]).max())
    reach = math.ceil(_REACH * float(spots.sizes.max()) + min(smear, _LONGEST_SMEAR_PX))
    corners = np.rint(np.clip(centre, -1e6, 1e6)).astype(np.int64) - reach
    edges = np.arange(2 * reach + 2) - 0.5
    # (n, m, 2, side + 1): pixel edges seen from the spot, in standard deviations.
    offsets = edges + (corners[:, None] - spots.points)[..., None]
    cdf = np.interp(offsets / spots.sizes[:, None, None, None], _NORMAL_X, _NORMAL_CDF)
    shares = np.diff(cdf, axis=-1)
    flux = spots.peaks * 2 * np.pi * spots.sizes**2
    across = shares[:, :, 0] * (spots.weights[None, :] * flux[:, None])[..., None]
    light = np.matmul(shares[:, :, 1].transpose(0, 2, 1), across)
    return light.astype(np.float32), corners


class Horizon:
    """How high the mask's own relief stands round each LED, by azimuth.

    Made once by walking outwards from each LED over the relief in small steps; whether the
    camera sees the LED is then one comparison.
    """

    def __init__(self, mask: Mask) -> None:
        azimuths = np.arange(_AZIMUTHS) * 2 * np.pi / _AZIMUTHS
        steps = np.arange(1.0, 300.0, 1.5) * 1e-3
        outwards = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
        half_width, half_height = mask.half_size_m
        self._tangents = np.empty((len(mask.leds), _AZIMUTHS))
        for index, (x, y, z) in enumerate(mask.leds):
            xs, ys = x + outwards[:, :1] * steps, y + outwards[:, 1:] * steps
            over = (np.abs(xs) <= half_width) & (np.abs(ys) <= half_height)
            slopes = np.where(over, (mask.height(xs, ys) - z) / steps, -np.inf)
            self._tangents[index] = slopes.max(axis=1)

    def clear(self, ways: Array) -> NDArray[np.bool_]:
        """(n,) whether the way (n, 3) from each LED to the camera passes above the relief."""
        azimuths = np.arctan2(ways[:, 1], ways[:, 0]) * (_AZIMUTHS / (2 * np.pi))
        bins = np.rint(azimuths).astype(np.int64) % _AZIMUTHS
        level = np.sqrt(ways[:, 0] ** 2 + ways[:, 1] ** 2)
        clear: NDArray[np.bool_] = ways[:, 2] > level * self._tangents[np.arange(len(ways)), bins]
        return clear


def spot_size(psf_px: float, diameter_px: Array) -> Array:
    """Standard deviation in pixels of a disc blurred by the lens."""
    size: Array = np.sqrt(psf_px**2 + diameter_px**2 / 16)
    return size


def angular_fall_off(cosines: Array, half_angle_deg: float) -> Array:
    """Brightness of an LED seen under an angle: cos^m, one half at `half_angle_deg`."""
    power = math.log(0.5) / math.log(math.cos(math.radians(half_angle_deg)))
    fall: Array = np.maximum(cosines, 0) ** power
    return fall
