"""What is drawn on a fixed screen, judged from the projector's pixels on the simulated truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from hypermask.calibration.fixed import Fixed
from hypermask.errors import DataError
from hypermask.geometry import Fisheye
from hypermask.rehearsal.cart import nominal_screen, true_screen
from hypermask.stage.layers import Actor, MeshLayer, dots_actor, relief_mesh
from hypermask.stage.renderer import DrawItem
from hypermask.stage.screen import ScreenMapping, ScreenRenderer
from hypermask.stage.settings import StageSettings
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.projector import ProjectorMode
from hypermask_drivers.projector.offscreen import OffscreenProjector
from hypermask_sim.dots import load_dots
from hypermask_sim.judge import Judge
from hypermask_sim.scenario import load_scenario
from hypermask_sim.world import World

CONFIGS = Path(__file__).parents[2] / "configs"
SIZE = (1280, 800)
WORLD = World(load_scenario(CONFIGS / "scenarios" / "maskbot.toml"))
EXACT = true_screen(WORLD)
MATRIX = ScreenMapping(WORLD.mask).at(0.0)
Picture = NDArray[np.uint8]


@dataclass
class Head:
    """A projector with the dots and a white sheet over the whole screen."""

    projector: OffscreenProjector
    renderer: ScreenRenderer
    items: dict[str, DrawItem]

    def shown(self, name: str = "dots", brightness: float = 1.0) -> Picture:
        framebuffer = self.projector.framebuffer
        self.renderer.draw(framebuffer, MATRIX, [self.items[name]], brightness)
        self.projector.present()
        return self.projector.read_picture()

    def draw(self, items: list[DrawItem]) -> Picture:
        self.renderer.draw(self.projector.framebuffer, MATRIX, items)
        self.projector.present()
        return self.projector.read_picture()


def head(context: moderngl.Context, settings: StageSettings) -> tuple[ScreenRenderer, dict]:
    renderer = ScreenRenderer(context, SIZE, WORLD.mask, EXACT, settings)
    texture = cv2.imread(str(CONFIGS / "characters/dots/texture.png"))[..., ::-1]
    dots, places = dots_actor(WORLD.mask, np.ascontiguousarray(texture))
    renderer.load("dots", dots)
    positions, triangles = relief_mesh(WORLD.mask, 0.004)
    white = np.full((8, 8, 4), 255, np.uint8)
    uv = np.full((len(positions), 2), 0.5, np.float32)
    renderer.load("white", Actor((MeshLayer("sheet", triangles, uv, white),)))
    items = {"dots": DrawItem("dots", places), "white": DrawItem("white", (positions,))}
    return renderer, items


@pytest.fixture(scope="module")
def projector() -> Iterator[OffscreenProjector]:
    projector = OffscreenProjector(ProjectorMode(*SIZE, 60.0, 0.0), VirtualClock())
    projector.open()
    yield projector
    projector.close()


@pytest.fixture
def stage(projector: OffscreenProjector) -> Iterator[Head]:
    renderer, items = head(projector.context, StageSettings(even_light=0.0))
    yield Head(projector, renderer, items)
    renderer.release()


JUDGE = Judge(WORLD, load_dots(CONFIGS / "characters" / "dots"))


def test_through_the_exact_map_every_dot_is_on_its_place(stage: Head) -> None:
    judged = JUDGE.examine(stage.shown(), 0.0)
    assert len(judged.errors) == 15
    assert max(error for _, error in judged.errors) <= 0.15
    assert judged.rms_mm <= 0.06


def test_another_calibration_holds_from_the_next_frame_on(stage: Head) -> None:
    assert stage.renderer.bend(nominal_screen(WORLD))
    assert JUDGE.examine(stage.shown(), 0.0).rms_mm > 2.0
    assert stage.renderer.bend(EXACT)
    assert JUDGE.examine(stage.shown(), 0.0).rms_mm <= 0.06


def test_one_for_pictures_of_another_size_is_refused(stage: Head) -> None:
    lens = replace(EXACT.lens, size=(640, 400))
    assert not stage.renderer.bend(replace(EXACT, lens=lens))
    assert JUDGE.examine(stage.shown(), 0.0).rms_mm <= 0.06
    with pytest.raises(DataError) as caught:
        ScreenRenderer(stage.projector.context, (640, 400), WORLD.mask, EXACT)
    assert caught.value.code == "CAL-CART"


def test_numbers_that_are_not_finite_change_nothing(stage: Head) -> None:
    broken = Fixed(
        Fisheye(EXACT.lens.matrix * np.nan, EXACT.lens.k, SIZE), EXACT.projector_from_mask
    )
    assert not stage.renderer.bend(broken)
    assert JUDGE.examine(stage.shown(), 0.0).rms_mm <= 0.06


def test_the_picture_is_mirrored_for_the_screen_is_lit_from_behind(stage: Head) -> None:
    """temple_left is yellow and on the audience's left: in the picture it lies right."""
    picture = stage.shown().astype(int)
    yellow = (picture[..., 0] > 150) & (picture[..., 1] > 150) & (picture[..., 2] < 60)
    rows, columns = np.nonzero(yellow)
    upper = columns[rows < rows.mean()]
    assert upper.mean() > SIZE[0] / 2


