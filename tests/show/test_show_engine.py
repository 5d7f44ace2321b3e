"""Key presses become cues; cues change the scene by fades that start from what is seen."""

from pathlib import Path

import numpy as np
import pytest

from hypermask.errors import ConfigError, UsageError
from hypermask.face.action_units import unit_weights
from hypermask.face.emotions import EMOTIONS, emotion_units
from hypermask.show.engine import ShowEngine
from hypermask.show.scene import (
    brightness_at,
    characters_at,
    describe,
    intensity,
    life_of,
    units_at,
)
from hypermask.show.showfile import load_show

DEFAULT = Path(__file__).parents[2] / "configs" / "shows" / "default.toml"


@pytest.fixture
def engine() -> ShowEngine:
    return ShowEngine(load_show(DEFAULT), time_s=0.0)


def units_of(emotion: str) -> np.ndarray:
    return emotion_units()[EMOTIONS.index(emotion)]


def show_with(tmp_path: Path, *lines: str) -> ShowEngine:
    path = tmp_path / "show.toml"
    path.write_text("\n".join(['version = 1\nname = "x"\ncharacters = ["mean"]', *lines]))
    return ShowEngine(load_show(path), time_s=0.0)


def test_starts_with_the_first_character_neutral_and_lit(engine: ShowEngine) -> None:
    assert characters_at(engine.scene, 0.0) == [("mean", 1.0)]
    assert not units_at(engine.scene, 0.0).any()
    assert brightness_at(engine.scene, 0.0) == 1.0


def test_a_key_fades_the_expression_over_the_files_time(engine: ShowEngine) -> None:
    assert engine.press("5", 1.0) is not None
    assert not units_at(engine.scene, 1.0).any()
    np.testing.assert_allclose(units_at(engine.scene, 1.175), units_of("happiness") / 2, atol=1e-6)
    np.testing.assert_allclose(units_at(engine.scene, 1.35), units_of("happiness"), atol=1e-6)


def test_a_cue_in_the_middle_of_a_fade_starts_from_what_is_seen(engine: ShowEngine) -> None:
    engine.press("5", 1.0)
    engine.press("6", 1.175)
    np.testing.assert_allclose(units_at(engine.scene, 1.175), units_of("happiness") / 2, atol=1e-6)
    np.testing.assert_allclose(units_at(engine.scene, 2.0), units_of("anger"), atol=1e-6)


def test_a_cue_names_action_units_alone_or_beside_an_emotion(tmp_path: Path) -> None:
    engine = show_with(
        tmp_path,
        '[cues.brow]\nunits = { 2L = 0.8, 4 = "B" }',
        "[cues.both]\nexpression = { happiness = 0.5 }\nunits = { 12R = 1.0 }",
    )
    engine.call("brow", 0.0)
    np.testing.assert_allclose(
        units_at(engine.scene, 1.0), unit_weights({"2L": 0.8, "4": 0.3}), atol=1e-6
    )
    engine.call("both", 1.0)
    expected = units_of("happiness") / 2 + unit_weights({"12R": 1.0})
    np.testing.assert_allclose(units_at(engine.scene, 9.0), np.minimum(expected, 1), atol=1e-6)


def test_a_cue_plays_an_expressions_file_in_its_own_time(engine: ShowEngine) -> None:
    engine.press("8", 0.0)
    engine.press("backspace", 2.0)  # the wink of configs/expressions
    shut, smile = unit_weights({"46L": 1.0}) > 0, unit_weights({"12L": 1.0}) > 0
    assert units_at(engine.scene, 2.06)[shut] == pytest.approx(0.5, abs=0.01)
    assert units_at(engine.scene, 2.2)[shut] == pytest.approx(1.0)
    assert units_at(engine.scene, 3.0)[shut] == 0
    assert units_at(engine.scene, 3.0)[smile] == pytest.approx(0.3)
    assert not units_at(engine.scene, 3.0)[unit_weights({"5": 1.0}) > 0].any(), "surprise is gone"
    assert describe(engine.scene, 3.0) == "mean, wink"


def test_the_short_emotions_are_a_setting_of_the_show(tmp_path: Path) -> None:
    engine = show_with(tmp_path, 'emotions = "short"', "[cues.a]\nexpression = { anger = 1.0 }")
    engine.call("a", 0.0)
    short = emotion_units("short")[EMOTIONS.index("anger")]
    np.testing.assert_allclose(units_at(engine.scene, 5.0), short, atol=1e-6)


def test_blinks_gaze_and_breath_are_switched_by_the_show_and_by_cues(tmp_path: Path) -> None:
    engine = show_with(tmp_path, "life = { gaze = false }", "[cues.on]\nlife = {breath = false}")
    life = life_of(engine.scene)
    assert (life.blinks, life.gaze, life.breath) == (True, False, True)
    engine.call("on", 0.0)
    life = life_of(engine.scene)
    assert (life.blinks, life.gaze, life.breath) == (True, True, False)


