"""The judge reports what was imposed, and nothing where nothing is wrong."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hypermask_drivers.mask import Mask, load_mask
from hypermask_sim.dots import Dots, load_dots
from hypermask_sim.judge import FrameMeasurement, Judge

CONFIGS = Path(__file__).parents[2] / "configs"
FACING = np.diag([1.0, -1.0, -1.0])
Array = NDArray[np.float64]
Picture = NDArray[np.uint8]


def rotation(*vector: float) -> Array:
    return np.asarray(cv2.Rodrigues(np.array(vector))[0], float)


@dataclass(frozen=True)
class Optics:
    """The reference cart's projector: lens shift, 150 mm beside the camera."""

    K: Array = field(
        default_factory=lambda: np.array([[1920.0, 0, 639.5], [0, 1920.0, 719.5], [0, 0, 1]])
    )
    R: Array = field(default_factory=lambda: rotation(0.17, 0.03, 0.01))
    t: Array = field(default_factory=lambda: np.array([-0.15, 0.02, 0.01]))
    size: tuple[int, int] = (1280, 720)


@dataclass(frozen=True)
class World:
    mask: Mask
    rotation: Array
    translation: Array
    projector: Optics = field(default_factory=Optics)
    velocity: Array = field(default_factory=lambda: np.zeros(3))

    def camera_from_mask(self, time_s: float) -> tuple[Array, Array]:
        return self.rotation, self.translation + self.velocity * time_s

    def projector_from_mask(self) -> tuple[Array, Array]:
        optics = self.projector
        return optics.R @ self.rotation, optics.R @ self.translation + optics.t


def attitude(roll: float = 0, pitch: float = 0, yaw: float = 0) -> Array:
    """Ry(yaw) Rx(pitch) Rz(roll), degrees."""
    roll, pitch, yaw = np.radians([roll, pitch, yaw])
    return rotation(0, yaw, 0) @ rotation(pitch, 0, 0) @ rotation(0, 0, roll)


def world(mask: Mask, distance: float = 1.8, **degrees: float) -> World:
    return World(mask, FACING @ attitude(**degrees), np.array([0.02, -0.01, distance]))


def shifted(world: World, x: float, y: float) -> Array:
    return np.asarray(world.translation + np.array([x, y, 0.0]))