def test_beside_the_screen_it_is_dark_and_so_is_a_blackout(stage: Head) -> None:
    with stage.projector.context:
        stage.projector.framebuffer.clear(1.0, 0.0, 0.0, 1.0)  # such as a cross-hair of before
    picture = stage.shown("white")
    assert picture[:5].max() == 0
    assert picture[:, :250].max() == 0
    assert picture[400, 640].min() == 255
    assert stage.shown("white", 0.0).max() == 0
    stage.shown("white")
    assert stage.draw([]).max() == 0  # nothing of the frame before is left
    stage.renderer.draw_black(stage.projector.framebuffer)
    stage.projector.present()
    assert stage.projector.read_picture().max() == 0


def test_a_cross_fade_is_the_sum_of_both(stage: Head) -> None:
    full = stage.shown("white").astype(int)
    half = DrawItem("white", stage.items["white"].positions, 0.5)
    mixed = stage.draw([half]).astype(int)
    assert abs(mixed[400, 640, 0] - full[400, 640, 0] / 2) <= 2


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_light_can_be_evened_over_the_screen(projector: OffscreenProjector, share: float) -> None:
    """In the middle the screen gets the most light a pixel: there the picture is dimmed."""
    renderer, items = head(projector.context, StageSettings(even_light=share))
    picture = Head(projector, renderer, items).shown("white").astype(float)
    renderer.release()
    points = np.array([[0.0, 0.0], [0.0, 0.11]])
    places = np.column_stack([points, WORLD.mask.height(points[:, 0], points[:, 1])])
    middle, rim = (float(picture[round(y), round(x), 1]) / 255 for x, y in EXACT.project(places))
    assert rim > 0.95
    assert (middle**2.2 < 0.75) == (share == 1.0)
    # Light on the screen: what a pixel gives, times pixels a square metre.
    normals = np.array([[0.0, 0, 1], [0.0, 0, 1]])
    density = EXACT.density(places, normals)
    gained = density[0] * middle**2.2 / (density[1] * rim**2.2)
    assert (gained < 1.25) == (share == 1.0)


def test_what_lies_behind_the_skin_stays_behind_it(stage: Head) -> None:
    """Eyeballs lie nearer to the lens than the lids, but the audience looks from the front."""
    positions, triangles = relief_mesh(WORLD.mask, 0.01)
    uv = np.full((len(positions), 2), 0.5, np.float32)
    layers = []
    for name, colour in (("skin", (255, 0, 0, 255)), ("eye", (0, 255, 0, 255))):
        layers.append(MeshLayer(name, triangles, uv, np.full((4, 4, 4), colour, np.uint8)))
    stage.renderer.load("face", Actor(tuple(layers)))
    behind = (positions - np.float32([0, 0, 0.004])).astype(np.float32)
    picture = stage.draw([DrawItem("face", (positions, behind))])
    assert picture[400, 640].tolist() == [255, 0, 0]
