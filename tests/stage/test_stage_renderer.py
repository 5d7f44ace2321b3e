"""What the projector shows, read from its pixels."""

from dataclasses import replace
from pathlib import Path

import cv2
import moderngl
import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.geometry import FACING, Pose, homogeneous_apply, rotation_from_attitude
from hypermask.mask import load_mask
from hypermask.stage.layers import Actor, MeshLayer, dots_actor, relief_mesh
from hypermask.stage.renderer import DrawItem, StageRenderer
from hypermask.stage.settings import StageSettings
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.projector import ProjectorMode
from hypermask_drivers.projector.offscreen import OffscreenProjector

SIZE = (1280, 720)
K = np.array([[1920, 0, 639.5], [0, 1920, 719.5], [0, 0, 1.0]])
PROJECTOR_FROM_CAMERA = Pose(np.eye(3), np.array([-0.15, 0.0, 0.0]))
MASK = load_mask(Path(__file__).parents[2] / "configs" / "masks" / "reference")
FLAT = replace(MASK, relief=np.zeros_like(MASK.relief))
HOLES = MASK.settings.eye_holes
ATTITUDES = [(0, 0, 0), (0, 0, 45), (0, 0, -45), (200, 20, 30), (90, -20, -30)]


def procam(roll=0.0, pitch=0.0, yaw=0.0, at=(0.15, -0.33, 1.8)):
    rotation = FACING @ rotation_from_attitude(*np.radians([roll, pitch, yaw]))
    return K @ PROJECTOR_FROM_CAMERA.compose(Pose(rotation, np.array(at))).matrix()


def plain(colour, mask=FLAT, height=0.0, alpha=255):
    """A sheet of one colour over the mask."""
    positions, triangles = relief_mesh(mask, 0.01)
    positions = positions + np.float32([0, 0, height])
    texture = np.full((64, 64, 4), (*colour, alpha), np.uint8)
    uv = np.full((len(positions), 2), 0.5, np.float32)
    return Actor((MeshLayer("sheet", triangles, uv, texture),)), (positions,)


class Theatre:
    """A projector with a renderer, and eyes."""

    def __init__(self, mask=FLAT, **settings):
        self.projector = OffscreenProjector(ProjectorMode(*SIZE, 60.0, 0.025), VirtualClock())
        self.projector.open()
        self.mask = mask
        self.renderer = self.another(**settings)

    def another(self, mask=None, **settings):
        self.renderer = StageRenderer(
            self.projector.context, SIZE, mask or self.mask, StageSettings(**settings)
        )
        return self.renderer

    def load(self, key, actor_and_positions):
        actor, positions = actor_and_positions
        self.renderer.load(key, actor)
        return DrawItem(key, positions, 1.0)

    def show(self, matrix, items, brightness=1.0):
        self.renderer.draw(self.projector.framebuffer, matrix, items, brightness)
        return self.projector.read_picture().astype(int)


@pytest.fixture(scope="module")
def projector_theatre():
    theatre = Theatre()
    yield theatre
    theatre.projector.close()


@pytest.fixture
def theatre(projector_theatre):
    projector_theatre.another()
    return projector_theatre


def at(picture, matrix, point):
    """The colour at a point of the mask (x, y, z), from the nearest pixel."""
    x, y = np.round(homogeneous_apply(matrix, point)).astype(int)
    return picture[y, x]


def dots_texture(mask, points, radius_m=0.003, width=1024):
    """White, smooth-edged dots on black at mask points (x, y)."""
    half_width, half_height = mask.half_size_m
    pixels_per_m = width / (2 * half_width)
    rows = round(2 * half_height * pixels_per_m)
    x = (np.arange(width) + 0.5) / width * 2 * half_width - half_width
    y = half_height - (np.arange(rows) + 0.5) / rows * 2 * half_height
    picture = np.zeros((rows, width))
    for point in points:
        distance = np.hypot(x[None, :] - point[0], y[:, None] - point[1])
        picture += np.clip((radius_m - distance) * pixels_per_m / 4 + 0.5, 0, 1)
    grey = np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)


