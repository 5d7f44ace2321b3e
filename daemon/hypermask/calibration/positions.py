"""Where to put the mask for a calibration: positions in words, and which ones help most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hypermask.calibration.parameters import PARAMETERS, ProCam, ProjectorPrior, parameter_jacobian
from hypermask.geometry import FACING, Array, Pinhole, Pose, rotation_from_attitude

MARGIN_PX = 10.0
PLACING_M = 0.03
"""How far beside a position a person puts the mask; its LEDs must still be in the picture."""
YAWS_DEG = (-25.0, 0.0, 25.0)
PITCHES_DEG = (0.0, 20.0)
DISTANCES_M = (1.2, 1.8, 2.4)


@dataclass(frozen=True)
class Position:
    """The mask's centre (x, y, distance) in the camera frame, metres, and attitude in radians.

    side, level: -1, 0, 1 for left/middle/right and low/middle/high in the projector's picture.
    """

    x_m: float
    y_m: float
    distance_m: float
    pitch: float = 0.0
    yaw: float = 0.0
    side: int = 0
    level: int = 0

    def camera_from_mask(self) -> Pose:
        rotation = FACING @ rotation_from_attitude(0.0, self.pitch, self.yaw)
        return Pose(rotation, np.array([self.x_m, self.y_m, self.distance_m]))

    def __str__(self) -> str:
        """For the operator, who looks from the cart towards the mask."""
        words = [f"{self.distance_m:.1f} m away", ("left", "middle", "right")[self.side + 1]]
        words[1] = "in the middle" if self.side == 0 else f"to the {words[1]}"
        if self.level:
            words.append("high in the picture" if self.level > 0 else "low in the picture")
        if abs(self.yaw) > 0.05:
            way = "right" if self.yaw > 0 else "left"
            words.append(f"nose turned {abs(np.degrees(self.yaw)):.0f}° to the {way}")
        if abs(self.pitch) > 0.05:
            way = "down" if self.pitch > 0 else "up"
            words.append(f"{abs(np.degrees(self.pitch)):.0f}° {way}")
        return ", ".join(words)


def position_at(
    procam: ProCam,
    pixel: tuple[float, float],
    distance_m: float,
    pitch: float = 0.0,
    yaw: float = 0.0,
) -> Position:
    """The position whose centre lies on projector `pixel` at camera depth `distance_m`."""
    inverse = procam.projector_from_camera.inverse()
    ray = np.linalg.solve(procam.projector.matrix, [*pixel, 1.0])
    direction = inverse.rotation @ ray
    point = inverse.translation + direction * ((distance_m - inverse.translation[2]) / direction[2])
    width, height = procam.projector.size
    return Position(
        float(point[0]),
        float(point[1]),
        float(distance_m),
        pitch,
        yaw,
        _third(pixel[0] / width),
        -_third(pixel[1] / height),
    )


def recentred(position: Position, planned_for: ProCam, known: ProCam) -> Position:
    """The same place in the picture, now that the projector is better known than when planned."""
    centre = planned_for.project([position.x_m, position.y_m, position.distance_m])
    pixel = (float(centre[0]), float(centre[1]))
    return position_at(known, pixel, position.distance_m, position.pitch, position.yaw)


def central_first(positions: Sequence[Position], procam: ProCam) -> list[Position]:
    """The one nearest the picture's middle first: a wrong data sheet can push those at the edge
    out of the picture, and the first clicks mend the data sheet."""
    if not positions:
        return []
    middle = np.array(procam.projector.size) / 2

    def off_centre(position: Position) -> float:
        centre = procam.project([position.x_m, position.y_m, position.distance_m])
        return float(np.linalg.norm(centre - middle))

    first = min(positions, key=off_centre)
    return [first, *(p for p in positions if p is not first)]


def _third(fraction: float) -> int:
    return -1 if fraction < 0.4 else (1 if fraction > 0.6 else 0)


def fits(pose: Pose, leds: Array, *pinholes: tuple[Pinhole, Pose], placing_m: float = 0.0) -> bool:
    """Whether all LEDs lie in the picture of each (pinhole, its pose from the camera frame), also
    when the mask is `placing_m` beside `pose`."""
    points = pose.apply(leds)
    for pinhole, from_camera in pinholes:
        image = pinhole.project(from_camera.apply(points))
        margin = MARGIN_PX + placing_m * pinhole.matrix[0, 0] / pose.translation[2]
        if not np.all((image > margin) & (image < np.array(pinhole.size) - margin)):
            return False
    return True


def eyes(camera: Pinhole, procam: ProCam) -> tuple[tuple[Pinhole, Pose], tuple[Pinhole, Pose]]:
    """Camera and projector as `fits` takes them."""
    return (camera, Pose.identity()), (procam.projector, procam.projector_from_camera)


def candidates(
    leds: Array, camera: Pinhole, procam: ProCam, distances_m: Sequence[float] = DISTANCES_M
) -> list[Position]:
    """Positions a person can set up: a grid over the picture, nose turned and lowered."""
    width, height = procam.projector.size
    both, found = eyes(camera, procam), []
    for distance in distances_m:
        for u in np.linspace(0.08, 0.92, 9) * width:
            for v in np.linspace(0.1, 0.9, 7) * height:
                for pitch in np.radians(PITCHES_DEG):
                    for yaw in np.radians(YAWS_DEG):
                        position = position_at(
                            procam, (float(u), float(v)), distance, float(pitch), float(yaw)
                        )
                        pose = position.camera_from_mask()
                        if fits(pose, leds, *both, placing_m=PLACING_M):
                            found.append(position)
    return found


def information(position: Position, leds: Array, procam: ProCam, sigma_px: float) -> Array:
    """(9, 9) what five clicks at `position` say of the projector's parameters."""
    points = position.camera_from_mask().apply(leds)
    rows = parameter_jacobian(procam, points).reshape(-1, PARAMETERS)
    gain: Array = rows.T @ rows / sigma_px**2
    return gain


