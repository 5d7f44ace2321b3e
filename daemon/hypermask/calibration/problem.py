"""The weighted least-squares problem behind click the LEDs, and its solution step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hypermask.calibration.parameters import (
    PARAMETERS,
    ProCam,
    difference,
    parameter_jacobian,
    pose_jacobian,
    updated,
)
from hypermask.calibration.placements import Placement
from hypermask.geometry import Array


@dataclass(frozen=True)
class Problem:
    """n clicks: points (n, 3) in the camera frame and pixels (n, 2); names: (placement, LED).

    held: (9, 9) information of the prior about `nominal`. pose_noise: (2n, 2n) covariance of the
    pixels from the errors of the measured poses; clicks of one placement share its pose's error.
    sigma_px: of a click an axis.
    """

    points: Array
    pixels: Array
    names: tuple[tuple[int, int], ...]
    pose_noise: Array
    nominal: ProCam
    held: Array
    sigma_px: float

    @staticmethod
    def of(
        placements: Sequence[Placement],
        leds: Array,
        nominal: ProCam,
        held: Array,
        sigma_px: float,
    ) -> Problem:
        points = [p.pose.apply(leds[p.clicked]) for p in placements]
        pixels = [p.pixels[p.clicked] for p in placements]
        names = [(i, int(led)) for i, p in enumerate(placements) for led in p.clicked]
        noise = np.zeros((2 * len(names), 2 * len(names)))
        start = 0
        for placement in placements:
            clicked = leds[placement.clicked]
            rows = pose_jacobian(nominal, placement.pose, clicked).reshape(-1, 6)
            block = slice(start, start + len(rows))
            noise[block, block] = rows @ placement.covariance @ rows.T
            start += len(rows)
        return Problem(
            np.concatenate([np.empty((0, 3)), *points]),
            np.concatenate([np.empty((0, 2)), *pixels]),
            tuple(names),
            noise,
            nominal,
            held,
            sigma_px,
        )

    def residuals(self, procam: ProCam) -> Array:
        """(n, 2) clicked minus predicted pixels."""
        return self.pixels - procam.project(self.points)

    def rows(self, procam: ProCam) -> Array:
        """(n, 2, 9) derivatives of the predicted pixels."""
        return parameter_jacobian(procam, self.points)

    def own_noise(self) -> Array:
        """(n, 2, 2) covariance of each click by itself."""
        count = len(self.names)
        blocks = self.pose_noise.reshape(count, 2, count, 2)[range(count), :, range(count)]
        own: Array = blocks + self.sigma_px**2 * np.eye(2)
        return own

    def certainty(self, weights: Array) -> Array:
        """(2n, 2n) inverse covariance, the clicks' variance divided by `weights` (n,)."""
        variance = self.sigma_px**2 / np.maximum(weights, 1e-9)
        covariance = self.pose_noise + np.diag(np.repeat(variance, 2))
        return np.asarray(np.linalg.inv(covariance), float)

    def information(self, rows: Array, certainty: Array) -> Array:
        """(9, 9) prior and clicks."""
        flat = rows.reshape(-1, PARAMETERS)
        information: Array = self.held + flat.T @ certainty @ flat
        return information

    def cost(self, procam: ProCam, certainty: Array) -> float:
        """Squared normalised residuals of clicks and prior: minus twice the log posterior."""
        off = difference(procam, self.nominal)
        errors = self.residuals(procam).ravel()
        return float(errors @ certainty @ errors + off @ self.held @ off)


def minimise(problem: Problem, procam: ProCam, weights: Array) -> ProCam:
    """Gauss-Newton with halved steps; the problem is close to linear, so a few suffice."""
    certainty = problem.certainty(weights)
    cost = problem.cost(procam, certainty)
    for _ in range(20):
        rows = problem.rows(procam)
        information = problem.information(rows, certainty)
        gradient = rows.reshape(-1, PARAMETERS).T @ certainty @ problem.residuals(procam).ravel()
        gradient -= problem.held @ difference(procam, problem.nominal)
        step = np.asarray(np.linalg.solve(information, gradient), float)
        procam, cost, gained = _descend(problem, procam, step, certainty, cost)
        if gained < 1e-6:
            break
    return procam


def _descend(
    problem: Problem, procam: ProCam, step: Array, certainty: Array, cost: float
) -> tuple[ProCam, float, float]:
    """The longest of step, step/2, ... that lowers the cost: where it leads, cost, gain."""
    for _ in range(12):
        candidate = updated(procam, step)
        there = problem.cost(candidate, certainty)
        if there < cost:
            return candidate, there, cost - there
        step = step / 2
    return procam, cost, 0.0
