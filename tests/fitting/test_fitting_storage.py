"""A fit is kept with its character, belongs to one photograph, and is never half written."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from fitting_faces import photo, saved

from hypermask import paths
from hypermask.errors import DataError, HypermaskError
from hypermask.face.character import load_character, save_character
from hypermask.fitting import storage
from hypermask.fitting.handles import LEVELS
from hypermask.fitting.storage import FILE, open_fit


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return saved(tmp_path / "face")


def _drag_some(session) -> None:
    session.mirror = True
    for name, step in (
        ("face/eye_left", (4.2, 1.0)),
        ("parts/brow_left", (0.1, -5.7)),
        ("features/lip_corner_right", (2.5, 1.3)),
        ("points/4", (0.7, 0.3)),
    ):
        x, y = session.handles(name.split("/")[0])[name]
        assert not session.drag(name, x + step[0], y + step[1]).held


def test_a_character_without_a_fit_opens_with_the_automatic_one(folder: Path) -> None:
    stored = open_fit(folder)
    assert not any(values.any() for values in stored.fitting.moved.values())
    assert not stored.fitting.mirror and stored.kept == 1


def test_what_was_moved_comes_back_to_the_last_bit(folder: Path) -> None:
    stored = open_fit(folder)
    before = load_character(folder).texture
    _drag_some(stored.fitting)
    stored.save()
    again = open_fit(folder)
    for level in LEVELS:
        np.testing.assert_array_equal(again.fitting.moved[level], stored.fitting.moved[level])
    np.testing.assert_array_equal(again.fitting.vertices(), stored.fitting.vertices())
    assert again.fitting.mirror and again.fitting.steps == (0, 0)
    texture = load_character(folder).texture
    np.testing.assert_array_equal(texture, stored.fitting.texture()[0])
    assert (texture != before).any()


def test_the_file_is_open_and_names_what_was_moved(folder: Path) -> None:
    stored = open_fit(folder)
    _drag_some(stored.fitting)
    stored.save()
    data = json.loads((folder / FILE).read_text("utf-8"))
    assert data["version"] == 1 and data["mirror"] is True
    assert data["photo"]["file"] == "photo.png" and len(data["photo"]["sha256"]) == 64
    assert data["photo"]["size"] == [760, 900]
    assert set(data["moved"]["parts"]) == {"parts/brow_left", "parts/brow_right"}
    assert set(data["moved"]["points"][0]) == {"at_mm", "by_px"}


def test_other_files_of_the_character_stay(folder: Path) -> None:
    (folder / "note.txt").write_text("hers", "utf-8")
    stored = open_fit(folder)
    _drag_some(stored.fitting)
    stored.save()
    assert (folder / "note.txt").read_text("utf-8") == "hers"
    assert (folder / "photo.png").is_file()
    assert [entry.name for entry in folder.parent.iterdir()] == [folder.name]


def test_a_disk_that_is_full_leaves_the_old_fit(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = open_fit(folder)
    _drag_some(stored.fitting)
    stored.save()
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    stored.fitting.reset()
    monkeypatch.setattr("hypermask.storage.os.fsync", _no_space)
    with pytest.raises(HypermaskError) as caught:
        stored.save()
    assert caught.value.code == "DISK-WRITE"
    monkeypatch.undo()
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


def _no_space(*_: object) -> None:
    raise OSError(28, "No space left on device")


def test_a_photograph_that_is_given_is_kept_with_the_character(tmp_path: Path) -> None:
    folder = saved(tmp_path / "face", with_photo=False)
    with pytest.raises(DataError) as caught:
        open_fit(folder)
    assert caught.value.code == "FIT-PHOTO"
    given = tmp_path / "elsewhere.PNG"
    cv2.imwrite(str(given), photo())
    open_fit(folder, given).save()
    assert (folder / "photo.png").read_bytes() == given.read_bytes()
    assert open_fit(folder).known["file"] == "photo.png"


def test_another_photograph_is_refused(folder: Path, tmp_path: Path) -> None:
    stored = open_fit(folder)
    _drag_some(stored.fitting)
    stored.save()
    other = tmp_path / "other.png"
    cv2.imwrite(str(other), np.roll(photo(), 1, axis=1))
    for call in (lambda: open_fit(folder, other), lambda: _exchanged(folder, other)):
        with pytest.raises(DataError) as caught:
            call()
        assert caught.value.code == "FIT-PHOTO"
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), photo()[:300, :300])
    with pytest.raises(DataError, match="FIT-PHOTO"):
        open_fit(folder, small)


def _exchanged(folder: Path, other: Path) -> None:
    (folder / "photo.png").write_bytes(other.read_bytes())
    open_fit(folder)


def test_a_character_that_no_photograph_made_cannot_be_fitted() -> None:
    with pytest.raises(DataError, match="FIT-PHOTO"):
        open_fit(paths.configs() / "characters" / "mean")


def test_building_anew_gives_the_automatic_fit(folder: Path) -> None:
    stored = open_fit(folder)
    _drag_some(stored.fitting)
    stored.save()
    save_character(load_character(folder), folder)
    assert not (folder / FILE).exists()


def _broken(change) -> str:
    data = {
        "version": 1,
        "photo": {"file": "photo.png", "sha256": "0" * 64, "size": [760, 900]},
        "mirror": False,
        "moved": {"face": {}, "parts": {}, "features": {}, "points": []},
    }
    change(data)
    return json.dumps(data)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "4",
        "null",
        "[" * 100_000,
        _broken(lambda d: d.update(version=2)),
        _broken(lambda d: d.pop("photo")),
        _broken(lambda d: d.update(mirror="yes")),
        _broken(lambda d: d["moved"].pop("points")),
        _broken(lambda d: d["moved"].update(parts={"parts/tail": [1, 2]})),
        _broken(lambda d: d["moved"].update(parts={"parts/nose": [1]})),
        _broken(lambda d: d["moved"].update(parts={"parts/nose": ["a", 2]})),
        _broken(lambda d: d["moved"].update(parts={"parts/nose": [float("nan"), 2]})),
        _broken(lambda d: d["moved"].update(parts={"parts/nose": [1e300, 2]})),
        _broken(lambda d: d["moved"].update(points=[{"at_mm": [0, 0]}])),
        _broken(lambda d: d["moved"].update(points=7)),
    ],
)
def test_a_damaged_fit_is_named_and_not_used(folder: Path, text: str) -> None:
    (folder / FILE).write_text(text, "utf-8")
    with pytest.raises(DataError) as caught:
        open_fit(folder)
    assert caught.value.code == "FIT-READ" and FILE in str(caught.value)


def test_corrections_that_would_fold_this_mesh_are_taken_over_in_part(folder: Path) -> None:
    stored = open_fit(folder)
    _drag_some(stored.fitting)
    stored.save()
    data = json.loads((folder / FILE).read_text("utf-8"))
    data["moved"]["points"] = [{"at_mm": data["moved"]["points"][0]["at_mm"], "by_px": [90, 0]}]
    (folder / FILE).write_text(json.dumps(data), "utf-8")
    again = open_fit(folder)
    assert 0 <= again.kept < 1
    assert np.isfinite(again.fitting.vertices()).all()


def test_points_are_found_again_by_their_place(folder: Path, monkeypatch) -> None:
    stored = open_fit(folder)
    _drag_some(stored.fitting)
    stored.save()
    data = json.loads((folder / FILE).read_text("utf-8"))
    data["moved"]["points"].append({"at_mm": [500.0, 0.0], "by_px": [1.0, 1.0]})
    (folder / FILE).write_text(json.dumps(data), "utf-8")
    again = open_fit(folder)
    np.testing.assert_array_equal(again.fitting.moved["points"], stored.fitting.moved["points"])
    assert storage.VERSION == 1


def _hypermask(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "hypermask.cli.main", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ,
    )


def test_the_command_applies_drags_and_draws_the_fit(folder: Path, tmp_path: Path) -> None:
    drags = tmp_path / "drags.json"
    drags.write_text(
        json.dumps(
            [
                {"do": "mirror", "on": True},
                {"handle": "parts/brow_left", "by": [0, -4]},
                {"handle": "points/4", "by": [300, 0]},
            ]
        ),
        "utf-8",
    )
    out = tmp_path / "fit.png"
    done = _hypermask(
        "face", "fit", str(folder), "--apply", str(drags), "--out", str(out), "--json"
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["mirror"] and told["answers"][2]["notice"]["code"] == "FIT-FOLD"
    assert {level["name"]: level["moved"] for level in told["levels"]}["parts"] == 2
    assert len(told["handles"]["features"]) == 48
    picture = cv2.imread(str(out))
    assert picture.shape == (1024, 1536, 3)
    assert open_fit(folder).fitting.moved["parts"].any()


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("{}", "FIT-REQUEST"),
        ("[", "FIT-REQUEST"),
        ('[{"handle": "parts/tail", "by": [0, 1]}]', "FIT-HANDLE"),
        ('[{"handle": "parts/nose", "x": 1e9, "y": 0}]', "FIT-PLACE"),
    ],
)
def test_a_wrong_file_of_drags_is_one_line_and_changes_nothing(
    folder: Path, tmp_path: Path, text: str, code: str
) -> None:
    drags = tmp_path / "drags.json"
    drags.write_text(text, "utf-8")
    done = _hypermask("face", "fit", str(folder), "--apply", str(drags))
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert done.stderr.startswith(f"{code}: ") and len(done.stderr.strip().splitlines()) == 1
    assert not (folder / FILE).exists()
