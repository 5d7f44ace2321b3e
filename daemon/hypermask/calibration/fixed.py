"""A face-shaped screen that is fixed to its projector: where each point of it is in the picture.

The Mask-bot's calibration (Maejima et al. 2012: once, by hand, no camera). The operator lays the
light of control points on their marks on the screen. A fisheye lens and its place are fitted to
that, held by what the builder knows; what the model cannot explain is carried over the screen by
radial basis functions, as far as it is more than the operator's own error.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask.errors import DataError
from hypermask.geometry import Array, Fisheye, Pose, rotation_from_vector
from hypermask.mask import Mask

COLUMNS, ROWS = 5, 7
WITHIN = 0.92
"""Control points stand within the outline scaled by this."""
LEAST_POINTS = 8
ROUGHEST_PX = 10.0
"""About 3 mm an axis: no operator is so far off."""
OUTLIER = 5.0
"""A control point so many standard deviations from all others was not laid on its mark."""
BEHIND = np.diag([-1.0, -1.0, 1.0])
"""projector_from_mask rotation of a projector that looks out of the face."""

_SIZES_PX = (0.0, 0.3, 0.6, 1.2, 2.4, 5.0)
_REACHES_M = (0.03, 0.06, 0.12)
_STEPS = 1e-6


@dataclass(frozen=True)
class Fixed:
    """lens, and projector_from_mask: where it is; anchors (N, 3) mask metres, weights (N, 2) px and
    reach_m of the radial basis functions; expected_mm: expected error over the screen."""

    lens: Fisheye
    projector_from_mask: Pose
    anchors: Array = field(default_factory=lambda: np.zeros((0, 3)))
    weights: Array = field(default_factory=lambda: np.zeros((0, 2)))
    reach_m: float = 0.06
    expected_mm: float = 0.0

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels of the picture."""
        return self.lens.size

    def project(self, points: ArrayLike) -> Array:
        """Pixels (n, 2) that light the screen's points (n, 3) mask metres."""
        places = np.asarray(points, float)
        pixels = self.lens.project(self.projector_from_mask.apply(places))
        if len(self.anchors):
            pixels = pixels + _bumps(places, self.anchors, self.reach_m) @ self.weights
        return pixels

    def density(self, points: ArrayLike, normals: ArrayLike) -> Array:
        """(n,) pixels per square metre of the screen at points (n, 3) with unit normals (n, 3): as
        bright is a picture of even brightness there."""
        places, up = np.asarray(points, float), np.asarray(normals, float)
        first = np.cross(up, [0.0, 1.0, 0.0])
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second = np.cross(up, first)
        step = 1e-4
        a, b = (
            (self.project(places + step * way) - self.project(places - step * way)) / (2 * step)
            for way in (first, second)
        )
        return np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


@dataclass(frozen=True)
class LensPrior:
    """How far the builder's figures may be off, one sigma."""

    focal_fraction: float = 0.02
    centre_px: float = 12.0
    k: tuple[float, float, float, float] = (0.02, 0.01, 0.004, 0.001)
    rotation_rad: float = 0.04
    translation_m: float = 0.004

    def sigmas(self, nominal: Fixed) -> Array:
        """(13,) in the order of `moved`."""
        focal = self.focal_fraction * float(nominal.lens.matrix[0, 0])
        turn, place = [self.rotation_rad] * 3, [self.translation_m] * 3
        return np.array([focal, self.centre_px, self.centre_px, *self.k, *turn, *place])


@dataclass(frozen=True)
class FixedFit:
    """fixed; sigma_px of the operator, estimated; used: how many points; left_out: their numbers,
    counted from 0, worst first."""

    fixed: Fixed
    sigma_px: float
    used: int
    left_out: tuple[int, ...]


