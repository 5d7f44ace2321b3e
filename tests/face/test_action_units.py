"""44 action units of FACS on 48 feature points (PAPERS A4), and the six emotions made of them."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from hypermask.errors import ConfigError, UsageError
from hypermask.face.action_units import NUMBERS, load_action_units, unit_weights
from hypermask.face.emotions import EMOTIONS, emotion_units
from hypermask.face.face import all_units, deform, load_rig
from hypermask.face.features import FEATURE_POINTS, carrier, natural_spline
from hypermask.face.limits import Guard, hold
from hypermask.face.mesh import load_mesh, signed_areas
from hypermask.face.mouth import CONTROL_POINTS, MOUTH_SHAPES


class _NoGuard(Guard):
    def untangle(self, flat: np.ndarray) -> float:
        return 1.0


RIG = load_rig()
_GUARD = {field.name: getattr(RIG.guard, field.name) for field in dataclasses.fields(Guard)}
UNGUARDED = dataclasses.replace(RIG, guard=_NoGuard(**_GUARD))
REST = RIG.mesh.rest * 1000
TABLE = load_action_units().table
FACES_OWN = {"L": "right", "R": "left"}
SHAPES = np.array(list(MOUTH_SHAPES.values()))


def _moved(units, expression=None, mouth=None, lids=0.0) -> np.ndarray:
    flat, out = deform(RIG, expression, mouth, lids, units)
    return np.column_stack([flat * 1000 - REST, out * 1000])


def _sound(flat: np.ndarray) -> bool:
    return bool((signed_areas(flat, RIG.mesh.triangles) > 0).all())


def test_there_are_the_papers_units_and_points() -> None:
    assert (*NUMBERS,) == (1, 2, *range(4, 40), *range(41, 47)) and len(TABLE) == 44
    assert len(FEATURE_POINTS) == len(set(FEATURE_POINTS.values())) == 48
    names = " ".join(FEATURE_POINTS)
    assert all(part in names for part in ("lip", "brow", "lid", "cheek", "forehead", "ear"))
    assert TABLE[12].name == "Lip Corner Puller" and TABLE[4].name == "Brow Lowerer"
    assert all(unit.name and unit.text and unit.moves for unit in TABLE.values())


def test_every_vertex_follows_the_48_points() -> None:
    follow = carrier()
    assert follow.shape == (load_mesh().count, 48)
    np.testing.assert_allclose(follow[list(FEATURE_POINTS.values())], np.eye(48), atol=1e-9)
    mirror = list(FEATURE_POINTS)
    swap = {"left": "right", "right": "left"}
    other = []
    for name in mirror:
        stem, _, side = name.rpartition("_")
        other.append(mirror.index(f"{stem}_{swap[side]}" if side in swap else name))
    np.testing.assert_allclose(follow[load_mesh().mirror][:, other], follow, atol=0.05)


def test_a_spline_goes_through_its_knots_and_keeps_straight_lines() -> None:
    knots = np.array([-2.0, -0.5, 0.0, 1.0, 3.0])
    np.testing.assert_allclose(natural_spline(knots, knots), np.eye(5), atol=1e-12)
    at = np.linspace(-2, 3, 11)
    np.testing.assert_allclose(natural_spline(knots, at) @ (2 * knots + 1), 2 * at + 1)


@pytest.mark.parametrize("number", NUMBERS)
def test_a_unit_moves_its_points_as_the_table_says(number: int) -> None:
    """Alone and at full strength; where lids or lips meet they may stop short."""
    moved = _moved({str(number): 1.0})
    assert np.hypot(moved[:, 0], moved[:, 1]).max() > 0.8
    for point, (out, up, forward) in TABLE[number].moves.items():
        for name, side in ((point, 0), (f"{point}_left", -1), (f"{point}_right", 1)):
            if name not in FEATURE_POINTS or "lid" in name or "lip" in name:
                continue
            sign = 1 if number == 30 else side
            where = moved[FEATURE_POINTS[name]]
            far = ("brow", "forehead", "ear", "nose_root", "nose_side")
            atol = 0.05 if name.startswith(far) else 1.2  # the lips that meet push what is near
            np.testing.assert_allclose(where, (out * sign, up, forward), atol=atol, err_msg=name)


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("side", "LR")
def test_halves_are_separate_and_make_the_whole(number: int, side: str) -> None:
    if number == 30:
        way = _moved({f"30{side}": 1.0})[FEATURE_POINTS["chin"], 0]
        assert (way > 5) if side == "L" else (way < -5)
        return
    half = _moved({f"{number}{side}": 1.0})
    size = np.hypot(half[:, 0], half[:, 1])
    x = REST[:, 0] if FACES_OWN[side] == "right" else -REST[:, 0]
    assert size[x > 6].sum() > 1.2 * size[x < -6].sum()
    weights = unit_weights({f"{number}L": 0.5, f"{number}R": 0.5})
    np.testing.assert_array_equal(weights, unit_weights({str(number): 0.5}))


@pytest.mark.parametrize("number", NUMBERS)
def test_intensity_grows_steadily(number: int) -> None:
    sizes = [np.abs(_moved({str(number): w})[:, :2]).sum() for w in np.linspace(0, 1, 6)]
    assert sizes[0] == pytest.approx(_moved({}).__abs__()[:, :2].sum())
    assert (np.diff(sizes) > 0).all()


def test_names_and_intensities_may_be_written_in_many_ways() -> None:
    expected = unit_weights({"12L": 1.0, "12R": 1.0})
    both = {"AU12": 0.2, "12L": 1, "12R": 1}
    for written in ({"12": "E"}, {"AU12": 1}, {"au12l": 1.0, "AU12R": "e"}, both):
        np.testing.assert_array_equal(unit_weights(written), expected)
    letters = [unit_weights({"1": letter}).max() for letter in "ABCDE"]
    assert letters == sorted(letters) and letters[0] > 0 and letters[-1] == 1
    in_order = np.zeros(44)
    in_order[NUMBERS.index(12)] = 1.0
    np.testing.assert_array_equal(unit_weights(in_order), expected)


@pytest.mark.parametrize(
    "units",
    [{"3": 1.0}, {"40": 1.0}, {"47": 0.5}, {"12X": 1.0}, {"smile": 1.0}, {"12": 1.1}, {"12": -0.1},
     {"12": "F"}, {"12": float("nan")}, {"12": True}, {"12": None}, np.zeros(43),
     np.full(88, np.nan)],
)  # fmt: skip
def test_wrong_units_are_refused_in_words(units) -> None:
    with pytest.raises(UsageError, match="FACE-AU") as caught:
        deform(RIG, units=units)
    assert caught.value.remedy


def test_a_damaged_table_is_refused(tmp_path: Path) -> None:
    table = Path(load_action_units.__wrapped__.__code__.co_filename).with_name("action_units.toml")
    text = table.read_text("utf-8")
    path = tmp_path / "units.toml"
    for old, new, error, words in (
        ("brow_inner =", "brow_center =", UsageError, "brow_center"),
        ("[AU1]", "[AU3]", ConfigError, "AU1"),
        ('unit = "mm"', 'unit = "inch"', ConfigError, "unit"),
        ("yields = 0.85", "yield = 0.85", ConfigError, "yield"),
        ("version = 1", "version = 2", ConfigError, "version"),
    ):
        path.write_text(text.replace(old, new, 1), "utf-8")
        load_action_units.cache_clear()
        with pytest.raises(error, match=words):
            load_action_units(path)
    load_action_units.cache_clear()


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("side", ["", "L", "R"])
def test_no_single_unit_turns_a_triangle_over(number: int, side: str) -> None:
    """And none needs the guard for it: one unit alone is what the table says."""
    for lids in (0.0, 1.0):
        assert _sound(deform(UNGUARDED, None, None, lids, {f"{number}{side}": 1.0})[0])


@pytest.mark.parametrize("variant", ["short", "full"])
def test_no_emotion_with_any_mouth_turns_a_triangle_over(variant: str) -> None:
    for emotion in EMOTIONS:
        for shape in SHAPES:
            for lids in (0.0, 1.0):
                assert _sound(deform(UNGUARDED, {emotion: 1.0}, shape, lids, None, variant)[0])


def test_ten_thousand_random_mixtures_turn_no_triangle_over() -> None:
    """Units, emotions, mouth and lids together, from a few units to all 88 halves at once."""
    random = np.random.default_rng(44)
    for k in range(10_000):
        units = random.random(88) * (random.random(88) < (0.05, 0.2, 0.5, 1.0)[k % 4])
        emotions = random.dirichlet(np.ones(6)) * random.random()
        mouth = random.dirichlet(np.full(6, 0.4)) @ SHAPES
        if k % 10 == 0:  # no mouth that anyone would speak with, but within the range
            mouth = random.uniform(-1.5, 1.5, 13)
        flat = deform(RIG, emotions, mouth, random.random(2), units)[0]
        assert _sound(flat), k


def test_the_guard_moves_without_a_jump_and_only_when_it_must() -> None:
    """Ever more of a mixture that would tear: positions change by no more than the weights do."""
    random = np.random.default_rng(3)
    units, mouth = random.random(88), SHAPES[1]
    path = np.array([deform(RIG, None, mouth, 0.0, units * w)[0] for w in np.linspace(0, 1, 201)])
    steps = np.abs(np.diff(path, axis=0)).max(axis=(1, 2)) * 1000
    assert steps.max() < 0.6
    assert RIG.guard.untangle(path[-1].copy()) == 1.0
    near = np.full((48, 3), 0.001)
    assert hold(near, np.full(48, 0.01)) is near
    far = hold(near * 100, np.full(48, 0.01))
    assert np.hypot(far[:, 0], far[:, 1]).max() < 0.0111


def test_emotions_are_combinations_of_the_emfacs_units() -> None:
    expected = {
        "happiness": {6, 12}, "sadness": {1, 4, 15}, "surprise": {1, 2, 5, 26},
        "fear": {1, 2, 4, 5, 7, 20, 26}, "anger": {4, 5, 7, 23}, "disgust": {9, 15, 16},
    }  # fmt: skip
    for k, emotion in enumerate(EMOTIONS):
        short = {NUMBERS[j] for j in np.flatnonzero(emotion_units("short")[k][::2])}
        full = {NUMBERS[j] for j in np.flatnonzero(emotion_units("full")[k][::2])}
        assert short == expected[emotion]
        assert full >= short
    np.testing.assert_allclose(all_units({"fear": 1.0}, None, "short"), emotion_units("short")[5])
    with pytest.raises(UsageError, match="FACE-EMOTION"):
        emotion_units("long")


def test_a_smile_while_speaking() -> None:
    """The corners are drawn up and out in every spoken shape; the jaw stays the speech's own."""
    corner, chin = CONTROL_POINTS["corner_right"], CONTROL_POINTS["jaw"]
    for name, shape in MOUTH_SHAPES.items():
        plain, smile = _moved(None, None, shape), _moved({"6": 1, "12": 1}, None, shape)
        assert smile[corner, 1] - plain[corner, 1] > 5 and smile[corner, 0] - plain[corner, 0] > 4
        assert smile[chin, 1] == pytest.approx(plain[chin, 1], abs=0.5), name
    dropped = _moved({"26": 1.0}, None, MOUTH_SHAPES["a"])[chin, 1]
    assert dropped > _moved(None, None, MOUTH_SHAPES["a"])[chin, 1] - 4


def test_lids_of_one_eye_shut_by_a_wink() -> None:
    for side, own, other in (("L", slice(7, 14), slice(0, 7)), ("R", slice(0, 7), slice(7, 14))):
        flat = deform(RIG, units={f"46{side}": 1.0})[0] * 1000
        gap = flat[RIG.lids.upper, 1] - flat[RIG.lids.lower, 1]
        assert np.abs(gap[own]).max() < 0.05 and gap[other].max() > 5