def centroid(picture, near, reach=6):
    x, y = np.round(near).astype(int)
    patch = picture[y - reach : y + reach + 1, x - reach : x + reach + 1, 0].astype(float)
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return np.array(
        [x + (patch * columns).sum() / patch.sum(), y + (patch * rows).sum() / patch.sum()]
    )


DOTS = [(-0.06, 0.09), (0.06, 0.09), (0.0, 0.06), (-0.07, -0.03), (0.05, -0.04), (0.0, -0.1)]


@pytest.mark.parametrize("attitude", ATTITUDES)
@pytest.mark.parametrize(("mask", "tolerance_px"), [(FLAT, 0.05), (MASK, 0.25)])
def test_dots_land_where_the_projection_says(theatre, attitude, mask, tolerance_px):
    """On the relief a dot is bent, so that its centroid is not quite its centre."""
    theatre.another(mask=mask)
    item = theatre.load("dots", dots_actor(mask, dots_texture(mask, DOTS)))
    matrix = procam(*attitude)
    picture = theatre.show(matrix, [item])
    for x, y in DOTS:
        expected = homogeneous_apply(matrix, [x, y, float(mask.height(x, y))])
        found = centroid(picture, expected)
        assert np.abs(found - expected).max() < tolerance_px, (x, y)


def test_the_scale_and_sign_of_the_matrix_do_not_matter(theatre):
    item = theatre.load("dots", dots_actor(FLAT, dots_texture(FLAT, DOTS)))
    picture = theatre.show(procam(30, 5, 20), [item])
    assert np.array_equal(theatre.show(-0.01 * procam(30, 5, 20), [item]), picture)


@pytest.mark.parametrize("attitude", [(0, 0, 0), (40, 10, 20)])
def test_planar_and_procam_agree_on_a_flat_mask(theatre, attitude):
    item = theatre.load("dots", dots_actor(FLAT, dots_texture(FLAT, DOTS)))
    matrix = procam(*attitude)
    planar = matrix.copy()
    planar[:, 2] = 0
    assert np.abs(theatre.show(matrix, [item]) - theatre.show(planar, [item])).max() <= 1


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_no_light_falls_into_the_eyes(theatre, attitude):
    theatre.another(mask=MASK)
    item = theatre.load("white", plain((255, 255, 255), MASK))
    matrix = procam(*attitude)
    picture = theatre.show(matrix, [item])
    for hole in HOLES:
        centre = np.asarray(hole.centre_m)
        for angle in np.linspace(0, 2 * np.pi, 24):
            ray = np.array([np.cos(angle), np.sin(angle)])
            for radius, lit in (
                (0.0, False),
                (hole.radius_m, False),
                (hole.radius_m + 0.006, True),
            ):
                x, y = centre + radius * ray
                light = at(picture, matrix, [x, y, float(MASK.height(x, y))]).max()
                assert light > 200 if lit else light == 0, (radius, angle)


def test_the_eye_margin_is_a_setting(theatre):
    edge = [HOLES[0].centre_m[0] + HOLES[0].radius_m + 0.005, HOLES[0].centre_m[1], 0.0]
    matrix = procam()
    item = theatre.load("white", plain((255, 255, 255)))
    assert at(theatre.show(matrix, [item]), matrix, edge).max() > 200
    theatre.another(eye_hole_margin_m=0.006)
    item = theatre.load("white", plain((255, 255, 255)))
    assert at(theatre.show(matrix, [item]), matrix, edge).max() == 0


