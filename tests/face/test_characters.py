"""Characters on disk: whole or absent, found by name, refused when damaged; and on the stage."""

from pathlib import Path

import numpy as np
import pytest

from hypermask import paths
from hypermask.errors import ConfigError, DataError, HypermaskError
from hypermask.face import character as characters
from hypermask.face.action_units import NUMBERS
from hypermask.face.character import (
    Character,
    find_character,
    known_characters,
    load_character,
    save_character,
)
from hypermask.face.emotions import EMOTIONS
from hypermask.face.face import Face
from hypermask.face.mouth import MOUTH_SHAPES
from hypermask.face.sheet import POSES, front_view, sheet, turned_view, unit_poses
from hypermask.mask import load_mask

MASK = load_mask(Path(__file__).parents[2] / "configs" / "masks" / "reference")
BUILTIN = ("mean", "noh", "kabuki", "clown")


def _character(name: str = "someone", level: int = 90) -> Character:
    texture = np.full((512, 512, 3), level, np.uint8)
    eyes = np.full((112, 320, 3), 200, np.uint8)
    return Character(name, "a test", "2026-01-01", texture, eyes, np.ones((468, 3)))


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path / "home"))


@pytest.mark.parametrize("name", BUILTIN)
def test_built_in_characters_are_there_and_small(name: str) -> None:
    folder = find_character(name)
    assert load_character(folder).name == name
    assert (folder / "texture.png").stat().st_size <= 300_000


def test_what_is_saved_is_read_back(tmp_path: Path) -> None:
    save_character(_character(), tmp_path / "someone")
    read = load_character(tmp_path / "someone")
    np.testing.assert_array_equal(read.texture, _character().texture)
    assert read.landmarks is not None and read.date == "2026-01-01"


def test_a_failed_save_leaves_the_old_character(tmp_path: Path, monkeypatch) -> None:
    save_character(_character(level=10), tmp_path / "someone")

    def full(path: Path, data: bytes) -> None:
        raise HypermaskError("DISK-WRITE", "the disk is full", "Free some space.")

    monkeypatch.setattr(characters, "write_atomically", full)
    with pytest.raises(HypermaskError, match="DISK-WRITE"):
        save_character(_character(level=200), tmp_path / "someone")
    assert load_character(tmp_path / "someone").texture[0, 0, 0] == 10
    assert [path.name for path in tmp_path.iterdir() if path.name != "home"] == ["someone"]


def test_the_users_character_comes_before_the_built_in_one() -> None:
    save_character(_character("noh"), paths.home() / "characters" / "noh")
    assert load_character(find_character("noh")).source == "a test"
    assert set(BUILTIN) <= set(known_characters())


def test_a_character_is_found_by_its_folder(tmp_path: Path) -> None:
    save_character(_character(), tmp_path / "someone")
    assert find_character(tmp_path / "someone") == tmp_path / "someone"
    assert find_character(str(tmp_path / "someone")) == tmp_path / "someone"


def test_an_unknown_character_names_the_known_ones() -> None:
    with pytest.raises(DataError) as caught:
        find_character("nobody")
    assert caught.value.code == "CHAR-ABSENT"
    assert "mean" in str(caught.value) and "noh" in str(caught.value)
    with pytest.raises(DataError, match="CHAR-ABSENT"):
        find_character("../characters")


def test_damaged_characters_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "someone"

    def fails(expected: str) -> None:
        with pytest.raises(HypermaskError) as caught:
            load_character(folder)
        assert caught.value.code == expected
        save_character(_character(), folder)

    save_character(_character(), folder)
    (folder / "texture.png").write_bytes(b"")
    fails("CHAR-READ")
    (folder / "eyes.png").unlink()
    fails("CHAR-READ")
    (folder / "landmarks.json").write_text('{"points_px": [1, 2]}')
    fails("CHAR-READ")
    (folder / "character.toml").write_text('version = 99\nname = "someone"\n')
    fails("CHAR-READ")
    (folder / "character.toml").write_text("version = [")
    with pytest.raises(ConfigError):
        load_character(folder)


def test_every_layer_gets_its_vertices_each_frame() -> None:
    face = Face(load_character(find_character("mean")), MASK)
    for mouth in MOUTH_SHAPES.values():
        positions = face.positions({"happiness": 0.5}, mouth, 0.3)
        assert len(positions) == len(face.actor.layers)
        for layer, places in zip(face.actor.layers, positions, strict=True):
            assert places.dtype == np.float32 and places.shape == (len(layer.uv), 3)
            assert np.isfinite(places).all()


def test_the_skin_stays_on_the_relief_and_the_rest_behind_it() -> None:
    face = Face(load_character(find_character("mean")), MASK)
    positions = face.positions({"surprise": 1.0}, MOUTH_SHAPES["a"])
    names = [layer.name for layer in face.actor.layers]
    skin = positions[names.index("skin")]
    inner = positions[: names.index("skin")]
    np.testing.assert_allclose(skin[:, 2], MASK.height(skin[:, 0], skin[:, 1]), atol=1e-6)
    for places in inner:
        depth = MASK.height(places[:, 0], places[:, 1]) - places[:, 2]
        assert depth.min() > 0.002 and depth.max() < 0.025


def test_teeth_show_in_an_open_mouth_and_not_in_a_closed_one() -> None:
    """Seen from the front: white between the lips for /e/, none for the closed mouth."""
    face = Face(load_character(find_character("mean")), MASK)

    def white(mouth: str) -> float:
        picture = front_view(face, face.positions(None, MOUTH_SHAPES[mouth]), 1.0)
        around = picture[int(135 * 1.02) + 40 : int(135 * 1.02) + 90, 70:132].min(axis=2)
        return float((around > 165).mean())

    assert white("closed") < 0.01 < 0.03 < white("e")


def test_the_lids_hide_the_eyeballs() -> None:
    """Without the dark discs over the eye holes, the iris is seen only while the lids are open."""
    face = Face(load_character(find_character("mean")), MASK)

    def darkness(lids: float) -> float:
        picture = front_view(face, face.positions(lids=lids), 1.0, eye_holes=False)
        middle = picture.shape[0] // 2 - 25
        return float(picture[middle - 2 : middle + 3, 101 - 33 : 101 - 28].mean())

    assert darkness(1.0) > darkness(0.0) + 25


def test_the_sheet_shows_every_emotion_mouth_unit_and_turn() -> None:
    poses = (*POSES, *unit_poses())
    assert {name for pose in poses for name in pose.expression} == set(EMOTIONS)
    assert {pose.mouth for pose in poses} == set(MOUTH_SHAPES)
    assert {str(n) for n in NUMBERS} <= {name for pose in poses for name in pose.units}
    assert {pose.turn[0] for pose in poses} >= {-30.0, 30.0}
    character = load_character(find_character("mean"))
    picture = sheet(character, MASK, columns=2, pixels_per_mm=0.5, poses=poses[:3])
    assert picture.shape[1] % 2 == 0 and (picture[-30:, picture.shape[1] // 2 + 5 :] == 0).all()


def test_a_turned_mask_looks_narrower_and_shows_the_turned_face() -> None:
    face = Face(load_character(find_character("mean")), MASK)
    ahead = front_view(face, face.positions(), 0.8)
    same = turned_view(face, face.positions(), 0.8, (0.0, 0.0))
    assert np.abs(ahead.astype(int) - same).mean() < 1.0

    def width(yaw: float) -> int:
        lit = turned_view(face, face.positions(), 0.8, (yaw, 0.0)).max(axis=2) > 20
        return int(lit.any(axis=0).sum())

    assert width(0) > width(20) > width(40)
