"""Which blob of each window is the LED: chosen jointly, so that one pose explains all of them.

The prediction's error moves all LEDs together. With J the points' derivative by the pose, P the
prediction's covariance and R the centroids', the innovations of the true blobs have covariance
S = J P J' + R; of all combinations the one with the least Mahalanobis distance is taken (joint
compatibility, Neira and Tardos 2001), a LED left out costing a fixed amount.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from hypermask.config import Settings
from hypermask.geometry import Array
from hypermask.tracking.blobs import Blobs


class AssignSettings(Settings):
    # The prediction is a model, heads are not: its covariance is multiplied by this.
    prediction_inflation: float = Field(4.0, ge=1)
    # Model error of a centroid (LED shape, lens) on top of its noise.
    model_sigma_px: float = Field(0.08, gt=0)
    # Chi-square above which all together are not believed; 10 degrees of freedom.
    joint_gate: float = Field(30.0, gt=0)
    missing_cost: float = Field(14.0, gt=0)
    max_candidates: int = Field(3, ge=1)


def assign(
    blobs: Blobs,
    owners: NDArray[np.int64],
    projected: Array,
    spread: Array,
    peaks: Array,
    settings: AssignSettings,
) -> NDArray[np.int64]:
    """(5,) index of each LED's blob, -1 where none.

    owners: (n,) window (= LED) of each blob; projected: (5, 2); spread: (10, 10) J P J', px^2;
    peaks: (5,) the LEDs' usual brightness in grey levels.
    """
    if not len(owners):
        return np.full(len(projected), -1, np.int64)
    innovation = settings.prediction_inflation * spread
    if owners.tolist() == list(range(len(projected))):
        offsets = (blobs.points - projected).reshape(1, -1)
        if _distance(offsets, innovation, blobs.sigmas, settings)[0] <= settings.joint_gate:
            return owners
    return _best_combination(blobs, owners, projected, innovation, peaks, settings)


def _best_combination(
    blobs: Blobs,
    owners: NDArray[np.int64],
    projected: Array,
    innovation: Array,
    peaks: Array,
    settings: AssignSettings,
) -> NDArray[np.int64]:
    """Try every combination of candidates and hidden LEDs."""
    choices = [
        [*_candidates(blobs, owners, led, projected, innovation, peaks, settings), -1]
        for led in range(len(projected))
    ]
    table = np.array(list(product(*choices)), np.int64)
    best, least = np.full(len(projected), -1, np.int64), np.inf
    hidden = table < 0
    patterns = hidden @ (1 << np.arange(len(projected)))
    for pattern in np.unique(patterns).tolist():
        rows = table[patterns == pattern]
        seen = ~hidden[patterns == pattern][0]
        missing = settings.missing_cost * float(np.count_nonzero(~seen))
        if not seen.any() or missing >= least:
            continue
        which = np.repeat(seen, 2)
        chosen = rows[:, seen]
        offsets = (blobs.points[chosen] - projected[seen]).reshape(len(rows), -1)
        sigmas = blobs.sigmas[chosen].max(axis=0)
        cost = _distance(offsets, innovation[np.ix_(which, which)], sigmas, settings)
        strange = _brightness_cost(blobs.peaks[chosen], peaks[seen]).sum(axis=1)
        fits = cost <= 3.0 * np.count_nonzero(which)
        total = np.where(fits & ~_twice(blobs.points[chosen]), cost + strange + missing, np.inf)
        k = int(np.argmin(total))
        if total[k] < least:
            least, best = float(total[k]), rows[k]
    return best


def _candidates(
    blobs: Blobs,
    owners: NDArray[np.int64],
    led: int,
    projected: Array,
    innovation: Array,
    peaks: Array,
    settings: AssignSettings,
) -> list[int]:
    """The few most likely blobs of one LED, each for itself."""
    mine = np.nonzero(owners == led)[0]
    if len(mine) <= settings.max_candidates:
        return [int(k) for k in mine]
    block = innovation[2 * led : 2 * led + 2, 2 * led : 2 * led + 2]
    offsets = blobs.points[mine] - projected[led]
    cost = _distance(offsets, block, blobs.sigmas[mine].max(keepdims=True), settings)
    cost += _brightness_cost(blobs.peaks[mine], peaks[led])
    return [int(k) for k in mine[np.argsort(cost, kind="stable")[: settings.max_candidates]]]


def _distance(offsets: Array, innovation: Array, sigmas: Array, settings: AssignSettings) -> Array:
    """Squared Mahalanobis distances (m,) of offsets (m, 2 k); sigmas: (k,)."""
    total = innovation.copy()
    noise = np.repeat(sigmas * sigmas + settings.model_sigma_px**2, 2)
    total.reshape(-1)[:: len(total) + 1] += noise
    solved = np.linalg.solve(total, offsets.T)
    distance: Array = (offsets.T * solved).sum(axis=0)
    return distance


def _twice(points: Array) -> NDArray[np.bool_]:
    """Whether a combination (m, k, 2) takes one blob for two LEDs (their windows overlap)."""
    place = points[..., 0] + 1j * points[..., 1]
    close = np.abs(place[:, :, None] - place[:, None, :]) < 1.0
    taken: NDArray[np.bool_] = np.triu(close, 1).any(axis=(1, 2))
    return taken


def _brightness_cost(seen: Array, usual: Array) -> Array:
    """A blob of another brightness than the LED's is less likely to be it."""
    cost: Array = 4.0 * np.log(np.maximum(seen, 1.0) / np.maximum(usual, 1.0)) ** 2
    return cost
