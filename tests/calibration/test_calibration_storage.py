"""Calibrations on disk: all are kept, one is current, a damaged one is never silent."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from calibration_rig import Rig, reference_truth

from hypermask.calibration import storage
from hypermask.calibration.outcome import Outcome
from hypermask.calibration.parameters import ProCam
from hypermask.calibration.planar import Planar
from hypermask.calibration.rehearsed import rehearse
from hypermask.errors import DataError, HypermaskError


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Outcome]:
    made = {}
    for method in ("click", "affine"):
        rig = Rig(reference_truth(0.03), seed=1)
        made[method] = rehearse(rig.session(method), rig.measure, rig.operator.key).outcome
    return made


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path))
    return tmp_path / "calibration"


def day(number: int) -> datetime:
    return datetime(2026, 3, number, 12, 0, tzinfo=UTC)


def test_without_a_calibration_it_says_so() -> None:
    with pytest.raises(DataError) as caught:
        storage.load_current()
    assert caught.value.code == "CAL-NONE"
    assert storage.history() == []


@pytest.mark.parametrize("method", ["click", "affine"])
def test_what_was_saved_comes_back(outcomes: dict[str, Outcome], method: str) -> None:
    storage.save(outcomes[method], method, day(1))
    stored, warning = storage.load_current()
    assert warning is None
    assert (stored.method, stored.made) == (method, day(1))
    assert list(stored.lines) == outcomes[method].lines()
    before, after = outcomes[method].calibration, stored.calibration
    if isinstance(before, ProCam):
        assert isinstance(after, ProCam)
        np.testing.assert_array_equal(after.projector.matrix, before.projector.matrix)
        assert after.projector.size == before.projector.size
        for part in ("rotation", "translation"):
            np.testing.assert_array_equal(
                getattr(after.projector_from_camera, part),
                getattr(before.projector_from_camera, part),
            )
    else:
        assert isinstance(before, Planar) and isinstance(after, Planar)
        np.testing.assert_array_equal(after.homography, before.homography)
        assert after.parallax == before.parallax and after.band_m == before.band_m
    for old, new in zip(outcomes[method].placements, stored.placements, strict=True):
        np.testing.assert_array_equal(old.pixels, new.pixels)


def test_the_newest_is_current_and_all_are_kept(outcomes: dict[str, Outcome]) -> None:
    storage.save(outcomes["click"], "click", day(1))
    storage.save(outcomes["affine"], "affine", day(2))
    assert storage.load_current()[0].method == "affine"
    entries = storage.history()
    assert [e.name for e in entries] == ["0002-affine.json", "0001-click.json"]
    assert [e.current for e in entries] == [True, False]


def test_a_clock_that_was_set_back_does_not_change_the_order(outcomes: dict[str, Outcome]) -> None:
    storage.save(outcomes["click"], "click", day(20))
    storage.save(outcomes["affine"], "affine", datetime(1970, 1, 1, tzinfo=UTC))
    assert storage.load_current()[0].name == "0002-affine.json"


def test_rollback_goes_back_one_and_then_another(outcomes: dict[str, Outcome]) -> None:
    for number in (1, 2, 3):
        storage.save(outcomes["click"], "click", day(number))
    assert storage.rollback().made == day(2)
    assert storage.rollback().made == day(1)
    with pytest.raises(DataError) as caught:
        storage.rollback()
    assert caught.value.code == "CAL-ROLLBACK"
    assert storage.load_current()[0].made == day(1)
    storage.save(outcomes["click"], "click", day(4))
    assert storage.load_current()[0].name == "0004-click.json"


def damage_truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:400])


def damage_digit(path: Path) -> None:
    text = path.read_text()
    body = json.loads(text)
    body["content"]["calibration"]["matrix"][0][0] += 1
    path.write_text(json.dumps(body))


def damage_version(path: Path) -> None:
    body = json.loads(path.read_text())
    body["version"] = 99
    path.write_text(json.dumps(body))


def damage_binary(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * 4)


def damage_empty(path: Path) -> None:
    path.write_bytes(b"")


def damage_gone(path: Path) -> None:
    path.unlink()


DAMAGES = [damage_truncate, damage_digit, damage_version, damage_binary, damage_empty, damage_gone]


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_current_one_gives_way_to_the_last_good_one(
    outcomes: dict[str, Outcome], damage
) -> None:  # type: ignore[no-untyped-def]
    storage.save(outcomes["click"], "click", day(1))
    damage(storage.save(outcomes["click"], "click", day(2)))
    stored, warning = storage.load_current()
    assert stored.made == day(1)
    assert warning is not None
    assert warning.startswith("CAL-READ: ")
    assert warning.endswith("0001-click.json of 2026-03-01 12:00, is used.")
    assert "\n" not in warning


@pytest.mark.parametrize("damage", DAMAGES[:-1])
def test_the_only_one_damaged_is_a_clear_error(outcomes: dict[str, Outcome], damage) -> None:  # type: ignore[no-untyped-def]
    path = storage.save(outcomes["click"], "click", day(1))
    damage(path)
    with pytest.raises(DataError) as caught:
        storage.load_current()
    assert caught.value.code == "CAL-READ"
    assert str(path) in str(caught.value)
    assert storage.history()[0].problem is not None


def test_an_older_damaged_one_does_not_matter(outcomes: dict[str, Outcome]) -> None:
    damage_truncate(storage.save(outcomes["click"], "click", day(1)))
    storage.save(outcomes["click"], "click", day(2))
    assert storage.load_current()[1] is None


@pytest.mark.parametrize("pointer", [b"", b"\xff\xfe", b"../../etc/passwd\n"])
def test_a_senseless_pointer_means_the_newest(
    outcomes: dict[str, Outcome], home: Path, pointer: bytes
) -> None:
    storage.save(outcomes["click"], "click", day(1))
    storage.save(outcomes["click"], "click", day(2))
    (home / "current").write_bytes(pointer)
    assert storage.load_current()[0].made == day(2)


def test_another_name_can_be_used_but_only_a_known_one(outcomes: dict[str, Outcome]) -> None:
    for number in (1, 2):
        storage.save(outcomes["click"], "click", day(number))
    storage.use("0001-click.json")
    assert storage.load_current()[0].made == day(1)
    with pytest.raises(DataError) as caught:
        storage.use("../secret.json")
    assert caught.value.code == "CAL-NAME"


def test_a_disk_that_cannot_be_written_leaves_the_current_one(
    outcomes: dict[str, Outcome], monkeypatch: pytest.MonkeyPatch
) -> None:
    storage.save(outcomes["click"], "click", day(1))

    def full(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", full)
        with pytest.raises(HypermaskError) as caught:
            storage.save(outcomes["click"], "click", day(2))
    assert caught.value.code == "DISK-WRITE"
    assert storage.load_current()[0].made == day(1)


def test_progress_is_kept_until_it_is_cleared(home: Path) -> None:
    assert storage.load_progress() is None
    rig = Rig()
    snapshot = rig.session().snapshot()
    storage.save_progress(snapshot)
    assert storage.load_progress() == json.loads(json.dumps(snapshot))
    damage_truncate(home / storage.PROGRESS)
    with pytest.raises(DataError) as caught:
        storage.load_progress()
    assert caught.value.code == "CAL-READ"
    storage.clear_progress()
    assert storage.load_progress() is None
