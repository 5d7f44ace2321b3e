"""A costume made by one process is worn by an actor of another, a slice at a time."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hypermask.errors import DataError
from hypermask.stage.costume import levels_of, make_costume, read_costume, write_costume
from hypermask.stage.textures import SLICE_BYTES, TextureStock

sys.path.insert(0, str(Path(__file__).parent))
from test_stage_renderer import Theatre, at, plain, procam

from hypermask.stage.layers import Actor
from hypermask.stage.renderer import DrawItem

RED, BLUE = (200, 40, 0), (0, 40, 200)


@pytest.fixture
def theatre():
    theatre = Theatre()
    yield theatre
    theatre.projector.close()


def wear(theatre, key, like, costume):
    return sum(1 for _ in theatre.renderer.dress(key, like, costume))


def test_a_dressed_actor_looks_as_if_it_had_been_loaded(theatre):
    theatre.load("red", plain(RED))
    actor, positions = plain(BLUE)
    loaded = theatre.load("blue", (actor, positions))
    wear(theatre, "dressed", "red", make_costume(actor.layers, 2.2))
    dressed = replace(loaded, key="dressed")
    np.testing.assert_array_equal(
        theatre.show(procam(), [dressed]), theatre.show(procam(), [loaded])
    )


def test_frames_between_the_steps_show_who_was_there_before(theatre):
    red = theatre.load("guest", plain(RED))
    theatre.load("model", plain(RED))
    before = theatre.show(procam(), [red])
    for _ in theatre.renderer.dress("guest", "model", make_costume(plain(BLUE)[0].layers, 2.2)):
        np.testing.assert_array_equal(theatre.show(procam(), [red]), before)
    assert at(theatre.show(procam(), [red]), procam(), (0, 0, 0))[2] > 150


def test_what_a_costume_lacks_is_lent_by_the_model(theatre):
    red, positions = plain(RED)
    two = replace(red, layers=(red.layers[0], replace(red.layers[0], name="other")))
    item = theatre.load("model", (two, (positions[0] - np.float32([0, 0, 0.02]), positions[0])))
    blue = make_costume(plain(BLUE)[0].layers, 2.2)
    assert list(blue.textures) == [0]
    wear(theatre, "guest", "model", blue)  # its first layer lies behind the second
    assert at(theatre.show(procam(), [replace(item, key="guest")]), procam(), (0, 0, 0))[0] > 150


@pytest.mark.parametrize("alpha", [255, 120])
def test_a_cross_fade_of_a_dressed_pair_looks_like_any_other(theatre, alpha):
    noise = np.random.default_rng(3).integers(0, 256, (64, 64, 4), np.uint8)
    noise[..., 3] = alpha
    red, positions = plain(RED)
    blue = plain(BLUE)[0].layers[0]
    uv = np.random.default_rng(4).random(blue.uv.shape).astype(np.float32)
    one = Actor((replace(red.layers[0], uv=uv),))
    two = Actor((replace(blue, uv=uv, texture=noise),))
    theatre.load("one", (one, positions))
    theatre.load("two", (two, positions))
    wear(theatre, "mixed", "one", make_costume(two.layers, 2.2))
    matrix = procam(10, 5, 20)
    separate, together = (
        theatre.show(matrix, [DrawItem("one", positions, 0.3), DrawItem(key, positions, 0.7)], 0.8)
        for key in ("two", "mixed")
    )
    assert np.abs(separate - together).max() <= 2  # they are rounded at other moments


def test_no_step_copies_more_than_a_slice():
    theatre = Theatre()
    theatre.load("model", plain(RED))
    actor = plain(BLUE)[0]
    fine = replace(actor.layers[0], texture=np.full((1024, 1024, 4), 255, np.uint8))
    steps = wear(theatre, "guest", "model", make_costume([fine], 2.2))
    assert steps >= 1024 * 1024 * 4 / SLICE_BYTES
    theatre.projector.close()


def test_a_photographs_costume_is_on_the_stage_after_some_thirty_steps():
    theatre = Theatre()
    theatre.load("model", plain(RED))
    fine = replace(plain(BLUE)[0].layers[0], texture=np.full((512, 512, 4), 255, np.uint8))
    assert wear(theatre, "guest", "model", make_costume([fine], 2.2)) < 30
    theatre.projector.close()


def test_leaving_and_coming_again_makes_no_new_textures(theatre, monkeypatch):
    theatre.load("model", plain(RED))
    costume = make_costume(plain(BLUE)[0].layers, 2.2)
    theatre.renderer.reserve([(64, 64)])
    monkeypatch.setattr(TextureStock, "_make", lambda *_: pytest.fail("made in a frame's time"))
    for _ in range(3):
        wear(theatre, "guest", "model", costume)
        theatre.renderer.unload("guest")


def test_smaller_levels_are_means_of_the_larger():
    texture = np.random.default_rng(1).integers(0, 256, (112, 320, 4), np.uint8)
    levels = levels_of(texture, 2.2)
    assert [level.shape[:2] for level in levels][:3] == [(112, 320), (56, 160), (28, 80)]
    assert levels[-1].shape[:2] == (1, 1)
    assert levels[0][..., :3].max() <= levels[0][..., 3].max(), "premultiplied"
    np.testing.assert_allclose(levels[-1].mean(), levels[0].mean(), atol=3)


def test_a_costume_survives_its_file(tmp_path):
    texture = np.random.default_rng(2).integers(0, 256, (64, 32, 4), np.uint8)
    costume = make_costume([replace(plain(RED)[0].layers[0], texture=texture)], 1.8)
    write_costume(costume, tmp_path / "c")
    again = read_costume(tmp_path / "c")
    assert (again.mean_light, again.see_through) == (costume.mean_light, costume.see_through)
    for one, other in zip(again.textures[0], costume.textures[0], strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("keep", [0, 3, 40, 200, 5000])
def test_a_costume_that_is_cut_short_is_refused(tmp_path, keep):
    write_costume(make_costume(plain(RED)[0].layers, 2.2), tmp_path / "c")
    (tmp_path / "c").write_bytes((tmp_path / "c").read_bytes()[:keep])
    with pytest.raises(DataError, match="COSTUME-READ"):
        read_costume(tmp_path / "c")
