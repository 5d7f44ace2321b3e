"""Click the LEDs: the projector's full matrix from cross-hairs laid on the mask's LEDs.

Every click pairs a projector pixel with a 3-D point, an LED at the mask's tracked pose. All the
unknowns are solved together: the nine parameters of the projector, held weakly by what its data
sheet says, and the small pose errors of each mask position, which are marginalised: they add
J C J^T to the covariance of that position's clicks (generalised least squares). A click that
disagrees with all others is left out and named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hypermask.calibration.parameters import PARAMETERS, ProCam, ProjectorPrior
from hypermask.calibration.placements import Click, Flags, Placement, check_placements
from hypermask.calibration.problem import Problem, minimise
from hypermask.errors import DataError
from hypermask.geometry import Array

OUTLIER = 18.4
"""Squared normalised distance of a wrong click: chi-square with 2 degrees of freedom, p = 1e-4."""


@dataclass(frozen=True)
class Solution:
    """procam; covariance (9, 9) of its parameters; sigma_px of the clicks an axis, estimated;
    used: number of clicks used; outliers: the clicks left out, worst first."""

    procam: ProCam
    covariance: Array
    sigma_px: float
    used: int
    outliers: tuple[Click, ...]


def solve(
    placements: Sequence[Placement],
    leds: Array,
    nominal: ProCam,
    prior: ProjectorPrior | None = None,
    sigma_px: float = 1.0,
) -> Solution:
    """The projector from clicks on `leds` (5, 3) mask metres, at several distances.

    Raises `DataError` CAL-FEW, CAL-DEPTH (all clicks at one distance) or CAL-CLICKS (they do not
    agree with one another).
    """
    check_placements(placements)
    solution = fit(placements, leds, nominal, prior, sigma_px)
    total = solution.used + len(solution.outliers)
    if len(solution.outliers) > total // 4:
        raise DataError(
            "CAL-CLICKS",
            f"{len(solution.outliers)} of {total} clicks do not agree with the others "
            f"(worst: {solution.outliers[0]})",
            _advice_on_outliers(solution.outliers),
        )
    return solution


def _advice_on_outliers(outliers: Sequence[Click]) -> str:
    counts = np.bincount([click.placement for click in outliers])
    worst = int(np.argmax(counts))
    if counts[worst] >= 3:
        return f"The mask probably moved at position {worst + 1}: click that position again."
    return "Click those LEDs again, the cross-hair's centre on each LED."


def fit(
    placements: Sequence[Placement],
    leds: Array,
    nominal: ProCam,
    prior: ProjectorPrior | None = None,
    sigma_px: float = 1.0,
) -> Solution:
    """As `solve`, but from any number of clicks: where they are few, the prior decides."""
    held = (prior or ProjectorPrior()).information(nominal)
    problem = Problem.of(placements, leds, nominal, held, sigma_px)
    procam, weights = _robust_start(problem)
    sigma = max(sigma_px, _robust_sigma(problem.residuals(procam)[weights > 0.1], sigma_px))
    problem = replace(problem, sigma_px=sigma)
    good = np.ones(len(weights), bool)
    for _ in range(len(weights)):
        procam = minimise(problem, procam, good.astype(float))
        wrong = _distances(problem, procam, good) > OUTLIER
        if np.array_equal(~wrong, good) or good.sum() <= PARAMETERS // 2:
            break
        good = _one_step(good, wrong, problem, procam)
    procam = minimise(problem, procam, good.astype(float))
    return _solution(problem, procam, good, sigma_px)


def _robust_start(problem: Problem) -> tuple[ProCam, Array]:
    """Cauchy weights, scale falling from coarse to fine, so that wrong clicks do not lead."""
    procam = problem.nominal
    weights = np.ones(len(problem.pixels))
    for scale_px in (100.0, 30.0, 10.0, 5.0, 3.0, 3.0, 3.0):
        scale = max(scale_px, 3 * problem.sigma_px)
        procam = minimise(problem, procam, weights)
        errors = np.linalg.norm(problem.residuals(procam), axis=1)
        weights = 1 / (1 + (errors / scale) ** 2)
    return procam, weights


def _robust_sigma(residuals: Array, fallback: float) -> float:
    """Sigma an axis of 2-D residuals from their median length (Rayleigh: 1.1774 sigma)."""
    if len(residuals) <= PARAMETERS:
        return fallback
    spent = PARAMETERS / (2 * len(residuals))
    median = float(np.median(np.linalg.norm(residuals, axis=1)))
    return median / 1.1774 / float(np.sqrt(1 - spent))


def _distances(problem: Problem, procam: ProCam, good: Flags) -> Array:
    """Squared residual of each click, normalised by its variance under the fit without it."""
    rows = problem.rows(procam)
    covariance = np.linalg.inv(problem.information(rows, problem.certainty(good.astype(float))))
    spread = rows @ covariance @ np.swapaxes(rows, 1, 2)
    noise = problem.own_noise()
    sign = np.where(good, -1.0, 1.0)[:, None, None]
    total = noise + sign * spread
    total += 1e-3 * noise  # a click nobody else checks has no residual and no variance
    errors = problem.residuals(procam)[..., None]
    return np.asarray(np.sum(errors * np.linalg.solve(total, errors), axis=(1, 2)), float)


def _one_step(good: Flags, wrong: Flags, problem: Problem, procam: ProCam) -> Flags:
    """Leave out the worst wrong click that is still used, or else take back the right ones."""
    candidates = np.flatnonzero(good & wrong)
    changed = good.copy()
    if len(candidates):
        distances = _distances(problem, procam, good)
        changed[candidates[np.argmax(distances[candidates])]] = False
        return changed
    changed[~wrong] = True
    return changed


def _solution(problem: Problem, procam: ProCam, good: Flags, expected_sigma: float) -> Solution:
    """The estimated sigma leans on the expected one as if that came from ten clicks."""
    residuals = problem.residuals(procam)
    used = int(good.sum())
    trust = 20
    freedom = max(0, 2 * used - PARAMETERS)
    squares = float(np.sum(residuals[good] ** 2)) if freedom else 0.0
    sigma = float(np.sqrt((trust * expected_sigma**2 + squares) / (trust + freedom)))
    final = replace(problem, sigma_px=sigma)
    information = final.information(final.rows(procam), final.certainty(good.astype(float)))
    outliers = [
        Click(*name, float(np.linalg.norm(error)))
        for name, error, used_here in zip(problem.names, residuals, good, strict=True)
        if not used_here
    ]
    outliers.sort(key=lambda click: -click.error_px)
    covariance = np.asarray(np.linalg.inv(information), float)
    return Solution(procam, covariance, sigma, used, tuple(outliers))
