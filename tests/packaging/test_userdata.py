"""What the user made opens in a newer version, and after a rollback in the older one."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hypermask import paths
from hypermask.face.expressions import find_expression, load_expression, save_expression
from hypermask.update import userdata
from hypermask.voice import speaker


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One thing of most kinds, as this version writes it."""
    folder = tmp_path / "home"
    monkeypatch.setenv("HYPERMASK_HOME", str(folder))
    shutil.copytree(paths.configs() / "characters" / "noh", folder / "characters" / "anna")
    text = folder / "characters" / "anna" / "character.toml"
    text.write_text(text.read_text("utf-8").replace('"noh"', '"anna"'), "utf-8")
    save_expression(load_expression(find_expression("wink")), folder / "expressions")
    (folder / "shows").mkdir()
    shutil.copy(paths.configs() / "shows" / "default.toml", folder / "shows" / "mine.toml")
    speaker.save(speaker.unknown("Bert"))
    return folder


def bad() -> list[str]:
    return [finding.path for finding in userdata.look() if finding.problem]


def written_by_a_newer_version(path: Path) -> None:
    text = path.read_text("utf-8").replace("version = 1", "version = 2", 1)
    path.unlink()
    path.write_text(text, "utf-8")


def test_everything_of_this_version_opens() -> None:
    found = {finding.path: finding.problem for finding in userdata.look()}
    assert found == dict.fromkeys(
        ["characters/anna", "expressions/wink.toml", "shows/mine.toml", "voices/0001.npz"]
    )


def test_after_a_rollback_what_cannot_be_read_comes_back_as_it_was(
    home: Path, tmp_path: Path
) -> None:
    aside = tmp_path / "data-1"
    userdata.put_aside(aside)
    texture = (home / "characters/anna/texture.png").read_bytes()
    for name in ("characters/anna/character.toml", "expressions/wink.toml"):
        written_by_a_newer_version(home / name)
    (home / "characters/anna/texture.png").unlink()
    assert bad() == ["characters/anna", "expressions/wink.toml"]
    assert userdata.mend(aside) == []
    assert bad() == []
    assert (home / "characters/anna/texture.png").read_bytes() == texture
    assert "version = 2" in (home / "expressions/wink.toml.newer").read_text("utf-8")
    assert (home / "characters/anna.newer").is_dir()


def test_what_was_made_since_and_can_be_read_is_not_touched(home: Path, tmp_path: Path) -> None:
    aside = tmp_path / "data-1"
    userdata.put_aside(aside)
    speaker.save(speaker.unknown("Cora"))
    show = home / "shows/mine.toml"
    changed = show.read_text("utf-8") + "# changed since\n"
    show.unlink()
    show.write_text(changed, "utf-8")
    assert userdata.mend(aside) == []
    assert show.read_text("utf-8") == changed
    assert (home / "voices/0002.npz").exists()


def test_what_only_the_newer_version_knows_is_named(home: Path, tmp_path: Path) -> None:
    aside = tmp_path / "data-1"
    userdata.put_aside(aside)
    (home / "voices/0002.npz").write_bytes(b"a format of the future")
    left = userdata.mend(aside)
    assert [finding.path for finding in left] == ["voices/0002.npz"]


def test_what_is_put_aside_costs_no_room_and_no_half_of_it_is_there(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    aside = tmp_path / "data-1"
    userdata.put_aside(aside)
    assert (aside / "characters/anna/texture.png").samefile(home / "characters/anna/texture.png")
    before = sorted(path for path in aside.rglob("*"))

    def full(*arguments: object, **named: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hypermask.update.userdata.shutil.copytree", full)
    with pytest.raises(OSError, match="No space"):
        userdata.put_aside(aside)
    assert sorted(path for path in aside.rglob("*")) == before


def test_the_writers_replace_files_so_links_keep_the_old_ones(home: Path, tmp_path: Path) -> None:
    aside = tmp_path / "data-1"
    userdata.put_aside(aside)
    wink = load_expression(find_expression("wink"))
    save_expression(replace(wink, units=wink.units * 0.5), home / "expressions")
    old = load_expression(aside / "expressions/wink.toml")
    new = load_expression(home / "expressions/wink.toml")
    assert np.allclose(new.units, old.units * 0.5, atol=1e-3)


def test_links_of_the_shows_user_lead_root_nowhere(home: Path, tmp_path: Path) -> None:
    """Root puts aside and mends in folders that are not root's."""
    secret = tmp_path / "secret"
    (secret / "deep").mkdir(parents=True)
    (secret / "deep/key").write_text("of root", "utf-8")
    (home / "characters/anna/deep").symlink_to(secret / "deep")
    (home / "characters/anna/key").symlink_to(secret / "deep/key")
    shutil.rmtree(home / "shows")
    (home / "shows").symlink_to(secret)
    aside = tmp_path / "data-1"
    userdata.put_aside(aside)
    assert (aside / "characters/anna/key").is_symlink()
    assert (aside / "characters/anna/deep").is_symlink()
    assert not (aside / "shows").exists()
    written_by_a_newer_version(home / "characters/anna/character.toml")
    userdata.mend(aside)
    assert bad() == []
    assert (home / "characters/anna/key").is_symlink()
    assert (home / "characters/anna/deep").is_symlink()


def test_nothing_is_restored_behind_a_link(home: Path, tmp_path: Path) -> None:
    aside, elsewhere = tmp_path / "data-1", tmp_path / "elsewhere"
    userdata.put_aside(aside)
    (home / "expressions").rename(elsewhere)
    (home / "expressions").symlink_to(elsewhere)
    written_by_a_newer_version(elsewhere / "wink.toml")
    before = (elsewhere / "wink.toml").read_text("utf-8")
    assert [finding.path for finding in userdata.mend(aside)] == ["expressions/wink.toml"]
    assert (elsewhere / "wink.toml").read_text("utf-8") == before
    assert not list(elsewhere.glob("*.newer"))


def test_where_links_cannot_be_made_hard_the_copy_follows_none(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object, **named: object) -> None:
        raise OSError(18, "Invalid cross-device link")

    monkeypatch.setattr("hypermask.update.userdata.os.link", refuse)
    (tmp_path / "key").write_text("of root", "utf-8")
    userdata._link(str(home / "characters/anna/texture.png"), str(tmp_path / "copy.png"))
    assert (tmp_path / "copy.png").is_file()
    (home / "characters/key").symlink_to(tmp_path / "key")
    userdata._link(str(home / "characters/key"), str(tmp_path / "copied"))
    assert (tmp_path / "copied").is_symlink()


def test_one_version_asks_another_ones_code(home: Path) -> None:
    written_by_a_newer_version(home / "expressions/wink.toml")
    done = subprocess.run(
        [sys.executable, "-m", "hypermask.update.userdata"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1, done.stderr
    assert [entry["path"] for entry in json.loads(done.stdout)] == ["expressions/wink.toml"]