def nominal_fixed(
    size: tuple[int, int],
    focal_px: float,
    lens_m: tuple[float, float, float] = (0.0, 0.0, -0.12),
    k: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    centre_px: tuple[float, float] | None = None,
    attitude_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Fixed:
    """What the builder knows, the start of a calibration. lens_m: the lens's centre in the mask
    frame; attitude_deg: roll, pitch, yaw by which the projector was turned in its own axes."""
    cx, cy = centre_px or ((size[0] - 1) / 2, (size[1] - 1) / 2)
    matrix = np.array([[focal_px, 0, cx], [0, focal_px, cy], [0, 0, 1.0]])
    roll, pitch, yaw = np.radians(attitude_deg)
    turned = rotation_from_vector([0, yaw, 0]) @ rotation_from_vector([pitch, 0, 0])
    rotation = turned @ rotation_from_vector([0, 0, roll]) @ BEHIND
    lens = Fisheye(matrix, np.array(k, float), size)
    return Fixed(lens, Pose(rotation, -rotation @ np.array(lens_m)))


def control_points(mask: Mask, columns: int = COLUMNS, rows: int = ROWS) -> Array:
    """(N, 3) marks on the screen: a grid inside its outline, from the middle outwards, so that the
    first ones lie where the builder's figures are nearly right."""
    outline = mask.settings.outline
    xs = np.linspace(-1, 1, columns) * outline.half_width_m * WITHIN
    ys = np.linspace(1, -1, rows) * outline.half_height_m * WITHIN
    x, y = (grid.ravel() for grid in np.meshgrid(xs, ys))
    # The grid's corners are drawn in on to the rounded outline.
    powers = np.abs(x / outline.half_width_m) ** outline.exponent
    powers += np.abs(y / outline.half_height_m) ** outline.exponent
    limit = WITHIN**outline.exponent
    inwards = np.minimum(1.0, (limit / np.maximum(powers, 1e-12)) ** (1 / outline.exponent))
    x, y = x * inwards, y * inwards
    order = np.argsort(np.round(np.hypot(x, y), 6), kind="stable")
    x, y = x[order], y[order]
    return np.column_stack([x, y, mask.height(x, y)])


def solve(
    points: ArrayLike,
    pixels: ArrayLike,
    nominal: Fixed,
    mask: Mask,
    sigma_px: float = 1.5,
    prior: LensPrior | None = None,
) -> FixedFit:
    """The calibration from control points (N, 3) mask metres and the pixels (N, 2) that light them.

    Raises `DataError` CAL-FEW (fewer than `LEAST_POINTS`), CAL-CLICKS (they do not agree).
    """
    places, seen = np.asarray(points, float), np.asarray(pixels, float)
    if len(places) < LEAST_POINTS:
        raise DataError(
            "CAL-FEW",
            f"{len(places)} control points are too few, {LEAST_POINTS} are needed",
            "Lay more of them on their marks.",
        )
    left_out: list[int] = []
    good = np.ones(len(places), bool)
    while True:
        fitted = fit(places[good], seen[good], nominal, sigma_px, prior)
        sigma = _sigma(seen[good] - fitted.project(places[good]), sigma_px)
        # Each one left is judged by all the others, so that one wrong point cannot bend the map.
        if sigma > ROUGHEST_PX:
            raise _contradiction(len(places), len(places))
        away = _left_one_out(places[good], seen[good], fitted, sigma)
        worst = int(np.argmax(away))
        if away[worst] <= OUTLIER * max(sigma, sigma_px):
            break
        left_out.append(int(np.flatnonzero(good)[worst]))
        good[left_out[-1]] = False
        if len(left_out) > len(places) // 4:
            raise _contradiction(len(left_out), len(places))
    residuals = seen[good] - fitted.project(places[good])
    bent = _bend(fitted, places[good], residuals, sigma)
    expected = _expected_mm(bent, places[good], mask, nominal, sigma, prior or LensPrior())
    return FixedFit(replace(bent, expected_mm=expected), sigma, int(good.sum()), tuple(left_out))


def _contradiction(wrong: int, count: int) -> DataError:
    return DataError(
        "CAL-CLICKS",
        f"{wrong} of {count} control points do not agree with the others",
        "Start again; lay the light of each point on its own mark.",
    )


def fit(
    points: Array,
    pixels: Array,
    nominal: Fixed,
    sigma_px: float = 1.5,
    prior: LensPrior | None = None,
) -> Fixed:
    """Lens and place alone, from any number of points: where they are few, the prior decides.

    Gauss and Newton, with Cauchy's weights against points that were not laid on their marks.
    """
    held = 1 / (prior or LensPrior()).sigmas(nominal)
    step = np.zeros(len(held))
    for turn in range(12):
        here = moved(nominal, step)
        residuals = pixels - here.project(points)
        scale = max(40.0 / 2**turn, 3.0) * sigma_px
        weights = 1 / (1 + np.sum(residuals**2, axis=1) / scale**2)
        root = np.repeat(np.sqrt(weights), 2) / sigma_px
        rows = _jacobian(nominal, step, points) * root[:, None]
        system = rows.T @ rows + np.diag(held**2)
        change = np.linalg.solve(system, rows.T @ (residuals.ravel() * root) - held**2 * step)
        step = step + change
        if np.max(np.abs(change) * held) < 1e-8:
            break
    return moved(nominal, step)


def moved(nominal: Fixed, step: Array) -> Fixed:
    """`nominal` with its parameters (13,) changed: focal length, principal point (px), k (4), a
    small rotation vector (rad, from the left) about the lens, its place (m, projector frame)."""
    matrix = nominal.lens.matrix.copy()
    matrix[0, 0] += step[0]
    matrix[1, 1] *= matrix[0, 0] / nominal.lens.matrix[0, 0]
    matrix[:2, 2] += step[1:3]
    pose = nominal.projector_from_mask
    turned = Pose(
        rotation_from_vector(step[7:10]) @ pose.rotation,
        rotation_from_vector(step[7:10]) @ pose.translation + step[10:],
    )
    return Fixed(Fisheye(matrix, nominal.lens.k + step[3:7], nominal.lens.size), turned)


def _jacobian(nominal: Fixed, step: Array, points: Array) -> Array:
    """(2 N, 13) derivatives of the pixels."""
    scales = LensPrior().sigmas(nominal) * _STEPS * 100
    columns = []
    for index, scale in enumerate(scales):
        change = np.zeros(len(step))
        change[index] = scale
        ahead = moved(nominal, step + change).project(points)
        back = moved(nominal, step - change).project(points)
        columns.append((ahead - back).ravel() / (2 * scale))
    return np.stack(columns, axis=1)


def _sigma(residuals: Array, expected_px: float) -> float:
    """An axis, robust; it leans on the expected one as if that came from five points."""
    freedom = max(2 * len(residuals) - 11, 0)
    median = float(np.median(np.linalg.norm(residuals, axis=1))) / 1.1774
    found = median**2 * 2 * len(residuals) / max(freedom, 1)
    return float(np.sqrt((10 * expected_px**2 + freedom * found) / (10 + freedom)))


def _left_one_out(points: Array, pixels: Array, fitted: Fixed, sigma: float) -> Array:
    """(N,) how far each point is from where all the others put it, px."""
    held = np.diag(1 / LensPrior().sigmas(fitted) ** 2) * sigma**2
    rows = _jacobian(fitted, np.zeros(13), points)
    hat = rows @ np.linalg.solve(rows.T @ rows + held, rows.T)
    residuals = (pixels - fitted.project(points)).ravel()
    blocks = hat.reshape(len(points), 2, len(points), 2)
    away = [
        np.linalg.solve(np.eye(2) - blocks[i, :, i] * 0.999, residuals[2 * i : 2 * i + 2])
        for i in range(len(points))
    ]
    return np.asarray(np.linalg.norm(away, axis=1))


def _bend(fitted: Fixed, points: Array, residuals: Array, sigma: float) -> Fixed:
    """Carry over the screen what the lens leaves, where leaving one out says that this helps.

    Ridge regression: bumps of a size (px, one sigma) and a reach are a Gaussian process.
    """
    best: tuple[float, Fixed] = (np.inf, fitted)
    for reach in _REACHES_M:
        bumps = _bumps(points, points, reach)
        for size in _SIZES_PX:
            inverse = np.linalg.inv(size**2 * bumps + sigma**2 * np.eye(len(points)))
            missed = inverse @ residuals / np.diag(inverse)[:, None]
            score = float(np.mean(missed**2))
            if score < best[0] * 0.97:
                weights = size**2 * inverse @ residuals
                best = score, replace(fitted, anchors=points, weights=weights, reach_m=reach)
    return best[1] if np.any(best[1].weights) else fitted


def _bumps(points: Array, anchors: Array, reach_m: float) -> Array:
    """(n, N) Gaussian bumps of the distance over the screen's front, x and y."""
    squares = np.sum((points[:, None, :2] - anchors[None, :, :2]) ** 2, axis=-1)
    return np.asarray(np.exp(-squares / (2 * reach_m**2)))


def _expected_mm(
    fixed: Fixed, points: Array, mask: Mask, nominal: Fixed, sigma: float, prior: LensPrior
) -> float:
    """The operator's error as it goes through the fit on to the screen, rms in millimetres."""
    held = np.diag(1 / prior.sigmas(nominal) ** 2)
    rows = _jacobian(fixed, np.zeros(13), points)
    covariance = np.linalg.inv(rows.T @ rows / sigma**2 + held)
    there = control_points(mask, 9, 13)
    spread = _jacobian(fixed, np.zeros(13), there).reshape(-1, 2, 13)
    variances = np.einsum("nij,jk,nik->n", spread, covariance, spread)
    if len(fixed.anchors):
        variances = variances + 2 * sigma**2 / len(points) * 4
    pixel_m = pixel_size_m(fixed, there)
    return float(np.sqrt(np.mean(variances * pixel_m**2)) * 1e3)


def pixel_size_m(fixed: Fixed, points: Array) -> NDArray[np.float64]:
    """(n,) mean width of a pixel at points of the screen, seen from the front."""
    step = 1e-4
    ways = [
        (fixed.project(points + way) - fixed.project(points - way)) / (2 * step)
        for way in np.eye(3)[:2] * step
    ]
    area = np.abs(ways[0][:, 0] * ways[1][:, 1] - ways[0][:, 1] * ways[1][:, 0])
    return np.asarray(1 / np.sqrt(area))
