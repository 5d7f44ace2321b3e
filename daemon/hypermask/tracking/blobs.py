"""Bright blobs in a camera frame: where they are, to a few hundredths of a pixel.

`find_blobs` reads the whole frame (searching), `find_blobs_in` only small windows (locked). Both
hand coarse seeds to `centroids`, an iterated Gaussian-weighted centroid: its window is as narrow
as the blob itself, so that a bright neighbour hardly pulls it, and a constant background cancels.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hypermask.config import Settings
from hypermask.geometry import Array

Image = NDArray[np.uint8]
Seed = tuple[float, float, float]
"""x, y and the Gaussian width (standard deviation) of a coarse blob, pixels."""


class BlobSettings(Settings):
    """Gates of the blob detector. Grey levels and pixels."""

    noise_grey: float = Field(2.0, gt=0)
    min_contrast_grey: float = Field(16.0, gt=0)
    max_size_px: float = Field(40.0, gt=0)
    max_blobs: int = Field(36, ge=5)
    max_seeds: int = Field(400, ge=5)
    # More pixels than this above the threshold are glare, not LEDs.
    max_bright_fraction: float = Field(0.01, gt=0, le=1)


class Blobs(NamedTuple):
    """points: (n, 2) px; peaks: (n,) grey levels over the background; widths: (n,) Gaussian
    width px; sigmas: (n,) standard deviation of the points in px, larger for odd shapes."""

    points: Array
    peaks: Array
    widths: Array
    sigmas: Array

    def take(self, index: Any) -> Blobs:
        return Blobs(*(field[index] for field in self))


NO_BLOBS = Blobs(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0))

_MIN_WIDTH, _MAX_WIDTH = 0.9, 8.0
_BORDER = 2  # a blob that the frame's edge cuts has a wrong centroid
# What no amount of light improves: pixel response, optics, quantisation.
_SIGMA_FLOOR_PX = 0.03


def find_blobs(image: Image, settings: BlobSettings) -> Blobs:
    """All LED-like blobs of a frame (height, width), at most `max_blobs`, the brightest first."""
    mask, rise = _bright_mask(image, settings)
    if mask is None:
        return NO_BLOBS
    contours = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
    seeds: list[Seed] = []
    for contour in contours:
        if len(seeds) >= settings.max_seeds:
            break
        _add_seeds(seeds, image, cv2.boundingRect(contour), (0, 0), rise, settings)
    if not seeds:
        return NO_BLOBS
    blobs = centroids(image, np.array(seeds), settings.noise_grey)
    order = np.argsort(-blobs.peaks, kind="stable")[: settings.max_blobs]
    return _distinct(blobs.take(order[blobs.peaks[order] >= settings.min_contrast_grey]))


def find_blobs_in(
    image: Image,
    windows: NDArray[np.int64],
    peaks: Array,
    widths: Array,
    settings: BlobSettings,
) -> tuple[Blobs, NDArray[np.int64]]:
    """Blobs inside windows (k, 4) as x0, y0, x1, y1 (end exclusive, inside the image).

    peaks, widths: (k,) usual grey levels over the background and Gaussian width of the LED looked
    for in each window: a much brighter neighbour must not hide it, nor one that touches it move
    it. Returns the blobs and, for each, its window's index.
    """
    seeds: list[Seed] = []
    owners: list[int] = []
    for k, (x0, y0, x1, y1) in enumerate(windows.tolist()):
        if x1 - x0 < 3 or y1 - y0 < 3:
            continue
        window = image[y0:y1, x0:x1]
        low, high, _, _ = cv2.minMaxLoc(window)
        background = low + 2.0 * settings.noise_grey
        contrast = high - background
        if contrast < settings.min_contrast_grey:
            continue
        rise = max(0.35 * min(contrast, float(peaks[k])), 0.75 * settings.min_contrast_grey)
        mask = cv2.threshold(window, background + rise, 255, cv2.THRESH_BINARY)[1]
        contours = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
        for contour in contours[:8]:
            box = cv2.boundingRect(contour)
            _add_seeds(seeds, image, box, (x0, y0), (background, rise), settings, float(widths[k]))
        owners += [k] * (len(seeds) - len(owners))
    if not seeds:
        return NO_BLOBS, np.empty(0, np.int64)
    blobs = centroids(image, np.array(seeds), settings.noise_grey)
    good = blobs.peaks >= settings.min_contrast_grey
    return blobs.take(good), np.array(owners)[good]


def centroids(image: Image, seeds: Array, noise_grey: float) -> Blobs:
    """Refine seeds (n, 3: x, y, width) to blobs; all at once, on square patches. Seeds must lie
    within about two widths of the blobs.

    With a window as wide as the blob the weighted mean lies half-way between the window's centre
    and the blob's, hence the doubled step; its fixed point is the least-squares fit of a Gaussian
    (standard deviation 0.8 noise / peak).
    """
    height, width = image.shape
    widths = np.minimum(np.maximum(seeds[:, 2], _MIN_WIDTH), _MAX_WIDTH)
    half = min(math.ceil(2.5 * float(widths.max())) + 1, (min(height, width) - 1) // 2)
    offsets, grid, sides, limit = _patch(half, width, height)
    base = np.minimum(np.maximum(np.rint(seeds[:, :2]), half), limit)
    corner = (base @ np.array([1.0, width])).astype(np.int64)
    patches = image.take(corner[:, None] + offsets).astype(float)
    patches -= (patches @ sides).min(axis=1)[:, None]
    peaks = patches.max(axis=1)
    values = patches.reshape(-1, 2 * half + 1, 2 * half + 1)
    centre = seeds[:, :2] - base
    exponent = (-0.5 / (widths * widths))[:, None, None]
    for order in (2, 3):
        moments = _moments(values, grid, centre, exponent, order)
        total = np.maximum(moments[:, 0, 0], 1e-9)
        shift = moments[:, [0, 1], [1, 0]] * (2.0 / total)[:, None]
        centre += np.minimum(np.maximum(shift, -1.5), 1.5)
    points = centre + base
    sigmas = np.hypot(
        _sigmas(moments, total, shift, widths, peaks, noise_grey), _pull(points, widths, peaks)
    )
    return Blobs(points, peaks, _measured_widths(moments, total, widths), sigmas)


def _measured_widths(moments: Array, total: Array, widths: Array) -> Array:
    """Gaussian widths: blob times window has the variance v with 1/v = 1/blob^2 + 1/window^2."""
    square = widths * widths
    ratio = (moments[:, 0, 2] + moments[:, 2, 0]) / (2 * total * square)
    ratio = np.minimum(np.maximum(ratio, 0.2), 0.8)
    measured: Array = widths * np.sqrt(ratio / (1 - ratio))
    return measured


def _pull(points: Array, widths: Array, peaks: Array) -> Array:
    """How far each blob's neighbours draw its centroid, px: two Gaussians through one window."""
    place = points[:, 0] + 1j * points[:, 1]
    distance = np.abs(place[:, None] - place)
    reach = distance / (2 * widths)[:, None]
    pull = distance * np.exp(-reach * reach)
    pulled: Array = (pull @ peaks) / np.maximum(peaks, 1.0)
    return pulled


