"""How good a calibration is, in millimetres on the mask, and what would make it better.

The covariance C of the projector's parameters, times the derivative E of the place where light
falls on the mask by those parameters, gives the expected squared error trace(E C E^T), averaged
over the working volume: mask poses over the picture, the distances and the attitudes (PAPERS.md
A2). The average of E^T E is one 9x9 matrix, so judging a candidate position costs microseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hypermask.calibration.parameters import (
    PARAMETERS,
    ProCam,
    parameter_jacobian,
    point_jacobian,
)
from hypermask.calibration.positions import Position, best, candidates, eyes, fits, information
from hypermask.calibration.procam import Solution
from hypermask.errors import DataError
from hypermask.geometry import FACING, Array, Pinhole, Pose, rotation_from_attitude
from hypermask.mask import Mask

GOOD_MM, FAIR_MM, POOR_MM = 0.6, 1.0, 2.0
PITCH_DEG, YAW_DEG = 20.0, 30.0
DISTANCES_M = (1.2, 2.4)


@dataclass(frozen=True)
class WorkingVolume:
    """Mask poses all over the working range; points: (m, 3) of the mask's surface."""

    poses: tuple[Pose, ...]
    points: Array

    def error_jacobian(self, procam: ProCam, pose: Pose) -> Array:
        """(m, 2, 9) metres on the mask by the projector's parameters.

        A shift of the light by p pixels moves it on the mask by J^-1 p, J = d(pixel)/d(mask x, y).
        """
        points = pose.apply(self.points)
        across = point_jacobian(procam, points) @ pose.rotation[:, :2]
        return np.asarray(np.linalg.solve(across, parameter_jacobian(procam, points)), float)

    def weights(self, procam: ProCam) -> Array:
        """(n, 9, 9) E^T E of every pose, averaged over the mask's points."""
        products = []
        for pose in self.poses:
            rows = self.error_jacobian(procam, pose).reshape(-1, PARAMETERS)
            products.append(rows.T @ rows / len(self.points))
        return np.array(products)

    def weight(self, procam: ProCam) -> Array:
        """(9, 9) with trace(weight C) = the mean squared error in m^2."""
        mean: Array = self.weights(procam).mean(axis=0)
        return mean


def working_volume(
    mask: Mask,
    camera: Pinhole,
    procam: ProCam,
    distances_m: tuple[float, float] = DISTANCES_M,
    count: int = 150,
) -> WorkingVolume:
    """Poses over the whole range of distance, picture, roll, pitch and yaw, LEDs in view.

    A fixed random sample: the same cart gives the same figures. Raises `DataError` CAL-NOROOM.
    """
    rng = np.random.default_rng(20011)
    poses: list[Pose] = []
    for _ in range(50 * count):
        pose = _random_pose(rng, procam, distances_m)
        if fits(pose, mask.leds, *eyes(camera, procam)):
            poses.append(pose)
        if len(poses) == count:
            break
    if not poses:
        raise DataError(
            "CAL-NOROOM",
            "no place was found where camera and projector both see the whole mask",
            "Check the distances, and where camera and projector look.",
        )
    return WorkingVolume(tuple(poses), _surface_points(mask))


def _random_pose(rng: np.random.Generator, procam: ProCam, distances: tuple[float, float]) -> Pose:
    width, height = procam.projector.size
    distance = rng.uniform(*distances)
    ray = np.linalg.solve(
        procam.projector.matrix, [rng.uniform(0, width), rng.uniform(0, height), 1.0]
    )
    centre = procam.projector_from_camera.inverse().apply(ray * distance)
    limits = np.radians([180.0, PITCH_DEG, YAW_DEG])
    rotation = FACING @ rotation_from_attitude(*rng.uniform(-limits, limits))
    return Pose(rotation, centre)


def _surface_points(mask: Mask) -> Array:
    """A grid of points of the relief inside the outline, metres (m, 3)."""
    outline = mask.settings.outline
    x, y = np.meshgrid(
        np.linspace(-outline.half_width_m, outline.half_width_m, 7),
        np.linspace(-outline.half_height_m, outline.half_height_m, 9),
    )
    inside = mask.inside(x, y)
    x, y = x[inside], y[inside]
    return np.column_stack([x, y, mask.height(x, y)])


@dataclass(frozen=True)
class Quality:
    """expected_mm: rms over the working volume; by_distance: (metres, mm) of its near, middle
    and far third; sigma_px: the operator's error an axis; outliers: wrong clicks by name;
    add: the position to add next and the error in mm it would leave."""

    expected_mm: float
    by_distance: tuple[tuple[float, float], ...]
    sigma_px: float
    clicks: int
    outliers: tuple[str, ...]
    add: Position | None
    add_mm: float

    @property
    def grade(self) -> str:
        """good, fair, poor or unusable."""
        limits = ((GOOD_MM, "good"), (FAIR_MM, "fair"), (POOR_MM, "poor"))
        return next((word for limit, word in limits if self.expected_mm <= limit), "unusable")

    def lines(self) -> list[str]:
        """For the operator."""
        lines = [f"{self.grade}: {self.expected_mm:.1f} mm expected"]
        lines += [f"left out: {name}" for name in self.outliers]
        if self.add is not None and self.grade != "good":
            lines.append(f"add a position {self.add}: {self.add_mm:.1f} mm expected then")
        elif self.add is not None:
            lines.append(f"to improve it, add a position {self.add} ({self.add_mm:.2f} mm)")
        return lines


def assess(
    solution: Solution,
    mask: Mask,
    camera: Pinhole,
    distances_m: Sequence[float] = (1.2, 1.8, 2.4),
) -> Quality:
    """The expected error of `solution`, and the candidate position that lowers it most."""
    procam = solution.procam
    volume = working_volume(mask, camera, procam, (min(distances_m), max(distances_m)))
    weights = volume.weights(procam)
    errors = np.einsum("nij,ji->n", weights, solution.covariance)
    add, add_mm = next_position(solution, weights.mean(axis=0), mask, camera, distances_m)
    return Quality(
        float(np.sqrt(errors.mean()) * 1e3),
        _by_distance(volume, errors),
        solution.sigma_px,
        solution.used,
        tuple(str(click) for click in solution.outliers),
        add,
        add_mm,
    )


def _by_distance(volume: WorkingVolume, errors: Array) -> tuple[tuple[float, float], ...]:
    depths = np.array([pose.translation[2] for pose in volume.poses])
    thirds = np.array_split(np.argsort(depths), 3)
    return tuple(
        (float(depths[i].mean()), float(np.sqrt(errors[i].mean()) * 1e3)) for i in thirds if len(i)
    )


def next_position(
    solution: Solution, volume: Array, mask: Mask, camera: Pinhole, distances_m: Sequence[float]
) -> tuple[Position | None, float]:
    """The candidate that would lower the expected error most, and the error in mm it leaves."""
    procam = solution.procam
    possible = candidates(mask.leds, camera, procam, distances_m)
    if not possible:
        return None, float("nan")
    gains = np.array([information(p, mask.leds, procam, solution.sigma_px) for p in possible])
    known = np.asarray(np.linalg.inv(solution.covariance), float)
    index, error = best(known, gains, volume)
    return possible[index], error * 1e3
