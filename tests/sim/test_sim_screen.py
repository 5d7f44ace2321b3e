"""A screen lit from behind through a fisheye lens, on a neck: light, judge and audience."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask_sim.dots import load_dots
from hypermask_sim.judge import Judge
from hypermask_sim.lens import FisheyeLens, PinholeLens
from hypermask_sim.operator import screen_look
from hypermask_sim.scenario import Scenario, load_scenario
from hypermask_sim.surface import Surface
from hypermask_sim.world import FACING, World

CONFIGS = Path(__file__).parents[2] / "configs"
K = np.array([[440.0, 0, 639.5], [0, 440.0, 399.5], [0, 0, 1]])
LENS = FisheyeLens(K, (0.03, -0.01, 0.002, 0.0), (0.002, -0.001))


def maskbot(*assignments: str) -> Scenario:
    return load_scenario(CONFIGS / "scenarios" / "maskbot.toml", list(assignments))


@pytest.fixture(scope="module")
def world() -> World:
    return World(maskbot())


def directions() -> np.ndarray:
    angles, turns = np.meshgrid(np.radians([0, 10, 30, 50, 70]), np.linspace(0, 6, 7))
    out = np.stack([np.cos(turns), np.sin(turns)], -1) * np.sin(angles)[..., None]
    return np.concatenate([out, np.cos(angles)[..., None]], -1).reshape(-1, 3)


def test_a_fisheye_without_decentring_is_that_of_opencv() -> None:
    lens = replace(LENS, decentring=(0.0, 0.0))
    points = directions() * 0.13
    theirs = cv2.fisheye.projectPoints(
        points.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), K, np.array(lens.k)
    )[0]
    assert np.abs(lens.image(points) - theirs.reshape(-1, 2)).max() < 1e-6


def test_a_pixels_ray_is_the_way_of_its_light() -> None:
    back = LENS.rays(LENS.image(directions() * 0.2))
    assert np.abs(np.linalg.norm(np.cross(back, directions()), axis=1)).max() < 1e-9


@pytest.mark.parametrize("lens", [replace(LENS, decentring=(0.0, 0.0)), PinholeLens(K)])
def test_density_is_pixels_in_a_solid_angle(lens: FisheyeLens | PinholeLens) -> None:
    way = np.array([0.5, 0.3, 0.8])
    unit = way / np.linalg.norm(way)
    first = np.cross(unit, [0, 1, 0])
    first /= np.linalg.norm(first)
    second, step = np.cross(unit, first), 1e-4
    a = lens.image(unit + step * first) - lens.image(unit - step * first)
    b = lens.image(unit + step * second) - lens.image(unit - step * second)
    counted = abs(a[0] * b[1] - a[1] * b[0]) / (2 * step) ** 2
    assert lens.density(way) == pytest.approx(counted, rel=1e-4)


def test_light_from_behind_meets_the_relief_from_inside(world: World) -> None:
    surface, rng = Surface(world.mask), np.random.default_rng(1)
    xy = rng.uniform(-1, 1, (200, 2)) * [0.08, 0.11]
    points = np.column_stack([xy, surface.height(xy[:, 0], xy[:, 1])])
    lens = np.array([0.0, 0.0, -0.12])
    met = surface.meet(lens, points - lens)
    assert np.abs(met[:, 2] - surface.height(met[:, 0], met[:, 1])).max() < 1e-6
    # Nothing of this screen stands between its own points and the lens.
    assert np.abs(met - points).max() < 1e-5


def test_the_lens_must_lie_behind_the_screen() -> None:
    with pytest.raises(Exception, match=r"0\.08 m behind"):
        maskbot("screen.lens_m=[0, 0, 0.12]")


def test_pan_turns_the_head_to_its_left_and_tilt_up() -> None:
    world = World(maskbot())
    nose = np.array([0.0, 0.0, 0.05])
    straight = world.camera_from_mask(0.0)
    world.neck = lambda time_s: (np.radians(30), np.radians(10))
    turned = world.camera_from_mask(0.0)
    (ax, ay, _), (bx, by, _) = (
        r @ nose + t - (r @ np.array([0.0, 0.0, -0.08]) + t) for r, t in (straight, turned)
    )
    assert bx > ax + 0.05  # its left is the audience's right
    assert by < ay - 0.015  # camera's y points down
    pivot = np.array(world.scenario.screen.pivot_m)
    places = [r @ pivot + t for r, t in (straight, turned)]
    assert np.abs(places[0] - places[1]).max() < 1e-12


def test_the_projector_turns_with_the_head() -> None:
    world = World(maskbot())
    assert world.mounted is not None
    rotation, translation = world.camera_from_mask(0.0)
    point = np.array([0.03, -0.05, 0.02])
    seen = world.projector.project((rotation @ point + translation)[None])[0]
    direct = world.projector.lens.image(world.mounted[0] @ point + world.mounted[1])
    assert seen == pytest.approx(direct, abs=1e-6)
    assert np.allclose(rotation, FACING)


def around_dots(world: World, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Which pixels lie within 7 mm or so of a dot."""
    assert world.mounted is not None
    dots = load_dots(CONFIGS / "characters" / "dots").positions
    points = np.column_stack([dots, world.mask.height(dots[:, 0], dots[:, 1])])
    spots = world.projector.lens.image(points @ world.mounted[0].T + world.mounted[1])
    squares = ((x[..., None] - spots[:, 0]) ** 2 + (y[..., None] - spots[:, 1]) ** 2).min(axis=-1)
    return np.asarray(squares < 14**2)


