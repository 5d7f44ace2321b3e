"""A photograph handed in during a show becomes a character on the mask; the show goes on."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hypermask import paths
from hypermask.bench.runs import scenario
from hypermask.errors import HypermaskError
from hypermask.rehearsal.lockstep import Flip
from hypermask.rehearsal.run import Rehearsal
from hypermask.rehearsal.visitors import keep_characters
from hypermask.workers import orders
from hypermask_sim.scenario import Scenario

FACES = Path(__file__).parents[2].parent / "shared" / "data" / "faces"
MODELS = paths.models() / "face_landmark.onnx"

pytestmark = [
    pytest.mark.skipif(not FACES.is_dir(), reason="../shared/data/faces is absent"),
    pytest.mark.skipif(not MODELS.is_file(), reason="the face models are absent: make models"),
]


def show(*assignments: str) -> Scenario:
    return scenario("reference-cart", "character=mean", "calibration.method=exact", *assignments)


def photo(number: int = 7) -> Path:
    return sorted(FACES.glob("*.jpg"))[number]


def play(of: Scenario, out: Path) -> tuple[list[Flip], Any]:
    rehearsal = Rehearsal(of)
    try:
        flips = [flip for flip in rehearsal.lockstep.play(float(of.duration_s or 0)) if flip]
        for flip in flips:
            rehearsal.arrivals.look(flip.picture.items, flip.picture.light_s)
        keep_characters(rehearsal.lockstep.board.folder, out)
        return flips, rehearsal
    finally:
        rehearsal.close()


def lit(flip: Flip) -> np.ndarray:
    """The mean colour of what is lit."""
    bright = flip.shown[flip.shown.max(axis=2) > 40]
    return np.asarray(bright.mean(axis=0))


def test_the_visitors_face_comes_by_a_cross_fade_within_the_second(tmp_path: Path) -> None:
    of = show(f'performer.photos=[[0.3, "{photo()}", "visitor"]]', "duration_s=1.9")
    flips, rehearsal = play(of, tmp_path)
    arrival = rehearsal.arrivals.report(0.0)[0]
    assert 0 < arrival["photo_to_light_s"] <= 1.0
    assert all(len(flip.shown[flip.shown > 60]) > 1000 for flip in flips[6:]), "never dark"
    colours = np.array([lit(flip) for flip in flips[6:]])
    assert np.abs(np.diff(colours, axis=0)).max() < 6, "no flash from flip to flip"
    assert np.abs(colours[-1] - colours[9]).max() > 3, "another face"
    assert (tmp_path / "characters" / "visitor" / "texture.png").is_file()
    assert [event.code for event in rehearsal.journal.events].count("CHAR-JOINS") == 1


def test_a_bad_photograph_is_told_and_the_show_stays_as_it_is(tmp_path: Path) -> None:
    bad = tmp_path / "bad.jpg"
    bad.write_bytes(b"\xff\xd8 this is no picture")
    with_it = show(f'performer.photos=[[0.1, "{bad}", "visitor"]]', "duration_s=0.8")
    flips, rehearsal = play(with_it, tmp_path)
    alone, _ = play(show("duration_s=0.8"), tmp_path)
    assert [event.code for event in rehearsal.journal.events].count("PHOTO-FORMAT") == 1
    for one, other in zip(flips, alone, strict=True):
        np.testing.assert_array_equal(one.shown, other.shown)


def test_the_same_name_again_changes_the_face_in_place(tmp_path: Path) -> None:
    photos = f'[[0.1, "{photo(3)}", "guest"], [1.6, "{photo(60)}", "guest"]]'
    flips, rehearsal = play(show(f"performer.photos={photos}", "duration_s=2.4"), tmp_path)
    keys = [{item.key for item in flip.picture.items} for flip in flips]
    assert keys[-1] == {"guest"}
    assert np.abs(lit(flips[-1]) - lit(flips[95])).max() > 2
    assert rehearsal.arrivals.report(0.0)[0]["photo_to_alone_s"] < 1.5


def test_even_the_first_character_of_the_show_can_be_made_anew(tmp_path: Path) -> None:
    photos = f'[[0.1, "{photo(3)}", "mean"], [0.5, "{photo(60)}", "other"]]'
    flips, _ = play(show(f"performer.photos={photos}", "duration_s=2.2"), tmp_path)
    assert {item.key for item in flips[-1].picture.items} == {"other"}
    assert np.abs(lit(flips[45]) - lit(flips[9])).max() > 2
    assert all(len(flip.shown[flip.shown > 60]) > 1000 for flip in flips[6:]), "never dark"


def test_a_photograph_that_is_not_there_is_told_before_the_show(tmp_path: Path) -> None:
    with pytest.raises(HypermaskError) as caught:
        Rehearsal(show('performer.photos=[[1.0, "/nowhere.jpg", "x"]]'))
    assert caught.value.code == "PHOTO-ABSENT"
    with pytest.raises(HypermaskError) as caught:
        Rehearsal(show(f'performer.photos=[[1.0, "{photo()}", "no name"]]'))
    assert caught.value.code == "CHAR-NAME"
    dots = scenario("reference-cart", f'performer.photos=[[1.0, "{photo()}", "x"]]')
    with pytest.raises(HypermaskError) as caught:
        Rehearsal(dots)
    assert caught.value.code == "CFG-VALUE"


def test_orders_are_taken_in_turn_and_answered(tmp_path: Path) -> None:
    first = orders.place(tmp_path, orders.Order(name="a", photo="/a.jpg"))
    second = orders.place(tmp_path, orders.Order(name="b", photo="/b.jpg"))
    found = orders.oldest(tmp_path)
    assert found is not None and found[0] == first and found[1].name == "a"
    assert orders.outcome(tmp_path, first) is None
    orders.answer(tmp_path, first, {"name": "a"})
    assert orders.outcome(tmp_path, first) == {"name": "a"}
    found = orders.oldest(tmp_path)
    assert found is not None and found[0] == second


def test_a_photograph_goes_with_its_order_and_away_with_it(tmp_path: Path) -> None:
    """The dresser sees nothing of the technician's folders."""
    order = orders.Order(name="guest", source="me.jpg")
    number = orders.place(tmp_path, order, b"a picture")
    found = orders.oldest(tmp_path)
    assert found is not None
    assert Path(str(found[1].photo)).read_bytes() == b"a picture" and found[1].source == "me.jpg"
    orders.answer(tmp_path, number, {"name": "guest"})
    assert [path.suffix for path in tmp_path.iterdir()] == [".done"]