def plan(
    leds: Array,
    camera: Pinhole,
    nominal: ProCam,
    volume: Array,
    distances_m: Sequence[float] = DISTANCES_M,
    poses_per_distance: int = 2,
    prior: ProjectorPrior | None = None,
) -> list[Position]:
    """The positions that make the expected error over the working volume least.

    volume: (9, 9) from `quality.WorkingVolume.weight`. An exchange search: each position in turn
    is replaced by the best one at its distance, until nothing improves (a V-optimal design).
    A distance at which the mask fits nowhere in both pictures is left out. Nearest first.
    """
    known = (prior or ProjectorPrior()).information(nominal)
    choices = []
    for distance in sorted(distances_m):
        possible = candidates(leds, camera, nominal, (distance,))
        if possible:
            gains = np.array([information(p, leds, nominal, 1.0) for p in possible])
            choices += [(possible, gains)] * poses_per_distance
    return _exchange(choices, known, volume)


def _exchange(
    choices: list[tuple[list[Position], Array]], known: Array, volume: Array
) -> list[Position]:
    """Greedy start, then exchanges; at most ten rounds."""
    chosen: list[int | None] = [None] * len(choices)
    for _ in range(10):
        before = list(chosen)
        for slot, (_, gains) in enumerate(choices):
            others = known + sum(
                (
                    other[1][index]
                    for j, (other, index) in enumerate(zip(choices, chosen, strict=True))
                    if j != slot and index is not None
                ),
                np.zeros_like(known),
            )
            chosen[slot] = best(others, gains, volume)[0]
        if chosen == before:
            break
    return [c[0][i] for c, i in zip(choices, chosen, strict=True) if i is not None]


def best(known: Array, gains: Array, volume: Array) -> tuple[int, float]:
    """The index among `gains` (n, 9, 9) that leaves the least error, and that error (m rms)."""
    scale = np.sqrt(np.diag(known + gains.mean(axis=0)))
    scaled = (known + gains) / np.outer(scale, scale)
    errors = np.trace(
        np.linalg.solve(scaled, np.broadcast_to(volume / np.outer(scale, scale), scaled.shape)),
        axis1=1,
        axis2=2,
    )
    index = int(np.argmin(errors))
    return index, float(np.sqrt(max(errors[index], 0.0)))
