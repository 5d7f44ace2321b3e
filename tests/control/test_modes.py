"""A mode borrows the keypad: it is begun by a request or a held key, and never ends the show."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from show_rig import Rig

from hypermask.errors import HypermaskError
from hypermask.workers.modes import HELD, HOLD_S


class Lesson:
    """Writes down what happens to it; `lasts_s` long."""

    def __init__(self, name: str = "calibrate", lasts_s: float = 1e9) -> None:
        self.name = name
        self.lasts_s = lasts_s
        self.keys: list[str] = []
        self.text = "Say aaa."
        self.began_s = 0.0
        self.ended = 0
        self.trouble: Exception | None = None

    def begin(self, now_s: float) -> None:
        self.began_s = now_s
        if isinstance(self.trouble, HypermaskError):
            raise self.trouble

    def press(self, key: str, now_s: float) -> None:
        self.keys.append(key)
        if self.trouble is not None:
            raise self.trouble

    def step(self, now_s: float) -> bool:
        return now_s - self.began_s < self.lasts_s

    def words(self) -> str:
        return self.text

    def end(self, now_s: float) -> None:
        self.ended += 1


@pytest.fixture
def made() -> list[Lesson]:
    return []


@pytest.fixture
def rig(tmp_path: Path, made: list[Lesson]) -> Iterator[Rig]:
    def maker(name: str) -> Callable[[], Lesson]:
        def make() -> Lesson:
            made.append(Lesson(name))
            return made[-1]

        return make

    rig = Rig(tmp_path, modes={name: maker(name) for name in ("calibrate", "lesson")})
    rig.run(0.05)
    yield rig
    rig.close()


def words(rig: Rig) -> tuple[str, str]:
    record = rig.board.words.latest()
    assert record is not None
    return bytes(record["mode"].item()).decode(), bytes(record["words"].item()).decode()


def cues(rig: Rig) -> list[str]:
    return [text for code, text in rig.told if code == "CUE"]


@pytest.mark.parametrize(("key", "mode"), HELD.items())
def test_a_key_held_for_three_seconds_begins_its_mode(
    rig: Rig, made: list[Lesson], key: str, mode: str
) -> None:
    rig.hold(key, HOLD_S + 0.3)
    assert rig.ask(do="status")["mode"] == mode
    assert made[0].keys == [], "the key that began it is not pressed in it"
    assert cues(rig) == [], "holding a key calls no cue"


def test_it_begins_while_the_key_is_still_held(rig: Rig, made: list[Lesson]) -> None:
    began_s = rig.clock.now()
    rig.hold("numlock", 10.0)
    assert made[0].began_s - began_s == pytest.approx(HOLD_S, abs=0.05)
    assert len(made) == 1


def test_a_short_press_of_such_a_key_calls_its_cue(rig: Rig, made: list[Lesson]) -> None:
    rig.press("slash")
    rig.hold("slash", HOLD_S - 0.2)
    assert cues(rig) == ["Key slash: character-previous"] * 2 and not made


def test_holding_it_again_leaves_the_mode(rig: Rig, made: list[Lesson]) -> None:
    rig.hold("numlock", HOLD_S + 0.2)
    rig.hold("numlock", HOLD_S + 0.2)
    assert rig.ask(do="status")["mode"] == "" and made[0].ended == 1 and len(made) == 1
    assert made[0].keys == []


def test_every_key_goes_to_the_mode(rig: Rig, made: list[Lesson]) -> None:
    rig.ask(do="mode", action="begin", name="lesson")
    for key in ("5", "enter", "slash", "numlock"):
        rig.press(key)
    rig.ask(do="press", key="7")
    rig.ask(do="mode", action="press", key="8")
    assert made[0].keys == ["5", "enter", "slash", "numlock", "7", "8"]
    assert cues(rig) == []
    rig.ask(do="mode", action="cancel")
    rig.press("5")
    assert cues(rig) == ["Key 5: happiness"]


def test_its_words_are_published_and_written_down(rig: Rig, made: list[Lesson]) -> None:
    answer = rig.ask(do="mode", action="begin", name="lesson")
    assert (answer["mode"], answer["words"]) == ("lesson", "Say aaa.")
    assert words(rig) == ("lesson", "Say aaa.")
    made[0].text = "Say iii.\nLouder."
    rig.run(1.5)
    assert words(rig) == ("lesson", "Say iii.\nLouder.")
    assert ("MODE-WORDS", "Say iii. Louder.") in rig.told
    rig.ask(do="mode", action="cancel")
    assert words(rig) == ("", "")


def test_words_that_change_all_the_time_do_not_fill_the_journal(
    rig: Rig, made: list[Lesson]
) -> None:
    rig.ask(do="mode", action="begin", name="lesson")
    for number in range(300):
        made[0].text = f"{number} to go"
        rig.run(0.01)
    assert words(rig)[1] == "299 to go"
    assert rig.codes.count("MODE-WORDS") <= 5


def test_words_too_long_are_cut_between_characters(rig: Rig, made: list[Lesson]) -> None:
    rig.ask(do="mode", action="begin", name="lesson")
    made[0].text = "a" + "ä" * 200
    rig.run(0.05)
    assert words(rig)[1] == "a" + "ä" * 79


def test_a_mode_that_is_over_gives_the_keys_back(rig: Rig, made: list[Lesson]) -> None:
    rig.ask(do="mode", action="begin", name="lesson")
    made[0].lasts_s = 1.0
    rig.run(2.0)
    assert rig.ask(do="status")["mode"] == "" and made[0].ended == 1
    assert rig.codes.count("MODE-ON") == rig.codes.count("MODE-OFF") == 1


@pytest.mark.parametrize(
    ("trouble", "code"),
    [
        (HypermaskError("CAL-LOST", "the mask is gone", "Bring it back."), "CAL-LOST"),
        (ValueError("oops"), "MODE-FAILED"),
    ],
)
def test_a_mode_that_fails_is_left_with_one_message_and_the_show_goes_on(
    rig: Rig, made: list[Lesson], trouble: Exception, code: str
) -> None:
    rig.ask(do="mode", action="begin", name="lesson")
    made[0].trouble = trouble
    rig.press("5")
    rig.press("6")
    assert rig.codes.count(code) == 1 and made[0].ended == 1
    assert cues(rig) == ["Key 6: anger"]


def test_a_mode_that_cannot_begin_is_not_entered(tmp_path: Path) -> None:
    lesson = Lesson("lesson")
    lesson.trouble = HypermaskError("VOICE-NONE", "there is no microphone", "Plug it in.")
    rig = Rig(tmp_path, modes={"lesson": lambda: lesson})
    rig.run(0.05)
    assert rig.code(do="mode", action="begin", name="lesson") == "VOICE-NONE"
    rig.hold("slash", HOLD_S + 0.2)
    assert rig.codes == ["VOICE-NONE"] and rig.ask(do="status")["mode"] == ""
    rig.close()


def test_one_mode_at_a_time(rig: Rig, made: list[Lesson]) -> None:
    rig.ask(do="mode", action="begin", name="lesson")
    assert rig.code(do="mode", action="begin", name="calibrate") == "MODE-BUSY"
    assert len(made) == 1


def test_a_keypad_that_vanishes_while_a_key_is_held_begins_nothing(tmp_path: Path) -> None:
    rig = Rig(
        tmp_path,
        modes={"calibrate": lambda: Lesson()},
        faults=({"kind": "keypad_unplugged", "from_s": 1.0, "to_s": 2.5},),
    )
    rig.run(0.5)
    rig.hold("numlock", 10.0)
    assert rig.ask(do="status")["mode"] == ""
    assert rig.codes == ["KEY-LOST", "KEYPAD-BACK"]
    rig.close()


def test_a_worker_that_was_held_up_does_not_take_a_press_for_a_hold(
    rig: Rig, made: list[Lesson]
) -> None:
    rig.keypad.press("slash")
    rig.clock.sleep_until(rig.clock.now() + 20.0)  # SIGSTOP, SIGCONT
    rig.run(0.05)
    assert not made and cues(rig) == ["Key slash: character-previous"]


def test_the_show_ends_its_mode_when_it_stops(rig: Rig, made: list[Lesson]) -> None:
    rig.ask(do="mode", action="begin", name="lesson")
    rig.worker.stop()
    assert made[0].ended == 1 and words(rig) == ("", "")


def test_without_modes_these_keys_act_at_once(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.run(0.05)
    rig.keypad.press("slash")
    rig.run(0.02)
    assert cues(rig) == ["Key slash: character-previous"]
    rig.close()