def test_a_photograph_whose_order_has_no_room_does_not_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = orders.write_atomically

    def full(path: Path, data: bytes) -> None:
        if path.suffix == ".json":
            raise HypermaskError("DISK-WRITE", "the disk is full", "Free some space.")
        write(path, data)

    monkeypatch.setattr(orders, "write_atomically", full)
    with pytest.raises(HypermaskError):
        orders.place(tmp_path, orders.Order(name="guest"), b"a picture")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["", "{", "[]", '{"photo": 3}', '{"name": "a", "age": 3}'])
def test_an_order_that_cannot_be_read_is_answered_and_left_out(tmp_path: Path, text: str) -> None:
    (tmp_path / "0-x.json").write_text(text)
    number = orders.place(tmp_path, orders.Order(name="a", photo="/a.jpg"))
    found = orders.oldest(tmp_path)
    assert found is not None and found[0] == number
    told = orders.outcome(tmp_path, "0-x")
    assert told is not None and told["error"] == "ORDER-READ"
    assert json.dumps(told)


def test_an_order_that_nobody_can_be_told_of_is_not_done_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    number = orders.place(tmp_path, orders.Order(name="a", photo="/a.jpg"))

    def full(path: Path, data: bytes) -> None:
        raise HypermaskError("DISK-WRITE", "the disk is full", "Free some space.")

    monkeypatch.setattr(orders, "write_atomically", full)
    with pytest.raises(HypermaskError):
        orders.answer(tmp_path, number, {})
    assert orders.oldest(tmp_path) is None


def test_a_character_that_is_made_already_can_be_ordered(tmp_path: Path) -> None:
    from hypermask.face.character import find_character
    from hypermask.mask import load_mask
    from hypermask.workers.board import Board
    from hypermask.workers.dresser import Dresser
    from hypermask_drivers.clock import VirtualClock

    shutil.copytree(find_character("noh"), tmp_path / "made" / "noh")
    board = Board.local(tmp_path / "board")
    mask = load_mask(paths.configs() / "masks" / "reference")
    told: list[str] = []
    dresser = Dresser(
        board, tmp_path, mask, VirtualClock(), lambda _, code, text: told.append(code)
    )
    made = str(tmp_path / "made" / "noh")
    number = orders.place(dresser.orders, orders.Order(name="guest", character=made))
    assert dresser.step() and not told
    assert orders.outcome(dresser.orders, number) == {"name": "noh"}
    record = board.wardrobe.latest()
    assert record is not None and int(record["latest"]) == 1
    for wrong in (orders.Order(name="g"), orders.Order(name="g", photo="a", character="b")):
        orders.place(dresser.orders, wrong)
        dresser.step()
    assert told == ["ORDER-READ", "ORDER-READ"]


def test_a_stage_without_spare_time_still_gets_its_guest_dressed(tmp_path: Path) -> None:
    of = show(f'performer.photos=[[0.1, "{photo()}", "visitor"]]', "duration_s=1.6")
    rehearsal = Rehearsal(of)
    wings = rehearsal.lockstep.wings
    work = wings.work
    wings.work = lambda now_s, spare_s: work(now_s, -1.0)  # type: ignore[method-assign]
    for _ in rehearsal.lockstep.play(1.6):
        pass
    assert [event.code for event in rehearsal.journal.events].count("CHAR-JOINS") == 1
    rehearsal.close()
