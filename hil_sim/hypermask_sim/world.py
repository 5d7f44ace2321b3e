"""The truth of a simulated show: where everything is, and what it looks like, at any time.

All times are clock seconds; the scenario's time 0 is `origin_s` on that clock. The cart frame is
the camera frame (x right, y down, z forward).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hypermask_drivers.errors import ConfigError
from hypermask_drivers.mask import Mask, load_mask
from hypermask_sim.faults import Faults
from hypermask_sim.lens import FisheyeLens, Lens, PinholeLens
from hypermask_sim.optics import Horizon, Spots, angular_fall_off, exposure_moments, spot_size
from hypermask_sim.performer import attitude_rotations, find_motion
from hypermask_sim.scenario import Attitude, Scenario
from hypermask_sim.voice_source import Voice, find_voice

Array = NDArray[np.float64]

FACING: Array = np.diag([1.0, -1.0, -1.0])
"""Rotation camera_from_mask of a mask that faces the camera upright."""

REFERENCE_DISTANCE_M = 1.8
_NEAREST_M = 0.3


@dataclass(frozen=True)
class CameraTruth:
    """K: (3, 3); size: (width, height) in pixels."""

    K: Array
    size: tuple[int, int]

    def project(self, points: Array) -> Array:
        """Image points (..., 2) of points (..., 3) in the camera frame."""
        return _project(self.K, points)


@dataclass(frozen=True)
class ProjectorTruth:
    """K: (3, 3); R (3, 3), t (3,): projector_from_camera; size: (width, height) in pixels.

    A Mask-bot's turns with the head: R and t are then those of the head looking straight ahead.
    """

    K: Array
    R: Array
    t: Array
    size: tuple[int, int]
    lens: Lens

    def project(self, points: Array) -> Array:
        """Picture points (..., 2) of points (..., 3) in the camera frame."""
        return self.lens.image(points @ self.R.T + self.t)

    def ray(self, pixel: ArrayLike) -> tuple[Array, Array]:
        """Origin (3,) and direction (3,), unit depth, of a pixel's light in the camera frame."""
        direction = self.R.T @ self.lens.rays(np.asarray(pixel, float).reshape(1, 2))[0]
        return -self.R.T @ self.t, direction / direction[2]


def _project(matrix: Array, points: Array) -> Array:
    image = points @ matrix.T
    flat: Array = image[..., :2] / image[..., 2:]
    return flat