@pytest.mark.parametrize("attitude", [(0, 0, 0), (200, 20, 30)])
def test_the_light_ends_softly_at_the_outline(theatre, attitude):
    item = theatre.load("white", plain((255, 255, 255)))
    matrix = procam(*attitude)
    picture = theatre.show(matrix, [item])
    outline = MASK.settings.outline
    for angle in np.linspace(0, 2 * np.pi, 40):
        ray = np.array([np.cos(angle), np.sin(angle)])
        scaled = np.abs(ray / [outline.half_width_m, outline.half_height_m])
        border = ray / (scaled**outline.exponent).sum() ** (1 / outline.exponent)
        lights = [at(picture, matrix, [*(border * s), 0.0])[0] for s in (0.9, 0.98, 1.01)]
        assert lights[0] == 255 and 10 < lights[1] < 250 and lights[2] <= 4, angle
    total = MASK.inside(*np.meshgrid(np.linspace(-0.1, 0.1, 201), np.linspace(-0.14, 0.14, 281)))
    assert (picture[..., 0] > 4).sum() > 0.5 * total.sum()


def test_a_cross_fade_is_the_mean_of_both_and_shows_nothing_behind(theatre):
    red = theatre.load("red", plain((255, 0, 0)))
    blue = theatre.load("blue", plain((0, 0, 255), height=0.01))
    matrix, middle = procam(), [0.0, -0.05, 0.0]
    for weight in (0.0, 0.25, 0.5, 1.0):
        red.opacity, blue.opacity = 1 - weight, weight
        for order in ([red, blue], [blue, red]):
            colour = at(theatre.show(matrix, order), matrix, middle)
            expected = [255 * (1 - weight), 0, 255 * weight]
            np.testing.assert_allclose(colour, expected, atol=1.5)


def test_a_cross_fade_between_equals_changes_nothing(theatre):
    white = theatre.load("a", plain((200, 180, 90)))
    again = theatre.load("b", plain((200, 180, 90)))
    alone = theatre.show(procam(), [white])
    white.opacity, again.opacity = 0.3, 0.7
    both = theatre.show(procam(), [white, again])
    assert np.abs(alone - both).max() <= 2


def test_weights_above_one_are_scaled_down(theatre):
    red = theatre.load("red", plain((200, 0, 0)))
    blue = theatre.load("blue", plain((0, 0, 200)))
    colour = at(theatre.show(procam(), [red, blue]), procam(), [0, -0.05, 0])
    np.testing.assert_allclose(colour, [100, 0, 100], atol=1.5)


@pytest.mark.parametrize("brightness", [1.0, 0.5, 0.1])
def test_brightness_scales_every_pixel(theatre, brightness):
    item = theatre.load("sheet", plain((240, 120, 60)))
    colour = at(theatre.show(procam(), [item], brightness), procam(), [0, -0.05, 0])
    np.testing.assert_allclose(colour, brightness * np.array([240, 120, 60]), atol=1)


def test_black_when_faded_or_with_nobody_on_stage(theatre):
    item = theatre.load("white", plain((255, 255, 255)))
    assert theatre.show(procam(), [item]).max() == 255
    assert theatre.show(procam(), [item], brightness=0.0).max() == 0
    assert theatre.show(procam(), []).max() == 0
    item.opacity = 0.0
    assert theatre.show(procam(), [item]).max() == 0


def test_a_mask_behind_the_projector_is_not_drawn(theatre):
    item = theatre.load("white", plain((255, 255, 255)))
    assert theatre.show(procam(at=(0.15, 0, -1.0)), [item]).max() > 0  # the sign is free
    assert theatre.show(procam(yaw=85, at=(0.15, 0, 0.05)), [item]).max() == 0


def test_the_brightness_limit_holds_for_the_peak(theatre):
    theatre.another(brightness_limit=0.25)
    item = theatre.load("white", plain((255, 255, 255)))
    picture = theatre.show(procam(), [item])
    assert (picture.max() / 255) ** 2.2 == pytest.approx(0.25, abs=0.005)


def test_the_mean_limit_dims_bright_characters_only(theatre):
    theatre.another(mean_light_limit=0.3)
    bright = theatre.load("bright", plain((255, 255, 255)))
    dark = theatre.load("dark", plain((90, 90, 90)))
    light = at(theatre.show(procam(), [bright]), procam(), [0, -0.05, 0])[0]
    assert (light / 255) ** 2.2 == pytest.approx(0.3, abs=0.005)
    assert at(theatre.show(procam(), [dark]), procam(), [0, -0.05, 0])[0] == 90


