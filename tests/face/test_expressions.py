"""A user's expressions as files, and other tools' names (ARKit, MPEG-4) for the same face."""

from pathlib import Path

import numpy as np
import pytest

from hypermask import paths
from hypermask.errors import ConfigError, DataError, HypermaskError, UsageError
from hypermask.face.action_units import COUNT, NUMBERS, unit_weights
from hypermask.face.arkit import BLENDSHAPES, from_arkit
from hypermask.face.expressions import (
    Expression,
    find_expression,
    known_expressions,
    load_expression,
    save_expression,
)
from hypermask.face.face import deform, load_rig
from hypermask.face.features import FEATURE_POINTS
from hypermask.face.mouth import CONTROL_POINTS, MOUTH_PARAMETERS
from hypermask.face.mpeg4 import FAPS, FAPU_MM, from_mpeg4

RIG = load_rig()
REST = RIG.mesh.rest * 1000
SHIPPED = sorted((paths.configs() / "expressions").glob("*.toml"))


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path / "home"))


def _file(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, "utf-8")
    return path


def _moved(drive) -> np.ndarray:
    """(V, 3) mm: to the audience's right, up, forward."""
    flat, out = deform(RIG, None, drive.mouth, 0.0, drive.units)
    return np.column_stack([flat * 1000 - REST, out * 1000])


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_the_shipped_expressions_load_under_their_own_names(path: Path) -> None:
    expression = load_expression(path)
    assert expression.name == path.stem and expression.text
    assert expression.units.max() > 0.3 and (expression.at(0.0) == 0).all()


def test_there_are_shipped_expressions() -> None:
    assert len(SHIPPED) >= 5 and {path.stem for path in SHIPPED} <= set(known_expressions())


def test_units_ease_in_and_stay(tmp_path: Path) -> None:
    text = 'version = 1\nname = "mine"\nrise_s = 0.5\n[units]\n12L = 0.8\n1 = "C"\n'
    expression = load_expression(_file(tmp_path, text))
    expected = unit_weights({"12L": 0.8, "1": 0.5})
    np.testing.assert_allclose(expression.at(0.25), expected / 2)
    np.testing.assert_array_equal(expression.at(0.5), expected)
    np.testing.assert_array_equal(expression.at(1e6), expression.peak)
    assert (expression.at(-1.0) == 0).all()


def test_frames_follow_each_other_without_a_jump() -> None:
    kiss = load_expression(find_expression("kiss"))
    path = np.array([kiss.at(t) for t in np.arange(0, 2.5, 1 / 60)])
    assert np.abs(np.diff(path, axis=0)).max() < 0.15
    np.testing.assert_allclose(kiss.at(kiss.times[1]), kiss.units[1])


def test_what_is_saved_is_loaded_again(tmp_path: Path) -> None:
    units = np.zeros((2, COUNT))
    units[0, 5], units[1, 7] = 0.25, 0.75
    mine = Expression("mine", 'says "ah"', np.array([0.1, 0.9]), units)
    path = save_expression(mine, paths.home() / "expressions")
    again = load_expression(find_expression("mine"))
    assert path == find_expression("mine") and "mine" in known_expressions()
    assert (again.name, again.text) == (mine.name, mine.text)
    np.testing.assert_allclose(again.units, mine.units)
    np.testing.assert_allclose(again.times, mine.times)
    with pytest.raises(ConfigError, match="EXPR-READ"):
        save_expression(Expression("../x", "", mine.times, units), tmp_path)