def perfect_picture(world: World, texture: Picture, finer: int = 4) -> Picture:
    """What a perfect projector program shows: every sub-pixel's ray traced on to the relief.

    Independent of the judge's and of the stage's geometry: the ray is followed by fixed-point
    iteration on a cubic-interpolated relief, `finer` x `finer` rays a pixel.
    """
    rotation, translation = world.projector_from_mask()
    width, height = world.projector.size
    half_width, half_height = world.mask.half_size_m
    corners = np.array(
        [[x, y, z] for x in (-0.1, 0.1) for y in (-0.13, 0.13) for z in (-0.02, 0.04)]
    )
    image = (corners @ rotation.T + translation) @ world.projector.K.T
    box = image[:, :2] / image[:, 2:]
    left, top = np.clip(np.floor(box.min(0)).astype(int), 0, [width, height])
    right, bottom = np.clip(np.ceil(box.max(0)).astype(int), 0, [width, height])
    step = 1 / finer
    px = left - 0.5 + step / 2 + step * np.arange((right - left) * finer)
    py = top - 0.5 + step / 2 + step * np.arange((bottom - top) * finer)
    gx, gy = np.meshgrid(px, py)
    rays = np.linalg.solve(world.projector.K, np.stack([gx, gy, np.ones_like(gx)]).reshape(3, -1))
    rays = (rotation.T @ rays).reshape(3, *gx.shape)
    origin = -rotation.T @ translation
    z = np.full(gx.shape, 0.01)
    for _ in range(60):
        distance = (z - origin[2]) / rays[2]
        x, y = (origin[i] + distance * rays[i] for i in (0, 1))
        target = cubic(world.mask.relief, *grid(x, y, half_width, half_height, world.mask))
        z = z + 0.6 * (target - z)
    distance = (z - origin[2]) / rays[2]
    x, y = (origin[i] + distance * rays[i] for i in (0, 1))
    rows, columns = texture.shape[:2]
    u = ((x + half_width) / (2 * half_width) * columns - 0.5).astype(np.float32)
    v = ((half_height - y) / (2 * half_height) * rows - 0.5).astype(np.float32)
    fine = cv2.remap(texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    picture = np.zeros((height, width, 3), np.uint8)
    picture[top:bottom, left:right] = cv2.resize(
        fine, (right - left, bottom - top), interpolation=cv2.INTER_AREA
    )
    return picture


def grid(
    x: Array, y: Array, half_width: float, half_height: float, mask: Mask
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    spacing = mask.settings.relief.spacing_m
    return (
        ((x + half_width) / spacing).astype(np.float32),
        ((half_height - y) / spacing).astype(np.float32),
    )


def cubic(
    relief: NDArray[np.float32], column: NDArray[np.float32], row: NDArray[np.float32]
) -> Array:
    return np.asarray(
        cv2.remap(relief, column, row, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), float
    )


@pytest.fixture(scope="module")
def mask() -> Mask:
    return load_mask(CONFIGS / "masks/reference")


@pytest.fixture(scope="module")
def dots() -> Dots:
    return load_dots(CONFIGS / "characters/dots")


@pytest.fixture(scope="module")
def texture() -> Picture:
    image = cv2.imread(str(CONFIGS / "characters/dots/texture.png"), cv2.IMREAD_COLOR)
    assert image is not None
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


@pytest.fixture(scope="module")
def front(mask: Mask, texture: Picture) -> Picture:
    return perfect_picture(world(mask), texture)


def offset(frame: FrameMeasurement) -> Array:
    return np.asarray(frame.displacements_mm.mean(axis=0))


@pytest.mark.parametrize(
    ("distance", "degrees"),
    [
        (1.2, {}),
        (1.8, {}),
        (2.4, {}),
        (1.2, {"pitch": -20, "yaw": 30}),
        (1.8, {"pitch": 20, "yaw": -30}),
        (2.4, {"pitch": 20, "yaw": 30, "roll": 90}),
        (1.8, {"pitch": -20, "yaw": -30, "roll": 200}),
    ],
)
def test_a_perfect_picture_has_no_error(
    mask: Mask, dots: Dots, texture: Picture, distance: float, degrees: dict[str, float]
) -> None:
    there = world(mask, distance, **degrees)
    frame = Judge(there, dots).examine(perfect_picture(there, texture), 0.0)
    assert len(frame.errors) >= 14
    assert max(error for _, error in frame.errors) <= 0.1


def test_a_mask_moved_aside_is_reported(mask: Mask, dots: Dots, front: Picture) -> None:
    still = world(mask)
    moved = replace(still, translation=shifted(still, 0.005, 0))
    frame = Judge(moved, dots).examine(front, 0.0)
    assert len(frame.errors) == 15
    assert offset(frame)[0] == pytest.approx(-5.0, abs=0.1)
    # A flank that leans along the line of light is hit further along it, so 5 mm can grow.
    assert frame.rms_mm == pytest.approx(5.0, abs=0.25)


def test_the_place_at_the_time_of_the_light_counts(mask: Mask, dots: Dots, front: Picture) -> None:
    moving = replace(world(mask), velocity=np.array([0.0, 0.5, 0.0]))
    late = [offset(Judge(moving, dots).examine(front, time_s))[1] for time_s in (0.0, 0.008, 0.02)]
    # The camera's y axis points down, the mask's up: what stays behind lands higher up.
    assert late == pytest.approx([0.0, 4.0, 10.0], abs=0.6)
    assert late[2] == pytest.approx(2.5 * late[1], rel=0.02)


def test_a_turn_is_reported_as_the_relief_demands(mask: Mask, dots: Dots, front: Picture) -> None:
    turned = Judge(world(mask, yaw=2), dots).examine(front, 0.0)
    away = dict(turned.errors)
    # Turning by 2 degrees about the mask's y axis moves a point sideways by its height times
    # sin 2 deg: 1.1 mm at the nose (z = 31 mm), 0.1 mm at the rim of the forehead (z = 0).
    assert away["nose"] == pytest.approx(1.1, abs=0.25)
    assert away["forehead_far_left"] < 0.45
    assert away["nose"] > 2 * away["forehead_far_left"]


def test_an_error_of_50_mm_is_not_confused(mask: Mask, dots: Dots, front: Picture) -> None:
    still = world(mask)
    far = replace(still, translation=shifted(still, 0.05, 0))
    frame = Judge(far, dots).examine(front, 0.0)
    assert len(frame.errors) >= 12
    assert offset(frame)[0] == pytest.approx(-50, abs=1.5)


def test_a_roll_error_of_20_degrees_is_not_confused(mask: Mask, dots: Dots, front: Picture) -> None:
    frame = Judge(world(mask, roll=20), dots).examine(front, 0.0)
    away = dict(frame.errors)
    chord = 2 * np.sin(np.radians(10))
    assert away["jaw_left"] == pytest.approx(np.hypot(71, 105) * chord, rel=0.04)
    assert away["forehead"] == pytest.approx(98 * chord, rel=0.04)


def test_a_fading_picture_is_measured_until_it_is_black(
    mask: Mask, dots: Dots, front: Picture
) -> None:
    judge = Judge(world(mask), dots)
    levels = []
    for brightness in (1.0, 0.5, 0.15, 0.0):
        dimmed = np.round(front * brightness).astype(np.uint8)
        frame = judge.examine(dimmed, 0.0)
        levels.append(frame.brightness)
        assert frame.lit == (brightness > 0)
        if brightness:
            assert len(frame.errors) == 15
            assert frame.rms_mm < 0.1
    assert levels == sorted(levels, reverse=True)
    assert levels[-1] == 0


def test_a_dot_cut_by_the_border_or_half_hidden_is_left_out(
    mask: Mask, dots: Dots, front: Picture
) -> None:
    still = world(mask)
    judge = Judge(still, dots)
    rotation, translation = still.projector_from_mask()
    x, y = dots.positions[dots.names.index("cheek_left")]
    image = still.projector.K @ (
        rotation @ np.array([x, y, float(mask.height(x, y))]) + translation
    )
    column, row = np.round(image[:2] / image[2]).astype(int)

    hidden = front.copy()
    hidden[row - 20 : row + 20, column - 20 : column] = 0
    frame = judge.examine(hidden, 0.0)
    assert "cheek_left" not in dict(frame.errors)
    assert (frame.rejected, len(frame.errors)) == (1, 14)

    border = column - 4  # so little is cut off that the area alone would not tell
    narrower = replace(still.projector, K=still.projector.K - [[0, 0, border], [0, 0, 0], [0] * 3])
    cut = Judge(replace(still, projector=narrower), dots).examine(front[:, border:].copy(), 0.0)
    assert "cheek_left" not in dict(cut.errors)
    assert len(cut.errors) >= 11
    assert cut.rms_mm < 0.1


def test_the_summary_is_over_all_dots_of_all_frames(mask: Mask, dots: Dots, front: Picture) -> None:
    still = world(mask)
    moved = replace(still, translation=shifted(still, 0, 0.004))
    frames = [
        Judge(still, dots).examine(front, 0.0),
        Judge(moved, dots).examine(front, 0.1),
        Judge(still, dots).examine(np.zeros_like(front), 0.2),
    ]
    summary = Judge.summary(frames)
    assert (summary.frames, summary.measured_frames, summary.black_frames) == (3, 2, 1)
    assert summary.dots == 30
    assert summary.rms == pytest.approx(4 / np.sqrt(2), abs=0.3)
    assert summary.median < summary.rms < summary.p95 <= summary.max
    assert [time for time, _ in summary.series] == [0.0, 0.1, 0.2]
    assert np.isnan(summary.series[2][1])


def test_measure_gives_names_and_millimetres(mask: Mask, dots: Dots, front: Picture) -> None:
    errors = Judge(world(mask), dots).measure(front, 0.0)
    assert {name for name, _ in errors} == set(dots.names)


def test_other_pictures_give_no_dots(mask: Mask, dots: Dots) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (720, 1280, 3), dtype=np.uint8)
    frame = Judge(world(mask), dots).examine(noise, 0.0)
    assert frame.lit
    assert frame.errors == ()
