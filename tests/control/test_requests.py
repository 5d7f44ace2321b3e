"""What requests do to the show: the same as keys, and what no key can do."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from show_rig import DEFAULT, Rig

from hypermask.blackboard import Record
from hypermask.errors import ConfigError
from hypermask.neck.record import BEAT_S
from hypermask.show.scene import brightness_at, characters_at
from hypermask.show.showfile import ShowFile, load_show
from hypermask.workers.board import CURTAIN, WARDROBE


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    rig = Rig(tmp_path)
    yield rig
    rig.close()


def scene(rig: Rig) -> Record:
    found = rig.board.scene.latest()
    assert found is not None
    return found


def neck(rig: Rig) -> Record:
    found = rig.board.neck.latest()
    assert found is not None
    return found


def test_a_blackout_is_made_ended_and_toggled(rig: Rig) -> None:
    for to, light in (("on", 0.0), ("on", 0.0), ("off", 1.0), ("toggle", 0.0), ("toggle", 1.0)):
        answer = rig.ask(do="blackout", to=to)
        rig.run(1.0)
        assert brightness_at(scene(rig), rig.clock.now()) == pytest.approx(light)
        assert answer["blackout"] == (light == 0)


def test_a_blackout_by_request_is_ended_by_the_key(rig: Rig) -> None:
    rig.ask(do="blackout", to="on")
    rig.press("enter")
    rig.run(1.0)
    assert brightness_at(scene(rig), rig.clock.now()) == 1.0


def test_the_light_is_set(rig: Rig) -> None:
    rig.ask(do="brightness", level=0.4)
    rig.run(1.0)
    assert brightness_at(scene(rig), rig.clock.now()) == pytest.approx(0.4)


def test_a_key_pressed_by_request_is_a_key(rig: Rig) -> None:
    assert rig.ask(do="press", key="6")["cue"] == "anger"
    assert rig.ask(do="press", key="numlock")["cue"] is None
    assert bytes(scene(rig)["mood"].item()) == b"anger"


def test_a_character_of_the_show_comes(rig: Rig) -> None:
    rig.ask(do="character", name="clown")
    rig.run(1.0)
    assert characters_at(scene(rig), rig.clock.now()) == [("clown", 1.0)]
    rig.ask(do="character", name="next")
    rig.run(1.0)
    assert characters_at(scene(rig), rig.clock.now()) == [("mean", 1.0)]


def test_a_character_that_is_not_in_the_show_is_sent_for(tmp_path: Path) -> None:
    rig = Rig(tmp_path, show=ShowFile(version=1, name="x", characters=("mean",)))
    answer = rig.ask(do="character", name="noh")
    assert "comes in a moment" in answer["text"]
    (order,) = (tmp_path / "board" / "orders").glob("*.json")
    assert json.loads(order.read_text())["character"] == "noh"
    rig.close()


def test_the_head_nods_and_looks(rig: Rig) -> None:
    before = int(neck(rig)["order"])
    rig.ask(do="gesture", name="nod", look=[20, -10])
    told = neck(rig)
    assert int(told["order"]) == before + 1 and bytes(told["gesture"].item()) == b"nod"
    assert (told["pan_rad"], told["tilt_rad"]) == pytest.approx(
        (math.radians(20), -0.1745), abs=1e-4
    )
    rig.ask(do="gesture", name="shake")
    assert float(neck(rig)["pan_rad"]) == pytest.approx(math.radians(20)), (
        "it goes on looking there"
    )


def test_cues_move_the_head(tmp_path: Path) -> None:
    show = ShowFile.model_validate(
        {
            "version": 1, "name": "x", "characters": ["mean"], "keys": {"5": "yes", "6": "left"},
            "cues": {"yes": {"gesture": "nod"}, "left": {"look": [30, 5]}},
        }
    )  # fmt: skip
    rig = Rig(tmp_path, show=show)
    rig.run(0.05)
    rig.press("5")
    assert bytes(neck(rig)["gesture"].item()) == b"nod"
    rig.press("6")
    assert bytes(neck(rig)["gesture"].item()) == b"look"
    assert float(neck(rig)["pan_rad"]) == pytest.approx(math.radians(30))
    rig.close()


def test_a_gesture_that_no_head_can_make_is_refused_in_the_show_file(tmp_path: Path) -> None:
    for line in ('gesture = "dance"', "look = [400.0, 0.0]", "look = [1.0]"):
        path = tmp_path / "show.toml"
        path.write_text(f'version = 1\nname = "x"\ncharacters = ["mean"]\n[cues.a]\n{line}\n')
        with pytest.raises(ConfigError, match=r"CFG-(VALUE|MISSING)"):
            load_show(path)


def test_the_head_always_knows_that_its_master_is_there(rig: Rig) -> None:
    order = int(neck(rig)["order"])
    ages = []
    for _ in range(200):
        rig.run(0.01)
        ages.append(rig.clock.now() - float(neck(rig)["time_s"]))
    assert max(ages) <= BEAT_S + 0.011
    assert int(neck(rig)["order"]) == order, "a beat is no order"


def test_the_cues_are_listed_with_their_keys(rig: Rig) -> None:
    found = rig.ask(do="cues")
    cues = {cue["name"]: cue["key"] for cue in found["cues"]}
    assert cues["blackout"] == "enter" and cues["wink"] == "backspace" and len(cues) == 17
    assert found["characters"] == ["mean", "noh", "kabuki", "clown"]


def test_the_status_says_what_is_seen(rig: Rig) -> None:
    rig.ask(do="cue", name="fear")
    rig.run(1.0)
    found = rig.ask(do="status")
    assert found["scene"] == "mean, fear" and found["blackout"] is False and found["mode"] == ""


# --- reading the show file again ------------------------------------------------------------------


def test_a_changed_show_file_is_taken_over_while_the_face_stays(tmp_path: Path) -> None:
    show = load_show(DEFAULT)
    other = show.model_copy(
        update={
            "name": "other",
            "characters": ("noh", "mean", "kabuki"),
            "keys": {"1": "wink"},
            "cues": {"wink": show.cues["wink"]},
        }
    )
    rig = Rig(tmp_path, reload=lambda: other)
    rig.run(0.05)
    rig.press("5")
    before = scene(rig)
    assert rig.ask(do="reload")["ok"]
    assert scene(rig)["mood"] == before["mood"]
    assert rig.code(do="cue", name="anger") == "CUE-NAME"
    assert rig.ask(do="press", key="1")["cue"] == "wink"
    assert rig.ask(do="cues")["characters"] == ["noh", "mean", "kabuki"]
    rig.close()


def test_a_broken_show_file_changes_nothing(tmp_path: Path) -> None:
    def broken() -> ShowFile:
        raise ConfigError("CFG-SYNTAX", "it is not TOML", "Mend it.")

    rig = Rig(tmp_path, reload=broken)
    assert rig.code(do="reload") == "CFG-SYNTAX"
    assert rig.ask(do="cue", name="anger")["ok"]
    rig.close()


def test_new_characters_of_a_show_file_are_sent_for_and_join(tmp_path: Path) -> None:
    small = ShowFile(version=1, name="x", characters=("mean",), guests=False)
    large = small.model_copy(update={"characters": ("mean", "noh")})
    rig = Rig(tmp_path, show=small, reload=lambda: large)
    assert "noh" in rig.ask(do="reload")["text"]
    assert rig.ask(do="cues")["characters"] == ["mean"], "it cannot be drawn yet"
    dress(rig, "noh", 1)
    rig.run(0.05)
    assert rig.ask(do="cues")["characters"] == ["mean", "noh"]
    rig.close()


def dress(rig: Rig, name: str, version: int, appear: bool = False) -> None:
    """What the dresser and the stage do."""
    wardrobe, curtain = np.zeros((), WARDROBE), np.zeros((), CURTAIN)
    wardrobe["latest"] = curtain["dressed"] = version
    wardrobe["costumes"][version] = (version, name.encode(), b"f", appear, 0.0)
    rig.board.wardrobe.publish(wardrobe)
    rig.board.curtain.publish(curtain)


# --- a show worker that died ----------------------------------------------------------------------


def killed_and_restarted(rig: Rig, after_s: float) -> Rig:
    """The process is gone without a word; another one begins on the same blackboard."""
    for client in list(rig.server._clients):
        client.close()
    rig.server._socket.close()
    return Rig(rig.folder, start_s=rig.clock.now() + after_s)


def test_a_show_worker_that_died_goes_on_where_it_was(rig: Rig) -> None:
    rig.run(0.02)
    for key in ("star", "5", "minus"):
        rig.press(key)
    rig.ask(do="gesture", name="look", look=[15, 0])
    rig.run(2.0)
    before, looking = scene(rig), neck(rig)
    again = killed_and_restarted(rig, 1.0)
    assert scene(again) == before
    assert int(neck(again)["order"]) == int(looking["order"]), "no old gesture is made again"
    assert again.codes == ["SHOW-RESUMED"]
    again.run(0.02)
    again.press("star")
    assert dict(characters_at(scene(again), again.clock.now() + 5)) == {"kabuki": 1.0}
    again.press("enter")
    again.press("enter")
    assert brightness_at(scene(again), again.clock.now() + 5) == pytest.approx(0.9)
    again.close()


def test_a_blackout_survives_the_worker(rig: Rig) -> None:
    rig.ask(do="blackout", to="on")
    again = killed_and_restarted(rig, 0.5)
    assert brightness_at(scene(again), again.clock.now() + 1) == 0
    again.ask(do="blackout", to="off")
    assert brightness_at(scene(again), again.clock.now() + 1) == 1
    again.close()


def test_guests_are_still_there_and_do_not_appear_again(rig: Rig) -> None:
    dress(rig, "anna", 1, appear=True)
    rig.run(2.0)
    assert characters_at(scene(rig), rig.clock.now()) == [("anna", 1.0)]
    rig.ask(do="character", name="noh")
    rig.run(1.0)
    again = killed_and_restarted(rig, 0.5)
    again.run(1.0)
    assert characters_at(scene(again), again.clock.now()) == [("noh", 1.0)]
    assert again.ask(do="character", name="anna")["ok"]
    again.close()


def test_an_old_scene_is_not_gone_on_with_and_the_head_looks_ahead(rig: Rig) -> None:
    rig.ask(do="blackout", to="on")
    rig.ask(do="gesture", name="look", look=[15, 0])
    order = int(neck(rig)["order"])
    again = killed_and_restarted(rig, 60.0)
    assert brightness_at(scene(again), again.clock.now()) == 1.0
    assert int(neck(again)["order"]) != order and float(neck(again)["pan_rad"]) == 0
    again.close()


def test_a_new_show_gives_the_head_an_order_that_it_does_not_know(rig: Rig) -> None:
    """The pan-tilt worker outlives the show's and follows only an order of another number."""
    again = killed_and_restarted(rig, 60.0)
    assert int(neck(again)["order"]) == 2
    again.close()


def test_a_machine_without_a_keypad_is_steered_by_requests(tmp_path: Path) -> None:
    from hypermask.show.engine import ShowEngine
    from hypermask.workers.board import Board
    from hypermask.workers.show import ShowWorker
    from hypermask_drivers.clock import VirtualClock

    clock = VirtualClock(5.0)
    worker = ShowWorker(
        None, ShowEngine(load_show(DEFAULT), 5.0), Board.local(), clock, lambda *said: None
    )
    assert worker.step(0.1) is False
    assert worker.take("5", 5.0) == "happiness"
    worker.stop()
