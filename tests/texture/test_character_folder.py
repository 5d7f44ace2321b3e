"""A character's folder holds all it was made from, and is whole at every moment."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask import paths
from hypermask.errors import DataError
from hypermask.face import exchange as exchanging
from hypermask.face.character import Character, load_character, save_character
from hypermask.texture.build import build_character, rebuild
from hypermask.texture.models import MODELS
from hypermask.texture.photo import load_photo

FACES = Path(__file__).parents[2].parent / "shared" / "data" / "faces"
PHOTOS = sorted(FACES.glob("*.jpg"))[::65]
needs_photos = pytest.mark.skipif(
    not PHOTOS or not all((paths.models() / model.file).is_file() for model in MODELS),
    reason="../shared/data/faces or the face models are absent",
)


def _character(level: int = 90) -> Character:
    texture = np.full((512, 512, 3), level, np.uint8)
    return Character("someone", "", "2026-01-01", texture, np.zeros((112, 320, 3), np.uint8))


@needs_photos
def test_the_folder_holds_photo_landmarks_texture_fit_and_metadata(tmp_path: Path) -> None:
    build_character(PHOTOS[0], "someone", tmp_path)
    folder = tmp_path / "someone"
    names = {"character.toml", "eyes.png", "landmarks.json", "photo.jpg", "source.json"}
    assert {path.name for path in folder.iterdir()} == {*names, "texture.png"}
    assert (folder / "photo.jpg").read_bytes() == PHOTOS[0].read_bytes()
    source = json.loads((folder / "source.json").read_text())
    assert len(source["fit"]["hardy_px"]) == 84 and source["photo_is_original"]
    assert len(source["made_by"]["texture_model_sha256"]) == 64


@needs_photos
@pytest.mark.parametrize("kind", ["jpg", "png"])
def test_a_moved_folder_gives_the_same_texture_again(tmp_path: Path, kind: str) -> None:
    photo = tmp_path / f"photo.{kind}"
    large = cv2.resize(load_photo(PHOTOS[1]), None, fx=2, fy=2)
    cv2.imwrite(str(photo), large)
    made = build_character(photo, "someone", tmp_path)
    photo.unlink()
    (tmp_path / "someone").rename(tmp_path / "elsewhere")
    again = rebuild(load_character(tmp_path / "elsewhere"))
    np.testing.assert_array_equal(again.texture, made.texture)
    np.testing.assert_array_equal(again.eyes, made.eyes)
    kept = cv2.imread(str(tmp_path / "elsewhere" / "photo.jpg"))
    assert max(kept.shape) <= 2048
    assert rebuild(again, 1024).texture.shape == (1024, 1024, 3)


def test_folders_of_older_programs_are_read(tmp_path: Path) -> None:
    save_character(_character(), tmp_path / "someone")
    read = load_character(tmp_path / "someone")
    assert read.photo is None and read.record is None
    with pytest.raises(DataError) as caught:
        rebuild(read)
    assert caught.value.code == "CHAR-SOURCE"


@pytest.mark.parametrize("name", ["character.toml", "source.json"])
def test_a_newer_version_is_refused_in_words(tmp_path: Path, name: str) -> None:
    save_character(replace(_character(), record={"advice": []}), tmp_path / "someone")
    path = tmp_path / "someone" / name
    text = (
        path.read_text().replace("version = 1", "version = 9").replace('version": 1', 'version": 9')
    )
    path.write_text(text)
    with pytest.raises(DataError) as caught:
        load_character(tmp_path / "someone")
    assert caught.value.code == "CHAR-READ" and "newer" in caught.value.remedy


def test_a_damaged_record_is_refused(tmp_path: Path) -> None:
    save_character(_character(), tmp_path / "someone")
    for text in ("{", "[1]", '"a"', "{}"):
        (tmp_path / "someone" / "source.json").write_text(text)
        with pytest.raises(DataError) as caught:
            load_character(tmp_path / "someone")
        assert caught.value.code == "CHAR-READ"


_READER = """
import sys
from pathlib import Path
path, seen = Path(sys.argv[1]), 0
print("ready", flush=True)
while not (path.parent / "stop").exists():
    assert (path / "character.toml").read_text().startswith("version"), "half a character"
    seen += 1
print(seen)
"""


def _wanted_exchange() -> bool:
    """Whether this file system can exchange two folders at once."""
    return exchanging._renameat2() is not None


@pytest.mark.skipif(not _wanted_exchange(), reason="no renameat2 in this C library")
def test_a_reader_finds_the_character_at_every_moment(tmp_path: Path) -> None:
    folder = tmp_path / "someone"
    save_character(_character(), folder)
    (tmp_path / "probe").mkdir()
    if not exchanging._swapped(tmp_path / "probe", folder) or not (folder.exists()):
        pytest.skip("this file system cannot exchange folders")
    assert exchanging._swapped(tmp_path / "probe", folder)
    reader = subprocess.Popen([sys.executable, "-c", _READER, folder], stdout=subprocess.PIPE)
    assert reader.stdout is not None and reader.stdout.readline() == b"ready\n"
    for level in range(20):
        save_character(_character(level), folder)
    (tmp_path / "stop").touch()
    seen = int(reader.stdout.read() or 0)
    assert reader.wait() == 0 and seen > 0


def test_without_the_exchange_the_character_is_replaced_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exchanging, "_renameat2", lambda: None)
    for level in (10, 200):
        save_character(_character(level), tmp_path / "someone")
    assert load_character(tmp_path / "someone").texture[0, 0, 0] == 200
    assert [path.name for path in tmp_path.iterdir()] == ["someone"]


def test_what_a_killed_process_left_is_cleared_away(tmp_path: Path) -> None:
    gone = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"],
                          capture_output=True, text=True, check=True).stdout.strip()  # fmt: skip
    left = tmp_path / f".someone.{gone}-abc"
    left.mkdir()
    aside = tmp_path / f".someone.{gone}-abd.old"
    save_character(_character(70), aside)
    other = tmp_path / f".someone-else.{gone}-abc"
    other.mkdir()
    mine = tmp_path / f"{exchanging.prefix(tmp_path / 'someone')}xyz"
    mine.mkdir()
    exchanging.clear(tmp_path / "someone")
    assert load_character(tmp_path / "someone").texture[0, 0, 0] == 70
    assert {path.name for path in tmp_path.iterdir()} == {"someone", other.name, mine.name}
