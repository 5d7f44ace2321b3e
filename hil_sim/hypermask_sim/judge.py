"""The judge: registration in millimetres, from the projected pixels alone.

It finds the test character's dots in the projected picture, sends each centroid through the TRUE
projector on to the TRUE mask where it is when the light arrives, and reports how far on the surface
the light lands from where the dot belongs. It never asks the program where it thinks it drew.

The place where a dot belongs is the centroid that its patch of the surface has in a perfect
picture, met with the surface again: a patch on a curved flank seen at an angle has its centroid
beside its centre (up to 0.3 mm on the nose), which is no error of the program.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.mask import Mask
from hypermask_sim.dots import Dots
from hypermask_sim.lens import lens_of, projector_from_mask
from hypermask_sim.surface import Surface

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

DARK_LEVEL = 4  # of 255; nothing brighter than this anywhere is a black picture
LIT_PIXELS = 12
RIM_OF_PEAK = 0.05  # a blob reaches out to this part of the picture's brightest pixel
MAX_BLOBS = 200  # more is no picture of dots
MAX_TWINS = 5  # blobs of one colour that are considered, the largest ones
PATCH_SAMPLES = 11  # across a dot
AREA_BAND = (0.80, 1.25)  # a dot's area against the expected one, relative to its fellows
ALONE_BAND = (0.60, 1.60)  # the same where too few fellows are seen to compare
FELLOWS = 4
GRAZING = 0.15  # cosine below which a dot's patch faces away too much to be measured


class Optics(Protocol):
    """A projector: K (3, 3); R (3, 3), t (3,) = projector_from_camera; size (width, height).
    Where it is no pinhole, `lens` says what it is."""

    @property
    def K(self) -> Array: ...
    @property
    def R(self) -> Array: ...
    @property
    def t(self) -> Array: ...
    @property
    def size(self) -> tuple[int, int]: ...


class Truth(Protocol):
    """What the judge must know of the world (`hypermask_sim.world.World`). A projector that is
    fixed to its screen, and lights it from behind, has its place in `mounted`."""

    @property
    def mask(self) -> Mask: ...
    @property
    def projector(self) -> Optics: ...
    def camera_from_mask(self, time_s: float, /) -> tuple[Array, Array]: ...


@dataclass(frozen=True)
class Blobs:
    """centroids (N, 2) px; masses (N,) grey levels x px; peaks (N,); colours (N, 3) 0..1."""

    centroids: Array
    masses: Array
    peaks: Array
    colours: Array
    peak: int  # brightest pixel of the whole picture
    brightness: float  # mean of the lit pixels' brightest channel, 0..1
    lit: bool

    @staticmethod
    def none(peak: int = 0) -> Blobs:
        empty = np.empty(0)
        return Blobs(np.empty((0, 2)), empty, empty, np.empty((0, 3)), peak, 0.0, False)


@dataclass(frozen=True)
class FrameMeasurement:
    """One projected picture as it lands on the mask.

    errors: (dot name, millimetres on the surface); displacements_mm: (N, 3) in the mask frame,
    landed minus intended; brightness: mean of the lit pixels 0..1; lit: False for a black picture;
    rejected: dots seen but not fit to be measured (cut by the border, half hidden).
    """

    time_s: float
    errors: tuple[tuple[str, float], ...] = ()
    displacements_mm: Array = field(default_factory=lambda: np.empty((0, 3)))
    brightness: float = 0.0
    lit: bool = False
    rejected: int = 0

    @property
    def rms_mm(self) -> float:
        """Root mean square over the dots; NaN where none was measured."""
        if not self.errors:
            return float("nan")
        return float(np.sqrt(np.mean([error**2 for _, error in self.errors])))


@dataclass(frozen=True)
class RegistrationSummary:
    """Over all dot errors of all frames, millimetres (NaN without any); series: (time_s, rms)."""

    median: float
    rms: float
    p95: float
    max: float
    frames: int
    measured_frames: int
    black_frames: int
    dots: int
    series: tuple[tuple[float, float], ...]


def find_blobs(picture: Picture) -> Blobs:
    """Bright blobs of a projected picture (height, width, 3) RGB; those at its border are left out.

    Intensity centroids over connected pixels above `RIM_OF_PEAK`.
    """
    flat = np.ascontiguousarray(picture).reshape(picture.shape[0], -1)
    rows = flat.max(axis=1)
    peak = int(rows.max())
    if peak <= DARK_LEVEL:
        return Blobs.none(peak)
    threshold = max(DARK_LEVEL, RIM_OF_PEAK * peak)
    top, bottom = _span(rows > threshold)
    left, right = _span(flat[top:bottom].max(axis=0).reshape(-1, 3).max(axis=1) > threshold)
    window = np.s_[top:bottom, left:right]
    red, green, blue = cv2.split(picture[window])
    level = cv2.max(cv2.max(red, green), blue)
    _, bright = cv2.threshold(level, threshold, 255, cv2.THRESH_BINARY)
    count, labels = cv2.connectedComponents(bright)
    index = np.asarray(cv2.findNonZero(bright)).reshape(-1, 2)
    x, y = index[:, 0], index[:, 1]
    label = labels[y, x]
    colour = np.asarray(picture[window][y, x], float)
    weight = colour.max(axis=1)
    lit = len(index) >= LIT_PIXELS
    brightness = float(weight.mean()) / 255
    if count - 1 > MAX_BLOBS:
        none = Blobs.none(peak)
        return Blobs(*_columns(none), peak, brightness, lit)
    mass = np.bincount(label, weight, count)[1:].astype(float)
    centroids = np.stack([np.bincount(label, weight * v, count)[1:] for v in (x, y)], axis=1)
    colours = np.stack([np.bincount(label, channel, count)[1:] for channel in colour.T], axis=1)
    peaks = np.zeros(count)
    np.maximum.at(peaks, label, weight)
    centroids = centroids / mass[:, None] + (left, top)
    inner = ~_at_border(label, x + left, y + top, count, picture.shape)
    return Blobs(
        centroids[inner],
        mass[inner],
        peaks[1:][inner],
        (colours / mass[:, None])[inner],
        peak,
        brightness,
        lit,
    )


def _span(lit: NDArray[np.bool_]) -> tuple[int, int]:
    """First and one past the last true element."""
    where = np.flatnonzero(lit)
    return int(where[0]), int(where[-1]) + 1


def _columns(blobs: Blobs) -> tuple[Array, Array, Array, Array]:
    return blobs.centroids, blobs.masses, blobs.peaks, blobs.colours


def _at_border(
    label: NDArray[Any],
    x: NDArray[Any],
    y: NDArray[Any],
    count: int,
    shape: tuple[int, ...],
) -> NDArray[np.bool_]:
    outside = (x == 0) | (y == 0) | (x == shape[1] - 1) | (y == shape[0] - 1)
    return np.asarray(np.bincount(label[outside], minlength=count)[1:] > 0)


class Judge:
    """Measures pictures of the `dots` character thrown on to the mask of `world`."""

    def __init__(self, world: Truth, dots: Dots) -> None:
        self._world = world
        self._dots = dots
        self._surface = Surface(world.mask)
        self._groups = _twins(dots.codes)
        self._sample_patches()

    def measure(self, picture: Picture, light_s: float) -> list[tuple[str, float]]:
        """(dot name, error in mm) of each dot that can be measured; see `examine`."""
        return list(self.examine(picture, light_s).errors)

    def examine(self, picture: Picture, light_s: float) -> FrameMeasurement:
        """Measure one picture (height, width, 3) uint8 RGB, row 0 at the top, lit at `light_s`."""
        blobs = find_blobs(picture)
        if not len(blobs.masses):
            return FrameMeasurement(light_s, brightness=blobs.brightness, lit=blobs.lit)
        from_mask = projector_from_mask(self._world, light_s)
        expected, areas, facing = self._perfect_dots(*from_mask)
        lands = self._land(np.concatenate([blobs.centroids, expected]), *from_mask)
        landed, intended = lands[: len(blobs.masses)], lands[len(blobs.masses) :]
        pairs = self._pair(blobs, landed, intended, facing)
        kept = self._whole(blobs, areas, pairs)
        displacements = [(landed[blob] - intended[dot]) * 1e3 for blob, dot in kept]
        return FrameMeasurement(
            light_s,
            tuple(
                (self._dots.names[dot], float(np.linalg.norm(offset)))
                for (_, dot), offset in zip(kept, displacements, strict=True)
            ),
            np.array(displacements).reshape(-1, 3),
            blobs.brightness,
            blobs.lit,
            len(pairs) - len(kept),
        )

    @staticmethod
    def summary(frames: Sequence[FrameMeasurement]) -> RegistrationSummary:
        errors = np.array([error for frame in frames for _, error in frame.errors])
        nan = float("nan")
        found = errors.size > 0
        return RegistrationSummary(
            median=float(np.median(errors)) if found else nan,
            rms=float(np.sqrt(np.mean(errors**2))) if found else nan,
            p95=float(np.percentile(errors, 95)) if found else nan,
            max=float(errors.max()) if found else nan,
            frames=len(frames),
            measured_frames=sum(bool(frame.errors) for frame in frames),
            black_frames=sum(not frame.lit for frame in frames),
            dots=int(errors.size),
            series=tuple((frame.time_s, frame.rms_mm) for frame in frames),
        )

    def _sample_patches(self) -> None:
        """Points (N, S, 3), normals of length dA/dxdy and brightness of each dot's patch."""
        rim = self._dots.rim_radius_m
        line = np.linspace(-rim, rim, PATCH_SAMPLES)
        dx, dy = (grid.ravel() for grid in np.meshgrid(line, line))
        x = self._dots.positions[:, 0, None] + dx
        y = self._dots.positions[:, 1, None] + dy
        slope = self._surface.slope(x, y)
        self._points = np.stack([x, y, self._surface.height(x, y)], axis=-1)
        self._normals = np.concatenate([-slope, np.ones((*x.shape, 1))], axis=-1)
        self._profile = self._dots.profile(np.hypot(dx, dy))
        self._cell_m2 = float(line[1] - line[0]) ** 2

    def _perfect_dots(
        self, rotation: Array, translation: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Centroids (N, 2) px, areas (N,) px and visibility of the dots in a perfect picture.

        A surface element n dx dy at p, seen from the centre c, fills the solid angle
        |n . (p - c)| / |p - c|^3 dx dy, of which the lens makes so many pixels.
        """
        lens = lens_of(self._world.projector)
        centre = -rotation.T @ translation
        seen = self._points @ rotation.T + translation
        pixels = lens.image(seen)
        towards = centre - self._points
        behind = centre[2] < 0  # a screen that is lit from inside
        incidence = np.sum(self._normals * towards, axis=-1) * (-1 if behind else 1)
        distance = np.linalg.norm(towards, axis=-1)
        weight = np.maximum(incidence, 0) / distance**3 * lens.density(seen) * self._profile
        total = np.maximum(weight.sum(axis=1), 1e-12)
        centroids = np.sum(pixels * weight[..., None], axis=1) / total[:, None]
        length = np.linalg.norm(self._normals, axis=-1) * distance
        facing = np.min(incidence / length, axis=1) > GRAZING
        facing &= (seen[..., 2] > 0).all(axis=1)
        return centroids, total * self._cell_m2, facing

    def _land(self, pixels: Array, rotation: Array, translation: Array) -> Array:
        """Where the light of picture points (N, 2) lands, (N, 3) in the mask frame."""
        rays = lens_of(self._world.projector).rays(pixels)
        return self._surface.meet(-rotation.T @ translation, rays @ rotation)

    def _pair(
        self, blobs: Blobs, landed: Array, intended: Array, facing: NDArray[np.bool_]
    ) -> list[tuple[int, int]]:
        """(blob, dot) by colour; among twins the pairing with the smallest sum of squares."""
        codes = blobs.colours > 0.5
        pure = np.all(np.abs(blobs.colours - 0.5) > 0.2, axis=1)
        measurable = pure & np.isfinite(landed).all(axis=1)
        pairs: list[tuple[int, int]] = []
        for code, members in self._groups:
            dots = [dot for dot in members if facing[dot] and np.isfinite(intended[dot]).all()]
            found = np.flatnonzero(measurable & (codes == code).all(axis=1))
            largest = found[np.argsort(-blobs.masses[found], kind="stable")][:MAX_TWINS]
            squares = np.sum((landed[largest, None] - intended[None, dots]) ** 2, axis=-1)
            pairs += [(int(largest[i]), dots[j]) for i, j in _cheapest(squares)]
        return pairs

    def _whole(
        self, blobs: Blobs, areas: Array, pairs: list[tuple[int, int]]
    ) -> list[tuple[int, int]]:
        """The pairs whose blob covers as many pixels as a whole dot does.

        A fault common to all dots (wrong distance) is an error to report, not to reject: hence
        relative to the median where enough dots are seen.
        """
        if not pairs:
            return []
        blob, dot = np.array(pairs).T
        ratio = blobs.masses[blob] / blobs.peaks[blob] / areas[dot]
        together = len(pairs) >= FELLOWS
        low, high = AREA_BAND if together else ALONE_BAND
        ratio = ratio / np.median(ratio) if together else ratio
        return [pair for pair, r in zip(pairs, ratio, strict=True) if low <= r <= high]


def _twins(codes: NDArray[np.bool_]) -> list[tuple[NDArray[np.bool_], list[int]]]:
    """(colour code, its dots' indices) for each colour in use."""
    unique = np.unique(codes, axis=0)
    return [(code, np.flatnonzero((codes == code).all(axis=1)).tolist()) for code in unique]


def _cheapest(costs: Array) -> list[tuple[int, int]]:
    """The pairing of rows with columns, as many as can be, with the smallest sum."""
    rows, columns = costs.shape
    if rows > columns:
        return [(row, column) for column, row in _cheapest(costs.T)]
    choices = itertools.permutations(range(columns), rows)
    best = min(choices, key=lambda choice: sum(costs[i, j] for i, j in enumerate(choice)))
    return list(enumerate(best))
