"""A small stand-in for the reference cart: truth projected through K, R, t; tracked LEDs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from hypermask.calibration.outcome import Cart
from hypermask.calibration.parameters import ProCam, nominal_procam, point_jacobian, skew
from hypermask.calibration.placements import Placement
from hypermask.calibration.positions import Position
from hypermask.calibration.quality import WorkingVolume, working_volume
from hypermask.calibration.session import Session
from hypermask.calibration.still import Sighting
from hypermask.geometry import (
    FACING,
    Array,
    Pinhole,
    Pose,
    rotation_from_attitude,
    rotation_from_vector,
)
from hypermask.mask import load_mask
from hypermask_sim.operator import Operator, true_look

MASK = load_mask(Path(__file__).parents[2] / "configs" / "masks" / "reference")
CAMERA = Pinhole.from_focal(900, (639.5, 399.5), (1280, 800))


def reference_truth(baseline_m: float = 0.150) -> ProCam:
    """f = 1920 px, 1280 x 720, axis at the lower edge, beside the camera."""
    return nominal_procam((1280, 720), 1.5, (0.0, 0.5), (baseline_m, 0.0, 0.0))


def data_sheet(baseline_m: float = 0.150) -> ProCam:
    """What a user would write into the machine file: some percent and degrees off the truth."""
    position = (baseline_m + 0.008, 0.006, -0.010)
    return nominal_procam((1280, 720), 1.55, (0.008, 0.48), position, (1.0, -1.5, 2.0))


@dataclass
class Rig:
    """The mask where the operator put it, and a tracker whose centroids have `noise_px`."""

    truth: ProCam = field(default_factory=reference_truth)
    nominal: ProCam = field(default_factory=data_sheet)
    seed: int = 0
    noise_px: float = 0.04
    operator_px: float = 1.0
    time_s: float = 0.0
    pose: Pose = field(default_factory=Pose.identity)
    exact_places: bool = False

    def __post_init__(self) -> None:
        self.random = np.random.default_rng([self.seed, 5])
        look = true_look(
            self.truth.projector.matrix,
            (
                self.truth.projector_from_camera.rotation,
                self.truth.projector_from_camera.translation,
            ),
            MASK.leds,
            lambda: (self.pose.rotation, self.pose.translation),
        )
        self.operator = Operator(look, self.operator_px, self.seed)
        self.cart = Cart(MASK, CAMERA, self.nominal)

    def session(self, method: str = "click", **options: object) -> Session:
        return Session(self.cart, method, **options)  # type: ignore[arg-type]

    def put(self, position: Position) -> None:
        wanted = position.camera_from_mask().translation, (0.0, position.pitch, position.yaw)
        place, attitude = wanted if self.exact_places else self.operator.place(*wanted)
        self.pose = Pose(FACING @ rotation_from_attitude(*attitude), np.asarray(place))

    def sighting(self) -> Sighting:
        """One frame: noisy centroids, pose by least squares, its covariance."""
        self.time_s += 1 / 120
        exact = CAMERA.project(self.pose.apply(MASK.leds))
        points = exact + self.random.normal(0, self.noise_px, exact.shape)
        return Sighting(self.time_s, *self._solve(points), points)

    def _solve(self, points: Array) -> tuple[Pose, Array]:
        turn = cv2.Rodrigues(self.pose.rotation)[0]
        shift = self.pose.translation.reshape(3, 1).copy()
        turn, shift = cv2.solvePnPRefineLM(
            MASK.leds, points, CAMERA.matrix, None, turn.copy(), shift
        )
        pose = Pose(rotation_from_vector(turn), np.asarray(shift, float).reshape(3))
        seen = pose.apply(MASK.leds)
        by_point = point_jacobian(ProCam(CAMERA, Pose.identity()), seen)
        motion = np.concatenate(
            [-skew(seen - pose.translation), np.broadcast_to(np.eye(3), (5, 3, 3))], axis=2
        )
        rows = (by_point @ motion).reshape(-1, 6)
        return pose, np.linalg.inv(rows.T @ rows) * max(self.noise_px, 1e-6) ** 2

    def measure(self, position: Position) -> list[Sighting]:
        self.put(position)
        return [self.sighting() for _ in range(20)]


@cache
def volume() -> WorkingVolume:
    return working_volume(MASK, CAMERA, reference_truth())


def true_errors_mm(procam: ProCam, truth: ProCam, where: WorkingVolume) -> Array:
    """(n,) rms over the mask's surface for each pose of `where`, millimetres on the mask."""
    errors = []
    for pose in where.poses:
        points = pose.apply(where.points)
        across = point_jacobian(truth, points) @ pose.rotation[:, :2]
        off = procam.project(points) - truth.project(points)
        on_mask = np.linalg.solve(across, off[..., None])[..., 0]
        errors.append(np.sqrt(np.mean(np.sum(on_mask**2, axis=1))))
    return np.array(errors) * 1e3


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def placements(
    truth: ProCam,
    positions: list[Position],
    noise: Callable[[], Array] = lambda: np.zeros((5, 2)),
) -> list[Placement]:
    """Clicks straight from the truth, without keys."""
    made = []
    for position in positions:
        pose = position.camera_from_mask()
        points = pose.apply(MASK.leds)
        pixels = truth.project(points) + noise()
        made.append(Placement(pose, np.eye(6) * 1e-10, CAMERA.project(points), pixels))
    return made