def test_another_gamma_of_the_projector_gives_the_same_light(theatre):
    theatre.another(projector_gamma=1.8)
    item = theatre.load("grey", plain((100, 150, 200)))
    colour = at(theatre.show(procam(), [item]), procam(), [0, -0.05, 0])
    light = (colour / 255) ** 1.8
    np.testing.assert_allclose(light, (np.array([100, 150, 200]) / 255) ** 2.2, atol=0.004)


def two_sheets(front_first):
    """A small green sheet 30 mm before a red one."""
    red, (far,) = plain((255, 0, 0))
    green = MeshLayer(
        "green",
        np.int32([[0, 1, 2], [0, 2, 3]]),
        np.full((4, 2), 0.5, np.float32),
        np.full((8, 8, 4), (0, 255, 0, 255), np.uint8),
    )
    near = np.float32([[-0.02, -0.02, 0.03], [0.02, -0.02, 0.03], [0.02, 0.02, 0.03]])
    near = np.vstack([near, np.float32([[-0.02, 0.02, 0.03]])])
    if front_first:
        return Actor((green, *red.layers)), (near, far)
    return Actor((*red.layers, green)), (far, near)


@pytest.mark.parametrize("attitude", ATTITUDES)
@pytest.mark.parametrize("front_first", [True, False])
def test_the_nearer_layer_hides_the_other(theatre, attitude, front_first):
    item = theatre.load("two", two_sheets(front_first))
    matrix = procam(*attitude)
    np.testing.assert_array_equal(
        at(theatre.show(matrix, [item]), matrix, [0, 0, 0.03]), [0, 255, 0]
    )


def test_depth_counts_with_a_planar_map_too(theatre):
    item = theatre.load("two", two_sheets(front_first=True))
    planar = procam()
    planar[:, 2] = 0
    np.testing.assert_array_equal(at(theatre.show(planar, [item]), planar, [0, 0, 0]), [0, 255, 0])


def test_see_through_layers_mix_and_holes_show_what_is_behind(theatre):
    back, (far,) = plain((0, 0, 200))
    front, (near,) = plain((200, 0, 0), height=0.01, alpha=128)
    hole, (nearest,) = plain((255, 255, 255), height=0.02, alpha=0)
    actor = Actor((*hole.layers, *back.layers, *front.layers))
    item = theatre.load("glass", (actor, (nearest, far, near)))
    colour = at(theatre.show(procam(), [item]), procam(), [0, -0.05, 0.01])
    np.testing.assert_allclose(colour, [100, 0, 100], atol=2)