class World:
    """A scenario and everything that follows from it.

    Raises at once what the mask's and the motion's files can be blamed for (MASK-*, MOTION-*);
    the recording (VOICE-*) is read when it is first asked for.
    """

    def __init__(self, scenario: Scenario, origin_s: float = 0.0) -> None:
        self.scenario = scenario
        self.origin_s = origin_s
        self.mask: Mask = load_mask(_mask_folder(scenario.mask))
        self.camera = _camera(scenario)
        performer = scenario.performer
        self._attitude = rotation_of(performer.attitude_deg)
        self.neck: Callable[[float], tuple[float, float]] | None = None
        self.mounted = _mounted(scenario) if scenario.mapping == "fixed" else None
        self._place_projector()
        direction = np.array([0.0, 0, 1]) if self.mounted else self._picture_ray()[1]
        self.motion = find_motion(
            performer.motion, performer.speed, FACING @ direction, float(self.rest[2])
        )
        self.faults = Faults(scenario.faults, scenario.seed, self.camera.size)
        self._horizon = Horizon(self.mask)
        self._check_distance()

    def _place_projector(self) -> None:
        """`rest`, the mask's place at rest, and `projector`; each may hang on the other."""
        performer = self.scenario.performer
        given = None if performer.position_m is None else np.array(performer.position_m)
        if self.mounted is None:
            self.projector = _projector(self.scenario)
            self.rest: Array = self.rest_position(performer.distance_m) if given is None else given
            return
        self.rest = np.array([0.0, 0.0, performer.distance_m]) if given is None else given
        turn = self.mounted[0] @ (FACING @ self._attitude).T
        self.projector = _fisheye(self.scenario, turn, self.mounted[1] - turn @ self.rest)

    @cached_property
    def voice(self) -> Voice:
        """The performer's voice at the microphone's rate, from `performer.voice_start_s` on."""
        performer = self.scenario.performer
        voice = find_voice(performer.voice, self.scenario.microphone.rate_hz)
        if performer.voice_pause_s is None:
            return voice
        return voice.repeated(performer.voice_pause_s, self.duration_s)

    @property
    def notes(self) -> list[str]:
        """What the user should know about the simulated inputs."""
        return [self.voice.note] if self.voice.note else []

    @property
    def duration_s(self) -> float:
        return self.scenario.duration_s or self.motion.duration_s or 10.0

    def _picture_ray(self) -> tuple[Array, Array]:
        width, height = self.projector.size
        return self.projector.ray([(width - 1) / 2, (height - 1) / 2])

    def rest_position(self, distance_m: float) -> Array:
        """(3,) point at depth `distance_m` on the ray through the picture's centre."""
        origin, direction = self._picture_ray()
        point: Array = origin + direction * (distance_m - origin[2])
        return point

    def _check_distance(self) -> None:
        times = np.arange(0.0, min(self.duration_s, 600.0), 0.02)
        _, positions = self.motion.at(times)
        nearest = float((self.rest[2] - positions[:, 2]).min())
        if nearest < _NEAREST_M:
            raise ConfigError(
                "MOTION-RANGE",
                f"the mask comes as near as {nearest:.2f} m to the camera",
                "Choose a larger performer.distance_m or another motion.",
            )

    # Poses -----------------------------------------------------------------------------------

    def camera_from_masks(self, times_s: Array) -> tuple[Array, Array]:
        """True poses at clock times (n,): R (n, 3, 3), t (n, 3) metres."""
        rotations, positions = self.motion.at(np.asarray(times_s, float) - self.origin_s)
        rotations, positions = (
            FACING @ rotations @ self._attitude,
            self.rest + positions @ FACING.T,
        )
        if self.neck is None:
            return rotations, positions
        pivot = np.array(self.scenario.screen.pivot_m)
        turns = np.array([neck_rotation(*self.neck(float(time_s))) for time_s in times_s])
        moved = positions + np.einsum("nij,nj->ni", rotations, pivot - turns @ pivot)
        return rotations @ turns, moved

    def camera_from_mask(self, time_s: float) -> tuple[Array, Array]:
        """True pose at a clock time: R (3, 3), t (3,) metres."""
        rotations, positions = self.camera_from_masks(np.array([time_s]))
        return rotations[0], positions[0]

    def put(self, position_m: ArrayLike, attitude: Attitude) -> None:
        """Somebody puts the mask somewhere else, from now on: an operator who calibrates."""
        self.rest, self._attitude = np.asarray(position_m, float), rotation_of(attitude)

    # Light -----------------------------------------------------------------------------------

    @property
    def light_delay_s(self) -> float:
        """From a page flip to the mean time of its light: the projector's lag and half a scan."""
        projector = self.scenario.projector
        return projector.light_ms * 1e-3 + 0.5 / projector.rate_hz

    def light_time(self, flip_s: float) -> float:
        """When the light of a frame flipped at `flip_s` reaches the mask."""
        return flip_s + self.light_delay_s

    def led_points(self, time_s: float) -> tuple[Array, NDArray[np.bool_]]:
        """True image points (5, 2) of the LEDs, and (5,) whether the camera can see each."""
        rotation, position = self.camera_from_mask(time_s)
        points = self.camera.project(self.mask.leds @ rotation.T + position)
        width, height = self.camera.size
        inside = np.all((points > -0.5) & (points < [width - 0.5, height - 0.5]), axis=1)
        return points, self._lit(rotation, position, time_s) & inside

    def _lit(self, rotation: Array, position: Array, time_s: float) -> NDArray[np.bool_]:
        """(5,) LEDs that are on, turned to the camera and not behind the face's relief."""
        hidden = self.faults.hidden_leds(time_s - self.origin_s)
        eye = -rotation.T @ position  # the camera in the mask frame
        ways = eye - self.mask.leds
        turned = np.sum(ways * self.mask.normals, axis=1) > 0
        return np.asarray(~hidden & turned & self._horizon.clear(ways))

    # What the camera sees ----------------------------------------------------------------------

    def spots(self, time_s: float, exposure_s: float) -> Spots | None:
        """All points of light in the frame whose mid-exposure is at clock time `time_s`."""
        offsets, weights = exposure_moments(exposure_s)
        times = time_s + offsets
        rotations, positions = self.camera_from_masks(times)
        gain = exposure_s / 1e-3
        middle = len(times) // 2
        parts = [
            self._led_spots(rotations, positions, time_s),
            self._reflection_spots(times, rotations[middle], positions[middle]),
            *self._blob_spots(times),
        ]
        lit = [part for part in parts if len(part[0])]
        if not lit:
            return None
        points, peaks, sizes = (np.concatenate(column) for column in zip(*lit, strict=True))
        return Spots(points, weights, gain * peaks, sizes)

    def _led_spots(
        self, rotations: Array, positions: Array, time_s: float
    ) -> tuple[Array, Array, Array]:
        """Points (n, m, 2), peaks (n,) and sizes (n,) of the lit LEDs, poses at m moments."""
        middle = len(rotations) // 2
        rotation, position = rotations[middle], positions[middle]
        lit = self._lit(rotation, position, time_s)
        places = self.mask.leds[lit] @ rotations.transpose(0, 2, 1) + positions[:, None]
        points = self.camera.project(places).transpose(1, 0, 2)
        now = places[middle]
        distance = np.sqrt(np.sum(now * now, axis=1))
        cosines = -np.sum((self.mask.normals[lit] @ rotation.T) * now, axis=1) / distance
        leds = self.scenario.leds
        focal = self.camera.K[0, 0] * leds.diameter_mm * 1e-3
        psf = self.scenario.camera.psf_px
        sizes = spot_size(psf, focal / now[:, 2])
        reference = spot_size(psf, np.array(focal / REFERENCE_DISTANCE_M))
        # `peak` sets the light at the reference distance; nearer, it also fills a larger disc.
        peaks = leds.peak * (REFERENCE_DISTANCE_M / distance) ** 2 * (reference / sizes) ** 2
        return points, peaks * angular_fall_off(cosines, leds.half_angle_deg), sizes

    @cached_property
    def _reflections(self) -> tuple[Array, Array, Array, Array, Array]:
        """Middle (n, 3), swing (n, 3), rate (n,) Hz, peaks (n,), sizes (n,)."""
        spots = self.scenario.reflections
        start = np.array([spot.position_m for spot in spots]).reshape(-1, 3)
        end = np.array([spot.to_m or spot.position_m for spot in spots]).reshape(-1, 3)
        return (
            (start + end) / 2,
            (start - end) / 2,
            np.array([1 / spot.period_s for spot in spots]),
            np.array([spot.peak for spot in spots]),
            np.array([spot.size_px for spot in spots]),
        )

    def reflection_positions(self, times_s: Array) -> Array:
        """(n, m, 3) camera-frame positions of the scenario's reflections at clock times (m,)."""
        middle, swing, rate, _, _ = self._reflections
        turn = np.cos(2 * np.pi * rate[:, None] * (times_s - self.origin_s))
        positions: Array = middle[:, None] + swing[:, None] * turn[..., None]
        return positions

    def _reflection_spots(
        self, times: Array, rotation: Array, position: Array
    ) -> tuple[Array, Array, Array]:
        _, _, _, peaks, sizes = self._reflections
        places = self.reflection_positions(times)
        seen = ~self._behind_mask(places[:, len(times) // 2], rotation, position)
        return self.camera.project(places[seen]), peaks[seen], sizes[seen]

    def _behind_mask(self, places: Array, rotation: Array, position: Array) -> NDArray[np.bool_]:
        """(n,) whether the mask's plane, within its outline, hides points (n, 3)."""
        facing = places @ rotation[:, 2]
        reach = float(position @ rotation[:, 2])
        share = reach / np.where(np.abs(facing) < 1e-9, 1e-9, facing)
        hits = (places * share[:, None] - position) @ rotation
        return (share > 0) & (share < 1) & self.mask.inside(hits[:, 0], hits[:, 1])

    def _blob_spots(self, times: Array) -> list[tuple[Array, Array, Array]]:
        now = times - self.origin_s
        size = self.scenario.camera.psf_px * 1.3
        return [
            (blobs.at(now), blobs.peaks, np.full(len(blobs.peaks), size))
            for blobs in self.faults.blobs(float(now[len(now) // 2]))
        ]


def neck_rotation(pan_rad: float, tilt_rad: float) -> Array:
    """(3, 3) of the head on its unit: pan to its left, tilt up."""
    rotation: Array = attitude_rotations(np.array([[0.0, -tilt_rad, pan_rad]]))[0]
    return rotation


def rotation_of(attitude: Attitude) -> Array:
    """(3, 3) rotation of roll, pitch and yaw in degrees, in the mask's axes."""
    degrees = np.array([[attitude.roll, attitude.pitch, attitude.yaw]])
    rotation: Array = attitude_rotations(np.deg2rad(degrees))[0]
    return rotation


def _camera(scenario: Scenario) -> CameraTruth:
    camera = scenario.camera
    centre = camera.centre_px or ((camera.width - 1) / 2, (camera.height - 1) / 2)
    return CameraTruth(_matrix(camera.focal_px, centre), (camera.width, camera.height))


def _projector(scenario: Scenario) -> ProjectorTruth:
    """Attitude in the camera's axes: roll about z, pitch about x, yaw about y."""
    projector = scenario.projector
    centre = projector.centre_px or ((projector.width - 1) / 2, projector.height - 0.5)
    camera_from_projector = FACING @ rotation_of(projector.attitude_deg) @ FACING
    rotation = camera_from_projector.T
    matrix = _matrix(projector.focal_px, centre)
    return ProjectorTruth(
        matrix,
        rotation,
        -rotation @ np.array(projector.position_m),
        (projector.width, projector.height),
        PinholeLens(matrix),
    )


def _mounted(scenario: Scenario) -> tuple[Array, Array]:
    """R (3, 3), t (3,): projector_from_mask of a projector behind its screen, as it really is."""
    screen = scenario.screen
    # It looks out of the face: x to the audience's left, y down.
    rotation = rotation_of(screen.lens_error_deg) @ np.diag([-1.0, -1.0, 1.0])
    place = np.array(screen.lens_m) + np.array(screen.lens_error_mm) * 1e-3
    return rotation, -rotation @ place


def _fisheye(scenario: Scenario, rotation: Array, translation: Array) -> ProjectorTruth:
    projector, screen = scenario.projector, scenario.screen
    centre = projector.centre_px or ((projector.width - 1) / 2, (projector.height - 1) / 2)
    matrix = _matrix(projector.focal_px * (1 + screen.focal_error), centre)
    k1, k2, k3, k4 = (a + b for a, b in zip(screen.k, screen.k_error, strict=True))
    lens = FisheyeLens(matrix, (k1, k2, k3, k4), screen.decentring)
    size = (projector.width, projector.height)
    return ProjectorTruth(matrix, rotation, translation, size, lens)


def _matrix(focal_px: float, centre_px: tuple[float, float]) -> Array:
    return np.array([[focal_px, 0, centre_px[0]], [0, focal_px, centre_px[1]], [0, 0, 1.0]])


def _mask_folder(name: str) -> Path:
    """A folder as it is, or the one of that name in the program's configs/masks."""
    if (Path(name) / "mask.toml").is_file():
        return Path(name)
    share = os.environ.get("HYPERMASK_SHARE")
    roots = [Path(share)] if share else [Path(__file__).resolve().parents[2]]
    for root in (*roots, Path("/usr/share/hypermask")):
        folder = root / "configs" / "masks" / name
        if (folder / "mask.toml").is_file():
            return folder
    raise ConfigError("MASK-ABSENT", f"there is no mask '{name}'", "Check the scenario's 'mask'.")