def _moments(values: Array, grid: Array, centre: Array, exponent: Array, order: int) -> Array:
    """(n, order, order): weighted moments [y power, x power] about `centre`."""
    away = grid - centre[:, :, None]  # (n, 2, size)
    basis = np.empty((*away.shape, order))
    np.exp(away * away * exponent, out=basis[..., 0])
    for power in range(1, order):
        np.multiply(basis[..., power - 1], away, out=basis[..., power])
    moments: Array = basis[:, 1].swapaxes(-1, -2) @ (values @ basis[:, 0])
    return moments


def _sigmas(
    moments: Array, total: Array, shift: Array, widths: Array, peaks: Array, noise_grey: float
) -> Array:
    """Standard deviation of each centroid; an elongated blob (half hidden, two in one) or one
    that did not settle is trusted less."""
    across = moments[:, 0, 2] - moments[:, 2, 0]
    # Relative to the variance of blob times window, when both have this width: widths^2 / 2.
    elongation = np.hypot(across, 2 * moments[:, 1, 1]) / (0.5 * widths * widths * total)
    odd = np.maximum(elongation - 0.25, 0) * widths + 0.5 * np.abs(shift).max(axis=1)
    noise = 0.8 * noise_grey / np.maximum(peaks, 1.0)
    sigmas: Array = np.sqrt(_SIGMA_FLOOR_PX**2 + noise * noise + odd * odd)
    return sigmas