def test_a_guest_takes_its_turn_after_the_others_or_the_stage_at_once(engine: ShowEngine) -> None:
    assert engine.arrive("guest", False, 0.0)
    assert characters_at(engine.scene, 5.0) == [("mean", 1.0)]
    engine.press("slash", 5.0)
    assert characters_at(engine.scene, 6.0) == [("guest", 1.0)]
    assert engine.arrive("other", True, 7.0)
    assert dict(characters_at(engine.scene, 7.4)) == pytest.approx({"guest": 0.5, "other": 0.5})


def test_a_show_may_refuse_guests(tmp_path: Path) -> None:
    engine = show_with(tmp_path, "guests = false")
    assert not engine.arrive("guest", True, 0.0)
    assert characters_at(engine.scene, 5.0) == [("mean", 1.0)]


def test_characters_cross_fade_and_their_opacities_sum_to_one(engine: ShowEngine) -> None:
    engine.press("star", 0.0)
    assert dict(characters_at(engine.scene, 0.4)) == pytest.approx({"noh": 0.5, "mean": 0.5})
    assert characters_at(engine.scene, 0.8) == [("noh", 1.0)]


def test_a_cross_fade_that_interrupts_another_starts_from_what_is_seen(engine: ShowEngine) -> None:
    engine.press("star", 0.0)
    before = dict(characters_at(engine.scene, 0.4))
    engine.press("star", 0.4)
    assert dict(characters_at(engine.scene, 0.4)) == pytest.approx(before)
    middle = dict(characters_at(engine.scene, 0.8))
    assert middle == pytest.approx({"kabuki": 0.5, "mean": 0.25, "noh": 0.25})
    assert characters_at(engine.scene, 1.2) == [("kabuki", 1.0)]


def test_many_quick_character_keys_never_lose_light(engine: ShowEngine) -> None:
    for press in range(12):
        engine.press("star", 0.05 * press)
        opacities = [opacity for _, opacity in characters_at(engine.scene, 0.05 * press + 0.02)]
        assert sum(opacities) == pytest.approx(1.0)


def test_previous_of_the_first_character_is_the_last(engine: ShowEngine) -> None:
    engine.press("slash", 0.0)
    assert characters_at(engine.scene, 5.0) == [("clown", 1.0)]


def test_blackout_and_back_restores_the_brightness(engine: ShowEngine) -> None:
    engine.press("minus", 0.0)
    engine.press("enter", 1.0)
    assert brightness_at(engine.scene, 1.25) == 0.0
    engine.press("enter", 2.0)
    assert brightness_at(engine.scene, 3.0) == pytest.approx(0.9)


def test_brightness_changed_in_a_blackout_does_not_end_it(engine: ShowEngine) -> None:
    engine.press("enter", 0.0)
    engine.press("minus", 1.0)
    assert brightness_at(engine.scene, 2.0) == 0.0
    engine.press("enter", 2.0)
    assert brightness_at(engine.scene, 3.0) == pytest.approx(0.9)


def test_brightness_never_steps_down_to_black(engine: ShowEngine) -> None:
    for press in range(20):
        engine.press("minus", float(press))
    assert brightness_at(engine.scene, 30.0) == pytest.approx(0.1)


def test_a_key_without_a_cue_does_nothing(engine: ShowEngine) -> None:
    before = engine.scene.copy()
    assert engine.press("numlock", 1.0) is None
    assert engine.scene == before


def test_an_unknown_cue_is_named(engine: ShowEngine) -> None:
    with pytest.raises(UsageError, match=r"CUE-NAME.*'dance'"):
        engine.call("dance", 0.0)


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ('[keys]\nenterr = "x"', "SHOW-KEY"),
        ('[keys]\nenter = "x"', "SHOW-CUE"),
        ('[cues.x]\ncharacter = "bob"', "SHOW-CHARACTER"),
        ("[cues.x]\nexpresion = {}", "CFG-KEY"),
        ("[cues.x]\nexpression = { anger = 3 }", "CFG-VALUE"),
        ('[cues.x]\nexpression = "wonk"', "SHOW-EXPRESSION"),
        ("[cues.x]\nunits = { 99 = 1.0 }", "SHOW-EXPRESSION"),
        ("[cues.x]\nunits = { 12L = 7.0 }", "SHOW-EXPRESSION"),
    ],
)
def test_a_wrong_show_file_is_explained(tmp_path: Path, line: str, code: str) -> None:
    path = tmp_path / "show.toml"
    path.write_text(f'version = 1\nname = "x"\ncharacters = ["mean"]\n{line}\n')
    with pytest.raises(ConfigError) as caught:
        ShowEngine(load_show(path), 0.0)
    assert caught.value.code == code


def test_an_excited_voice_makes_more_of_an_expression_where_the_show_asks(tmp_path: Path) -> None:
    asked = show_with(tmp_path, "voice_intensity = 0.5").scene
    heard = [intensity(asked, arousal) for arousal in (0.0, 0.25, 1.0)]
    assert heard == pytest.approx([0.8, 1.0, 1.5])
    not_asked = show_with(tmp_path).scene
    assert {intensity(not_asked, arousal) for arousal in (0.0, 0.5, 1.0)} == {1.0}