def strips(texture: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """remap of a long row, which must be cut, as it takes no side of 32767 or more."""
    parts = [
        cv2.remap(texture, u[:, i : i + 8192], v[:, i : i + 8192], cv2.INTER_LINEAR)
        for i in range(0, u.shape[1], 8192)
    ]
    return np.concatenate(parts, axis=1)[0]


def traced(world: World, shift_m: float = 0.0) -> np.ndarray:
    """What a perfect program would show: every pixel's ray traced on to the relief, the dots'
    texture read there, `shift_m` beside where it should be."""
    assert world.mounted is not None
    rotation, translation = world.mounted
    width, height = world.projector.size
    texture = cv2.imread(str(CONFIGS / "characters/dots/texture.png"))[..., ::-1]
    finer = 2
    x, y = np.meshgrid(
        (np.arange(width * finer) + 0.5) / finer - 0.5,
        (np.arange(height * finer) + 0.5) / finer - 0.5,
    )
    near = around_dots(world, x, y)  # the rest is dark
    rays = world.projector.lens.rays(np.column_stack([x[near], y[near]])) @ rotation
    origin = -rotation.T @ translation
    surface = Surface(world.mask)
    distance = (0.01 - origin[2]) / np.where(rays[:, 2] > 0.2, rays[:, 2], np.nan)
    for _ in range(25):  # fixed-point iteration, independent of `Surface.meet`
        hit = origin + distance[:, None] * rays
        gap = surface.height(np.nan_to_num(hit[:, 0]), np.nan_to_num(hit[:, 1])) - hit[:, 2]
        distance = distance + 0.6 * gap / rays[:, 2]
    half_width, half_height = world.mask.half_size_m
    u = (hit[:, 0] - shift_m + half_width) / (2 * half_width) * texture.shape[1] - 0.5
    v = (half_height - hit[:, 1]) / (2 * half_height) * texture.shape[0] - 0.5
    maps = (np.nan_to_num(a, nan=-10).astype(np.float32)[None] for a in (u, v))
    fine = np.zeros((*x.shape, 3), np.uint8)
    fine[near] = strips(texture, *maps)
    return cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA)


def test_the_judge_sees_a_perfect_picture_as_right_and_a_shifted_one_as_shifted() -> None:
    small = World(maskbot("projector.width=640", "projector.height=400", "projector.focal_px=220"))
    judge = Judge(small, load_dots(CONFIGS / "characters" / "dots"))
    right = judge.examine(traced(small), 0.0)
    assert len(right.errors) >= 14
    assert right.rms_mm < 0.06
    beside = judge.examine(traced(small, 0.002), 0.0)
    assert beside.displacements_mm[:, 0].mean() == pytest.approx(2.0, abs=0.1)


def test_the_operator_sees_the_screen_from_the_front(world: World) -> None:
    """Pixels run to the left there: the light of a pixel further right lies further left."""
    mark = np.array([[0.02, 0.03, float(world.mask.height(0.02, 0.03))]])
    look = screen_look(world, mark, 0.0)
    assert world.mounted is not None
    there = world.projector.lens.image(mark @ world.mounted[0].T + world.mounted[1])[0]
    assert np.asarray(look((float(there[0]), float(there[1])), 0)) == pytest.approx(
        [0, 0], abs=1e-6
    )
    right, down = np.asarray(look((float(there[0]) + 5, float(there[1]) + 3), 0))
    assert right == pytest.approx(5)  # the light is 5 px left of the mark
    assert down == pytest.approx(-3)