@lru_cache(maxsize=64)
def _patch(half: int, width: int, height: int) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """Flat offsets of a square patch, its coordinates, the averages over its four sides, and the
    largest coordinates its middle may have."""
    grid = np.arange(-half, half + 1)
    size = len(grid)
    offsets = (grid[:, None] * width + grid).reshape(-1)
    sides = np.zeros((size, size, 4))
    sides[0, :, 0] = sides[-1, :, 1] = sides[:, 0, 2] = sides[:, -1, 3] = 1 / size
    limit = np.array([width - 1.0 - half, height - 1.0 - half])
    return offsets, grid.astype(float), sides.reshape(-1, 4), limit


def _add_seeds(
    seeds: list[Seed],
    image: Image,
    box: Any,
    origin: tuple[int, int],
    level: tuple[float, float],
    settings: BlobSettings,
    usual_width: float = math.inf,
) -> None:
    """Add the seed of one contour's bounding box (x, y, w, h), relative to `origin`.

    level: the background and the threshold's height above it. A Gaussian of width s and height p
    crosses the threshold at the radius s sqrt(2 ln(p / threshold)).
    """
    x, y, w, h = box
    x, y = x + origin[0], y + origin[1]
    rows, columns = image.shape
    cut = x < _BORDER or y < _BORDER or x + w > columns - _BORDER or y + h > rows - _BORDER
    small, large = (w, h) if w < h else (h, w)
    if large > settings.max_size_px or large < 2 or cut:
        return
    height = float(image[y + h // 2, x + w // 2]) - level[0]
    radii = math.sqrt(2 * math.log(max(height / level[1], 1.5)))
    if large > 1.6 * small + 1:
        _add_peaks(seeds, image, (x, y, w, h), min(0.5 * small / radii, usual_width))
    elif large > 2.7 * radii * usual_width + 1.5:
        _add_peaks(seeds, image, (x, y, w, h), usual_width)
    else:
        seeds.append((x + (w - 1) / 2, y + (h - 1) / 2, 0.5 * math.sqrt(w * h) / radii))


def _add_peaks(
    seeds: list[Seed], image: Image, box: tuple[int, int, int, int], width: float
) -> None:
    """One seed for each separate peak of an elongated contour: several blobs that touch."""
    x, y, w, h = box
    crop = cv2.GaussianBlur(image[y : y + h, x : x + w], (3, 3), 0)
    top = (cv2.dilate(crop, np.ones((5, 5), np.uint8)) == crop) & (crop > 0.4 * float(crop.max()))
    count, _, _, centres = cv2.connectedComponentsWithStats(top.astype(np.uint8))
    for cx, cy in centres[1 : min(count, 5)].tolist():
        seeds.append((x + cx, y + cy, width))


def _distinct(blobs: Blobs) -> Blobs:
    """Drop a blob whose centroid ran into a brighter one's."""
    points = blobs.points[:, 0] + 1j * blobs.points[:, 1]
    close = np.abs(points[:, None] - points) < 1.0
    return blobs.take(~np.tril(close, -1).any(axis=1))


def _bright_mask(image: Image, settings: BlobSettings) -> tuple[Image | None, tuple[float, float]]:
    """Pixels that stand out, and the background and threshold used; None when so many stand out
    that only glare can be the cause."""
    sample = image[8::32, 8::32]
    background = float(np.median(sample))
    spread = 1.48 * float(np.median(np.abs(sample.astype(np.int16) - int(background))))
    rise = max(settings.min_contrast_grey, 6 * spread)
    limit = settings.max_bright_fraction * image.size
    if background + rise < 250:
        mask = cv2.threshold(image, background + rise, 255, cv2.THRESH_BINARY)[1]
        if _bright_pixels(mask) <= limit:
            return np.asarray(mask, np.uint8), (background, rise)
    # Sunlight or a lamp: compare with the surroundings instead of with the whole frame.
    rise = settings.min_contrast_grey
    above = cv2.subtract(image, _surroundings(image))
    mask = cv2.threshold(above, rise, 255, cv2.THRESH_BINARY)[1]
    if _bright_pixels(mask) > limit:
        return None, (background, rise)
    return np.asarray(mask, np.uint8), (background, rise)


def _bright_pixels(mask: Any) -> int:
    """About how many pixels of a mask are set: every fourth row is counted."""
    return 4 * cv2.countNonZero(mask[::4])


def _surroundings(image: Image) -> Image:
    """The frame without anything small: an opening of the frame at one eighth of its size."""
    height, width = image.shape
    small = cv2.resize(image, (width // 8, height // 8), interpolation=cv2.INTER_AREA)
    small = cv2.dilate(cv2.erode(small, np.ones((3, 3))), np.ones((5, 5)))
    return np.asarray(cv2.resize(small, (width, height)), np.uint8)