def test_shaded_layers_are_modelled_by_light_and_others_are_not(theatre):
    """A roof with its ridge along y: the audience's right side is lit from the right."""
    ridge = np.float32([[-0.05, 0, 0], [0, 0, 0.05], [0.05, 0, 0]])
    roof = np.concatenate([ridge - np.float32([0, 0.05, 0]), ridge + np.float32([0, 0.05, 0])])
    sides = np.int32([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    texture = np.full((8, 8, 4), 255, np.uint8)
    uv = np.full((6, 2), 0.5, np.float32)
    for shaded in (True, False):
        for winding in (sides, sides[:, ::-1]):
            layer = MeshLayer("roof", np.ascontiguousarray(winding), uv, texture, shaded)
            item = theatre.load("roof", (Actor((layer,)), (roof,)))
            picture = theatre.show(procam(), [item])
            left = at(picture, procam(), [-0.04, -0.03, 0.01])[0]
            right = at(picture, procam(), [0.04, -0.03, 0.01])[0]
            assert (right > left + 20 and left > 50) if shaded else left == right == 255


@pytest.mark.parametrize("what", ["matrix", "vertices", "brightness", "opacity"])
def test_numbers_that_are_not_finite_give_black_and_one_error(theatre, what):
    item = theatre.load("white", plain((255, 255, 255)))
    matrix, brightness = procam(), 1.0
    broken = DrawItem("white", tuple(part.copy() for part in item.positions), 1.0)
    if what == "matrix":
        matrix[0, 0] = np.nan
    elif what == "vertices":
        broken.positions[0][5, 2] = np.inf
    elif what == "brightness":
        brightness = float("nan")
    else:
        broken.opacity = float("nan")
    theatre.show(procam(), [item])
    with pytest.raises(DataError, match="STAGE-NAN"):
        theatre.show(matrix, [broken], brightness)
    assert theatre.projector.read_picture().max() == 0
    assert theatre.show(matrix, [broken], brightness).max() == 0  # said once is enough
    assert theatre.show(procam(), [item]).max() == 255
    with pytest.raises(DataError, match="STAGE-NAN"):
        theatre.show(matrix, [broken], brightness)


def test_unknown_actors_and_wrong_meshes_are_refused(theatre):
    item = theatre.load("white", plain((255, 255, 255)))
    theatre.show(procam(), [item])
    with pytest.raises(DataError, match="STAGE-KEY"):
        theatre.show(procam(), [DrawItem("nobody", item.positions)])
    assert theatre.projector.read_picture().max() == 0  # never a frozen face
    with pytest.raises(DataError, match="STAGE-MESH"):
        theatre.show(procam(), [DrawItem("white", (item.positions[0][:-1],))])
    theatre.renderer.unload("white")
    assert theatre.renderer.loaded == ()
    with pytest.raises(DataError, match="STAGE-KEY"):
        theatre.show(procam(), [item])


def test_a_layer_that_cannot_be_drawn_is_refused_when_it_is_made():
    uv, texture = np.zeros((3, 2), np.float32), np.zeros((4, 4, 4), np.uint8)
    with pytest.raises(DataError, match="STAGE-MESH"):
        MeshLayer("beyond", np.int32([[0, 1, 3]]), uv, texture)
    with pytest.raises(DataError, match="STAGE-MESH"):
        MeshLayer("grey", np.int32([[0, 1, 2]]), uv, texture[..., :3])


def test_loading_an_actor_again_replaces_it(theatre):
    theatre.load("one", plain((255, 0, 0)))
    item = theatre.load("one", plain((0, 255, 0)))
    np.testing.assert_array_equal(
        at(theatre.show(procam(), [item]), procam(), [0, -0.05, 0]), [0, 255, 0]
    )


def test_what_others_left_set_in_the_context_does_not_matter(theatre):
    item = theatre.load("two", two_sheets(front_first=True))
    expected = theatre.show(procam(), [item])
    context, framebuffer = theatre.projector.context, theatre.projector.framebuffer
    framebuffer.scissor = (10, 10, 5, 5)
    framebuffer.viewport = (0, 0, 64, 64)
    framebuffer.depth_mask = False
    framebuffer.color_mask = False, True, True, True
    context.enable_only(moderngl.CULL_FACE)
    context.depth_func = ">"
    context.blend_func = moderngl.DST_COLOR, moderngl.ZERO
    context.blend_equation = moderngl.FUNC_SUBTRACT
    assert np.array_equal(theatre.show(procam(), [item]), expected)


def test_the_same_draw_gives_the_same_pixels(theatre):
    item = theatre.load("dots", dots_actor(MASK, dots_texture(MASK, DOTS)))
    first = theatre.show(procam(20, 5, 10), [item])
    theatre.show(procam(50, -5, -10), [item])
    assert np.array_equal(theatre.show(procam(20, 5, 10), [item]), first)


def test_the_texture_is_the_right_way_up(theatre):
    """Row 0 of the texture is the top of the mask, column 0 the audience's left."""
    texture = np.zeros((300, 200, 3), np.uint8)
    cv2.rectangle(texture, (0, 0), (99, 149), (255, 0, 0), -1)
    item = theatre.load("quarter", dots_actor(FLAT, texture))
    picture = theatre.show(procam(), [item])
    assert at(picture, procam(), [-0.05, 0.07, 0])[0] == 255
    for x, y in ((0.05, 0.07), (-0.05, -0.07), (0.05, -0.07)):
        assert at(picture, procam(), [x, y, 0])[0] == 0
