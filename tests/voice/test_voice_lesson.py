"""An actor's voice is learnt during the show: asked for, recorded, checked, kept, used."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from voice_sounds import WORDS, halves, needs_data, said

from hypermask.voice import recurrent, speaker
from hypermask.voice.calibrate import calibrate, check
from hypermask.voice.follower import basis_shapes
from hypermask.voice.shapes import SHAPE_NAMES, nearest_shape
from hypermask.voice.takes import ASKED, TAKE_S
from hypermask.workers.board import Board
from hypermask.workers.lesson import BAD_S, LEAD_S, MOST_TRIES, VoiceLesson
from hypermask.workers.lesson_record import LESSON_RESULT, LessonState, text_of
from hypermask.workers.voice import VoiceWorker, speaker_in_use
from hypermask_drivers.clock import VirtualClock
from hypermask_sim.devices.sound import SimSoundIn
from hypermask_sim.scenario import Scenario
from hypermask_sim.voice_source import Voice
from hypermask_sim.world import World

RATE = 16_000

pytestmark = needs_data


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path))
    return tmp_path


class Rehearsal:
    """The voice worker on the simulated microphone, and an actor who answers what is asked."""

    def __init__(
        self,
        answer: Callable[[str, int], np.ndarray],
        length_s: float = 60.0,
        in_use: speaker.Speaker | None = None,
        board: Board | None = None,
        **fault: float | str,
    ) -> None:
        """answer: from what is asked and how often it was before to what the actor says."""
        faults = {"faults": [fault]} if fault else {}
        self.world = World(Scenario.model_validate({"duration_s": length_s, **faults}))
        self.sound = np.zeros(round(length_s * RATE), np.float32)
        self.world.__dict__["voice"] = Voice(self.sound, RATE)
        self.clock = VirtualClock()
        self.board = board or Board.local()
        self.events: list[str] = []
        self.worker = VoiceWorker(
            SimSoundIn(self.world, self.clock), self.board, self.clock,
            lambda time_s, code, text: self.events.append(code), speaker=in_use,
        )  # fmt: skip
        self.answer = answer
        self.spoken_s = 0.0
        self._order = 0
        self._asked: dict[str, int] = {}

    def play(self, seconds: float, lesson: VoiceLesson | None = None) -> bool:
        """True while the lesson goes on."""
        until_s = self.clock.now() + seconds
        while self.clock.now() < until_s:
            if lesson is not None and not lesson.step(self.clock.now()):
                return False
            self._act()
            self.clock.sleep_until(self.clock.now() + 0.02)
            while self.worker.step():
                pass
        return True

    def _act(self) -> None:
        order = self.board.lesson.latest()
        if order is None or int(order["order"]) == self._order:
            return
        self._order, asked = int(order["order"]), text_of(order, "asked")
        if asked not in ASKED:
            return
        before = self._asked.get(asked, 0)
        self._asked[asked] = before + 1
        self.spoken_s += TAKE_S
        self.say(self.answer(asked, before), float(order["listen_s"]) + 0.35)

    def say(self, sound: np.ndarray, at_s: float) -> None:
        start = round(at_s * RATE)
        self.sound[start : start + len(sound)] = sound

    def mouths(self, from_s: float, to_s: float) -> np.ndarray:
        """As they stood on the blackboard."""
        chosen = [m.parameters for m in self.worker.history if from_s <= m.time_s < to_s]
        return np.array(chosen)


def examined(rehearsal: Rehearsal, who: str) -> float:
    """Part of the time in which the mouth has the shape of the vowel that is spoken now."""
    right = []
    for vowel in WORDS:
        from_s = rehearsal.clock.now() + 0.5
        rehearsal.say(halves(who, vowel)[1], from_s)
        rehearsal.play(1.6)
        seen = rehearsal.mouths(from_s + 0.12, from_s + 0.56)
        shapes = nearest_shape(seen, basis_shapes()[: len(SHAPE_NAMES)])
        right.append(shapes == SHAPE_NAMES.index(vowel))
    return float(np.mean(np.concatenate(right)))


@cache
def hardest() -> str:
    """Of some people the one who is heard worst, by what he does not say in the lesson."""
    network = recurrent.shipped()

    def heard(who: str) -> float:
        takes = {a: check(a, np.pad(said(who, a), 4800), network) for a in ASKED}
        if any(take.problem for take in takes.values()):
            return 1.0
        result = calibrate(who, takes, network)
        return result.before if result.after > result.before else 1.0

    return min(("m31", "w49", "b08", "w29", "m07"), key=heard)


def teach(rehearsal: Rehearsal, **how: object) -> VoiceLesson:
    lesson = VoiceLesson(rehearsal.board, "anna", by_keys=False, **how)  # type: ignore[arg-type]
    lesson.begin(rehearsal.clock.now())
    assert not rehearsal.play(120.0, lesson)
    return lesson


def test_a_lesson_betters_the_mouth_and_bad_takes_are_asked_for_again() -> None:
    """At first the actor says another vowel, and the third sound so loud that it clips."""
    who = hardest()

    def answer(asked: str, before: int) -> np.ndarray:
        if asked == "a" and before == 0:
            return said(who, "i")
        if asked == "u" and before == 0:
            return np.clip(60 * said(who, "u"), -1, 1)
        return said(who, asked)

    rehearsal = Rehearsal(answer, length_s=90)
    heard_before = examined(rehearsal, who)
    told: list[str] = []
    lesson = teach(rehearsal, say=told.append)
    assert lesson.failure is None and lesson.result is not None
    assert [t.problem for t in lesson.tries if t.asked == "a"] == ["VOICE-WRONG", None]
    assert [t.problem for t in lesson.tries if t.asked == "u"] == ["VOICE-CLIPPED", None]
    assert lesson.result["kept"] and lesson.result["adapted"]
    assert lesson.result["held_out_after"] > lesson.result["held_out_before"]
    heard_after = examined(rehearsal, who)
    assert heard_after > heard_before or heard_after == 1.0
    assert heard_after >= 0.97
    assert speaker.load_current()[0].name == "anna"  # type: ignore[union-attr]
    assert any('That was "i"' in text for text in told)
    assert any("Turn the microphone's gain down" in text for text in told)
    assert rehearsal.events.count("VOICE-LEARNT") == 1


def test_six_good_takes_are_nine_seconds_of_listening() -> None:
    rehearsal = Rehearsal(lambda asked, before: said("w21", asked))
    lesson = teach(rehearsal)
    assert lesson.failure is None
    assert len(lesson.tries) == 6
    assert rehearsal.spoken_s <= 10


def test_the_mouth_goes_on_while_the_voice_is_learnt() -> None:
    rehearsal = Rehearsal(lambda asked, before: said("w21", asked))
    teach(rehearsal)
    times = np.array([frame.time_s for frame in rehearsal.worker.history])
    assert np.diff(times).max() < 0.0101
    opened = [m for m in rehearsal.worker.history if np.abs(m.parameters).max() > 0.2]
    assert len(opened) > 5 * 40


def test_a_voice_that_is_known_already_is_not_learnt_again() -> None:
    first = Rehearsal(lambda asked, before: said("w21", asked))
    assert teach(first).result["kept"]  # type: ignore[index]
    known = speaker_in_use(lambda *said: None)
    again = teach(Rehearsal(lambda asked, before: said("w21", asked), in_use=known))
    assert again.result is not None and not again.result["kept"]
    assert len(list((speaker.folder()).glob("*.npz"))) == 1


def test_another_actor_replaces_the_one_before() -> None:
    teach(Rehearsal(lambda asked, before: said("w21", asked)))
    known = speaker_in_use(lambda *said: None)
    rehearsal = Rehearsal(lambda asked, before: said("m10", asked), in_use=known)
    lesson = VoiceLesson(rehearsal.board, "bert", by_keys=False)
    lesson.begin(0.0)
    rehearsal.play(120, lesson)
    assert lesson.result is not None and lesson.result["kept"]
    assert lesson.result["held_out_after"] >= lesson.result["held_out_before"]
    found, _ = speaker.load_current()
    assert found is not None and found.name == "bert"


# --- led by keys


def keyed(rehearsal: Rehearsal) -> VoiceLesson:
    lesson = VoiceLesson(rehearsal.board, "anna")
    lesson.begin(rehearsal.clock.now())
    return lesson


def test_nothing_is_recorded_before_a_key_is_pressed() -> None:
    rehearsal = Rehearsal(lambda asked, before: said("w21", asked))
    lesson = keyed(rehearsal)
    assert lesson.name == "lesson"
    assert "A key: begin" in lesson.words() and len(lesson.words().splitlines()) <= 2
    assert rehearsal.play(10, lesson)
    assert rehearsal.spoken_s == 0
    lesson.press("enter", rehearsal.clock.now())
    assert rehearsal.play(0.1, lesson)
    assert lesson.words().startswith('1 of 6: Say a long "ah"')
    rehearsal.play(LEAD_S, lesson)
    assert lesson.words().startswith("NOW")


def test_a_lesson_that_is_left_is_over_for_the_voice_as_well() -> None:
    rehearsal = Rehearsal(lambda asked, before: said("w21", asked))
    lesson = keyed(rehearsal)
    lesson.press("1", 0.0)
    rehearsal.play(2.0, lesson)
    lesson.end(rehearsal.clock.now())
    assert not lesson.step(rehearsal.clock.now())
    order = rehearsal.board.lesson.latest()
    assert order is not None and order["asked"] == b"end"
    lesson.end(rehearsal.clock.now())
    assert lesson.failure is not None and lesson.failure.code == "VOICE-STOPPED"


@pytest.mark.parametrize(
    ("key", "after_s"),
    [("minus", 0.0), ("numlock", 0.5), ("minus", 2.0), ("numlock", 4.0), ("minus", 9.0)],
)
def test_minus_stops_it_at_any_time_and_changes_nothing(key: str, after_s: float) -> None:
    rehearsal = Rehearsal(lambda asked, before: said("w21", asked))
    lesson = keyed(rehearsal)
    lesson.press("1", 0.0)
    rehearsal.play(after_s, lesson)
    lesson.press(key, rehearsal.clock.now())
    assert lesson.failure is not None and lesson.failure.code == "VOICE-STOPPED"
    lesson.press("enter", rehearsal.clock.now())
    assert not rehearsal.play(10, lesson)
    rehearsal.play(0.1)
    assert speaker.load_current() == (None, None)
    answer = rehearsal.board.lesson_result.latest()
    assert answer is None or answer["state"] == LessonState.IDLE


def test_backspace_asks_for_the_last_sound_again() -> None:
    rehearsal = Rehearsal(lambda asked, before: said("w21", asked))
    lesson = keyed(rehearsal)
    lesson.press("1", 0.0)
    while not lesson.words().startswith("2 of 6"):
        rehearsal.play(0.02, lesson)
    lesson.press("backspace", rehearsal.clock.now())
    assert lesson.words().startswith("1 of 6")
    while lesson.step(rehearsal.clock.now()):
        rehearsal.play(0.02, lesson)
    assert [one.asked for one in lesson.tries] == ["a", *ASKED]
    assert lesson.result is not None


def test_one_who_cannot_be_heard_is_not_asked_for_ever() -> None:
    mute = Rehearsal(lambda asked, before: np.zeros(0))
    lesson = teach(mute)
    assert lesson.failure is not None and lesson.failure.code == "VOICE-SOFT"
    assert len(lesson.tries) == MOST_TRIES
    by_keys = Rehearsal(lambda asked, before: np.zeros(0))
    stuck = keyed(by_keys)
    stuck.press("1", 0.0)
    assert by_keys.play(MOST_TRIES * (LEAD_S + TAKE_S + BAD_S + 1), stuck)
    assert "A key: again. Minus: stop." in stuck.words()


# --- what goes wrong


def test_a_microphone_that_goes_away_spoils_one_take_only() -> None:
    rehearsal = Rehearsal(
        lambda asked, before: said("w21", asked), kind="sound_lost", from_s=2.0, to_s=2.5
    )
    lesson = teach(rehearsal)
    assert lesson.failure is None
    assert [one.problem for one in lesson.tries[:2]] == ["VOICE-GAP", None]
    assert rehearsal.events[:2] == ["SND-LOST", "SOUND-BACK"]


def test_without_a_voice_worker_the_lesson_ends_and_says_why() -> None:
    board, now_s = Board.local(), 0.0
    lesson = VoiceLesson(board, by_keys=False)
    lesson.begin(now_s)
    while lesson.step(now_s):
        now_s += 0.1
        assert now_s < 5
    assert lesson.failure is not None and lesson.failure.code == "VOICE-DEAF"


def test_two_lessons_at_once_are_refused() -> None:
    rehearsal = Rehearsal(lambda asked, before: said("w21", asked))
    first, second = keyed(rehearsal), VoiceLesson(rehearsal.board, "bert")
    rehearsal.play(1.0, first)
    second.begin(rehearsal.clock.now())
    second.step(rehearsal.clock.now())
    assert second.failure is not None and second.failure.code == "VOICE-LESSON"
    first.press("1", rehearsal.clock.now())
    assert not rehearsal.play(60, first)
    assert first.result is not None


def test_a_lesson_whose_leader_died_is_given_up() -> None:
    rehearsal = Rehearsal(lambda asked, before: said("w21", asked))
    lesson = keyed(rehearsal)
    lesson.press("1", 0.0)
    rehearsal.play(3.0, lesson)
    rehearsal.play(4.0)
    answer = rehearsal.board.lesson_result.latest()
    assert answer is not None and answer["state"] == LessonState.IDLE


def test_a_full_disk_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    from hypermask.errors import HypermaskError

    def full(who: object) -> None:
        raise HypermaskError("DISK-WRITE", "no space", "Free some")

    monkeypatch.setattr(speaker, "save", full)
    rehearsal = Rehearsal(lambda asked, before: said("w21", asked))
    lesson = teach(rehearsal)
    assert lesson.failure is not None and lesson.failure.code == "DISK-WRITE"
    assert rehearsal.events == ["DISK-WRITE"]


def test_records_hold_long_names_and_texts() -> None:
    record = np.zeros((), LESSON_RESULT)
    from hypermask.workers.lesson_record import cut

    record["text"] = cut("ü" * 500, 240)
    assert text_of(record, "text") == "ü" * 120


# --- the speaker in use


def test_nobody_is_in_use_at_first_and_nothing_is_said() -> None:
    told: list[str] = []
    assert speaker_in_use(lambda time_s, code, text: told.append(code)) is None
    assert told == []


def test_a_damaged_calibration_is_reported() -> None:
    path = speaker.save(speaker.unknown("anna"))
    path.write_bytes(b"nothing")
    told: list[tuple[str, str]] = []
    assert speaker_in_use(lambda time_s, code, text: told.append((code, text))) is None
    assert told[0][0] == "VOICE-SPEAKER" and "without calibration" in told[0][1]


def test_a_calibration_for_another_network_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    speaker.save(speaker.unknown("anna"))
    monkeypatch.setattr(speaker, "_network", lambda: "another")
    found, warning = speaker.load_current()
    assert found is None and warning is not None and "another voice network" in warning