def test_the_users_expression_comes_before_the_built_in_one() -> None:
    mine = Expression("wink", "my own", np.array([0.2]), np.ones((1, COUNT)) / 2)
    save_expression(mine, paths.home() / "expressions")
    assert load_expression(find_expression("wink")).text == "my own"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('version = 1\nname = "x"\n[units]\n3 = 1.0\n', "action unit '3'"),
        ('version = 1\nname = "x"\n[units]\n12 = 1.5\n', "1.5"),
        ('version = 1\nname = "x"\n[units]\n12 = "Z"\n', "'Z'"),
        ('version = 2\nname = "x"\n[units]\n12 = 1\n', "version is 2"),
        ('version = 1\nname = "a/b"\n[units]\n12 = 1\n', "a/b"),
        ('version = 1\nname = "x"\n', "units or frames"),
        ('version = 1\nname = "x"\n[units]\n[[frames]]\ntime_s=1\nunits={}\n', "units or frames"),
        ('version = 1\nname = "x"\n' + 2 * "[[frames]]\ntime_s=1\nunits={}\n", "do not rise"),
        ('version = 1\nname = "x"\n[unit]\n12 = 1\n', "unit"),
        ('name = "x"\n[units]\n12 = 1\n', "version"),
        ("version = [", "TOML"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_explained(tmp_path: Path, text: str, words: str) -> None:
    path = _file(tmp_path, text)
    with pytest.raises(HypermaskError) as caught:
        load_expression(path)
    assert words in str(caught.value) and "mine.toml" in str(caught.value)
    assert caught.value.remedy


def test_an_unknown_expression_names_the_known_ones() -> None:
    for name in ("nonesuch", "../expressions/wink", ""):
        with pytest.raises(DataError, match=r"EXPR-ABSENT.*wink"):
            find_expression(name)


def test_all_52_blendshapes_move_the_face() -> None:
    assert len(BLENDSHAPES) == 52
    for name in BLENDSHAPES:
        drive = from_arkit({name: 1.0})
        moved = np.hypot(*_moved(drive)[:, :2].T).max() + np.abs(drive.gaze).max()
        assert moved > 0.2, name


def test_blendshapes_mean_what_arkit_means() -> None:
    left, right = CONTROL_POINTS["corner_right"], CONTROL_POINTS["corner_left"]
    smile = _moved(from_arkit({"mouthSmileLeft": 1.0}))  # the face's left: on the audience's right
    assert smile[left, 1] > 5 and abs(smile[right, 1]) < 1.5
    jaw = _moved(from_arkit({"jawOpen": 1.0}))
    closed = _moved(from_arkit({"jawOpen": 1.0, "mouthClose": 1.0}))
    chin, lip = CONTROL_POINTS["jaw"], CONTROL_POINTS["lower_lip_upper"]
    assert jaw[chin, 1] < -15 and closed[lip, 1] > jaw[lip, 1] + 3
    assert _moved(from_arkit({"jawLeft": 1.0}))[chin, 0] > 5
    assert _moved(from_arkit({"browInnerUp": 1.0}))[FEATURE_POINTS["brow_inner_left"], 1] > 8
    assert from_arkit({"eyeLookOutLeft": 1.0, "eyeLookInRight": 1.0}).gaze[0] > 0.5
    assert from_arkit({"eyeLookDownLeft": 1.0, "eyeLookDownRight": 1.0}).gaze[1] < -0.5
    same = from_arkit({"mouth_smile_left": 0.5}).units
    np.testing.assert_array_equal(same, from_arkit({"mouthSmileLeft": 0.5}).units)


def test_all_face_animation_parameters_are_known() -> None:
    assert list(FAPS) == list(range(3, 69))
    everything = from_mpeg4(dict.fromkeys(FAPS, 300))
    assert everything.units.min() >= 0 and everything.units.max() <= 1
    for number, (name, _, targets) in FAPS.items():
        there, back = from_mpeg4({name: 400}), from_mpeg4({number: -400})
        if targets:
            change = (
                np.abs(there.units).sum() + np.abs(there.mouth).sum() + np.abs(there.gaze).sum()
            )
            assert change > 0, name
        assert not (there.units * back.units).any() or number in (27,)


def test_face_animation_parameters_mean_what_the_standard_means() -> None:
    """A thousand-and-twenty-fourths of the mouth's width moves a corner by so much."""
    chin = CONTROL_POINTS["jaw"]
    dropped = _moved(from_mpeg4({"open_jaw": 512}))[chin, 1]
    assert dropped == pytest.approx(-11, abs=0.5)
    wide = from_mpeg4({"stretch_l_cornerlip": 100, "stretch_r_cornerlip": 100})
    corner = _moved(wide)[CONTROL_POINTS["corner_right"], 0]
    assert corner == pytest.approx(100 / 1024 * 55.5, rel=0.1)
    assert wide.mouth[MOUTH_PARAMETERS.index("corner_horizontal")] > 0
    assert from_mpeg4({23: 30000, 24: 30000}).gaze[0] == pytest.approx(0.3)
    brow = _moved(from_mpeg4({"raise_l_i_eyebrow": 200}))
    assert brow[FEATURE_POINTS["brow_inner_right"], 1] == pytest.approx(200 / 1024 * 58.7, rel=0.1)
    shut = deform(RIG, units=from_mpeg4({19: 1024, 20: 1024}).units)[0] * 1000
    assert np.abs(shut[RIG.lids.upper, 1] - shut[RIG.lids.lower, 1]).max() < 0.1


FAP_DIRECTIONS = {
    # ISO/IEC 14496-2, table of FAP definitions: the feature point and where a positive value takes
    # it; x and y as the audience sees them, so the face's own left is +x.
    3: (152, "-y"), 4: (13, "-y"), 5: (14, "+y"), 6: (291, "+x"), 7: (61, "-x"), 8: (269, "-y"),
    9: (39, "-y"), 10: (402, "+y"), 11: (178, "+y"), 12: (291, "+y"), 13: (61, "+y"),
    14: (152, "+z"), 15: (152, "-x"), 16: (14, "+z"), 17: (13, "+z"), 18: (200, "+y"),
    19: (386, "-y"), 20: (159, "-y"), 21: (374, "+y"), 22: (145, "+y"), 31: (336, "+y"),
    32: (107, "+y"), 33: (334, "+y"), 34: (105, "+y"), 35: (300, "+y"), 36: (70, "+y"),
    37: (336, "-x"), 38: (107, "+x"), 39: (280, "+x"), 40: (50, "-x"), 41: (280, "+y"),
    42: (50, "+y"), 51: (0, "-y"), 52: (17, "+y"), 53: (291, "+x"), 54: (61, "-x"),
    55: (269, "-y"), 56: (39, "-y"), 57: (405, "+y"), 58: (181, "+y"), 59: (291, "+y"),
    60: (61, "+y"), 61: (358, "+x"), 62: (129, "-x"), 63: (4, "+y"),
}  # fmt: skip
FAP_GAZE = {23: (0, 1), 24: (0, 1), 25: (1, -1), 26: (1, -1)}
FAP_TONGUE = {43: "37", 45: "19"}


def test_every_parameter_moves_its_point_the_standards_way() -> None:
    """And a negative value the other way, where the face has such a movement."""
    for number, (vertex, way) in FAP_DIRECTIONS.items():
        axis, sign = "xyz".index(way[1]), 1 if way[0] == "+" else -1
        there, back = (_moved(from_mpeg4({number: v}))[vertex, axis] * sign for v in (300, -300))
        assert there > 0.2 or back < -0.2, (number, there, back)
        assert there > -0.1 and back < 0.1, (number, there, back)
    for number, (axis, sign) in FAP_GAZE.items():
        assert from_mpeg4({number: 20000}).gaze[axis] * sign > 0.09
    for number, unit in FAP_TONGUE.items():
        assert from_mpeg4({number: 300}).units[2 * NUMBERS.index(int(unit)) :][:2].max() > 0.1
    covered = {*FAP_DIRECTIONS, *FAP_GAZE, *FAP_TONGUE}
    assert covered == {number for number, row in FAPS.items() if row[2]} and len(covered) == 51


def test_the_units_are_the_distances_between_the_standards_points() -> None:
    between = {
        "MNS": REST[2, 1] - REST[13, 1],
        "MW": REST[291, 0] - REST[61, 0],
        "IRISD": REST[386, 1] - REST[374, 1],
        "ENS": 25.0 - REST[2, 1],
        "ES": 62.0,
    }
    for name, value in between.items():
        assert FAPU_MM[name] == pytest.approx(value, abs=0.06), name


@pytest.mark.parametrize(
    ("convert", "values", "code"),
    [
        (from_arkit, {"mouthSmile": 0.5}, "FACE-ARKIT"),
        (from_arkit, {"jawOpen": 1.5}, "FACE-ARKIT"),
        (from_arkit, {"jawOpen": float("nan")}, "FACE-ARKIT"),
        (from_mpeg4, {"viseme": 1}, "FACE-FAP"),
        (from_mpeg4, {2: 1}, "FACE-FAP"),
        (from_mpeg4, {69: 1}, "FACE-FAP"),
        (from_mpeg4, {3: float("nan")}, "FACE-FAP"),
    ],
)
def test_unknown_names_and_values_are_refused(convert, values, code: str) -> None:
    with pytest.raises(UsageError, match=code):
        convert(values)
