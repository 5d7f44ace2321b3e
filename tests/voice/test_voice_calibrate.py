"""Ten seconds of an actor's voice: every take is checked, and calibration may only help."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner
from voice_sounds import DATA, WORDS, at_level, needs_data, noise, recorded, silence, spoken

from hypermask.cli.voice import app
from hypermask.errors import DataError
from hypermask.voice import recurrent, speaker
from hypermask.voice.calibrate import calibrate, check
from hypermask.voice.evaluate import evaluate_calibrated, evaluate_default
from hypermask.voice.follower import MouthFollower
from hypermask.voice.settings import VoiceSettings
from hypermask.voice.takes import ASKED, TAKE_S
from hypermask.voice.vowels import one_each, read_table, read_vowel

NETWORK = recurrent.shipped()


def take(asked: str, who: str = "w21") -> np.ndarray:
    """The vowel of a recorded word, held a little longer; or the room."""
    if asked == "silence":
        return noise(1.0, -70).astype(float)
    word = recorded(who, WORDS[asked])
    nucleus = word.samples[word.start : word.end]
    return np.concatenate([np.zeros(3200), nucleus, nucleus[::-1], np.zeros(3200)])


def takes(who: str = "w21"):
    return {asked: check(asked, take(asked, who), NETWORK) for asked in ASKED}


def problem(asked, sound):
    found = check(asked, np.asarray(sound, float), NETWORK).problem
    return found and found[0]


def test_it_takes_no_more_than_ten_seconds():
    assert len(ASKED) * TAKE_S <= 10


@needs_data
def test_good_takes_are_accepted():
    assert {asked: one.problem for asked, one in takes().items()} == dict.fromkeys(ASKED)


@needs_data
def test_each_bad_take_is_told_apart():
    good = take("a")
    assert problem("a", at_level(good, -65.0)) == "VOICE-SOFT"
    assert problem("a", np.clip(30 * good, -1, 1)) == "VOICE-CLIPPED"
    assert problem("a", good[:3000]) == "VOICE-SHORT"
    assert problem("i", good) == "VOICE-WRONG"
    assert problem("silence", good) == "VOICE-NOT-SILENT"


@needs_data
def test_wrong_vowels_are_refused_and_right_ones_are_not():
    """Of twenty people, among them those who are heard worst."""
    heard_badly = ("m17", "w32", "m31", "m47", "w49", "m14", "m13", "b08", "g20", "w29", "m09")
    who = (*heard_badly, "w02", "g04", "g18", "m10", "w21", "b12", "g05", "m01", "w06")
    passed = {
        (name, asked, said): check(asked, take(said, name), NETWORK).problem is None
        for name in who
        for asked, said in [(a, a) for a in "aiueo"] + ["ai", "ia", "ua", "eo", "au", "oi"]
    }
    right = [ok for (_, asked, said), ok in passed.items() if asked == said]
    wrong = [ok for (_, asked, said), ok in passed.items() if asked != said]
    assert np.mean(right) >= 0.95
    assert np.mean(wrong) <= 0.10


@needs_data
def test_running_speech_is_no_vowel():
    from hypermask.voice.wav import read_wav

    speech, _ = read_wav(DATA / "speech" / "austen-0870.wav")
    windows = [speech[at : at + 24_000] for at in range(8_000, len(speech) - 24_000, 8_000)]
    taken = [problem(asked, window) is None for window in windows for asked in "aiueo"]
    assert np.mean(taken) <= 0.1


@needs_data
def test_who_insists_on_a_vowel_is_believed_sooner_but_not_any_sound():
    assert check("i", take("a"), NETWORK, insists=True).problem[0] == "VOICE-WRONG"
    people = ("m14", "m49", "m47", "m13")
    pairs = [(who, vowel) for who in people for vowel in "aiueo"]
    plain = [check(v, take(v, who), NETWORK).problem is None for who, v in pairs]
    insisted = [check(v, take(v, who), NETWORK, insists=True).problem is None for who, v in pairs]
    assert sum(insisted) >= sum(plain)


def test_what_is_no_voice_is_no_vowel():
    assert problem("a", noise(1.5, -25)) == "VOICE-NOT-VOWEL"
    assert problem("a", silence(1.5)) == "VOICE-SOFT"
    assert problem("a", np.full(24_000, np.nan)) == "VOICE-SOFT"
    assert problem("a", []) == "VOICE-SHORT"
    with pytest.raises(DataError, match=r"VOICE-TAKE.*'y'"):
        check("y", spoken("a", 1.0), NETWORK)


@needs_data
def test_a_bad_or_missing_take_stops_the_calibration():
    six = takes()
    with pytest.raises(DataError, match=r"VOICE-WRONG.*'i'"):
        calibrate("me", {**six, "i": check("i", take("a"), NETWORK)}, NETWORK)
    del six["o"]
    with pytest.raises(DataError, match=r"VOICE-TAKE.*'o' is missing"):
        calibrate("me", six, NETWORK)


@needs_data
@pytest.mark.parametrize("who", ["m10", "g05"])
def test_the_held_out_half_decides(who):
    result = calibrate("me", takes(who), NETWORK)
    assert result.after >= result.before
    assert result.adapted == bool(np.any(result.speaker.correction))
    assert result.speaker.paper_net is not None


@needs_data
def test_calibrated_speakers_are_heard_no_worse():
    table = DATA / "vowels" / "vowels.csv"
    who = {"m13", "w06", "b12", "g06"}
    rows = [row for row in one_each(read_table(table)) if row["speaker"] in who]
    vowels = [read_vowel(table, row) for row in rows]
    before = evaluate_default(vowels, NETWORK)["frame_accuracy"]
    assert evaluate_calibrated(vowels, NETWORK)["frame_accuracy"] >= before


# --- what is kept


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("HYPERMASK_HOME", str(tmp_path))
    return tmp_path


def somebody(name: str, size: float = 0.1) -> speaker.Speaker:
    nobody = speaker.unknown(name)
    return speaker.Speaker(name, "m01", nobody.correction + np.float32(size))


def test_nobody_is_known_at_first(home):
    assert speaker.load_current() == (None, None)


def test_the_last_calibrated_speaker_is_used(home):
    for name in ("anna", "bert"):
        speaker.save(somebody(name))
    found, warning = speaker.load_current()
    assert (found.name, found.paper_net, warning) == ("bert", "m01", None)
    np.testing.assert_array_equal(found.correction, somebody("bert").correction)
    speaker.forget()
    assert speaker.load_current() == (None, None)


@pytest.mark.parametrize("keep", [0, 100, -30])
def test_a_damaged_file_gives_way_to_the_last_good_one_and_is_named(home, keep):
    speaker.save(somebody("anna"))
    damaged = speaker.save(somebody("bert"))
    damaged.write_bytes(damaged.read_bytes()[:keep])
    found, warning = speaker.load_current()
    assert found.name == "anna"
    assert "VOICE-SPEAKER" in warning
    assert damaged.name in warning


def test_where_no_file_is_good_the_voice_is_followed_without(home):
    path = speaker.save(somebody("anna"))
    path.write_bytes(b"nothing")
    found, warning = speaker.load_current()
    assert found is None
    assert "without calibration" in warning


def test_an_altered_number_is_found_out(home, monkeypatch):
    monkeypatch.setattr(speaker, "_digest", lambda correction: "another")
    path = speaker.save(somebody("anna"))
    monkeypatch.undo()
    with pytest.raises(DataError, match=r"VOICE-SPEAKER.*check sum"):
        speaker.load(path)


def test_no_correction_changes_nothing_and_any_other_does():
    sound = np.r_[silence(0.2), spoken("a", 0.3)]
    plain, unknown, other = (
        MouthFollower(16_000, VoiceSettings(), who).feed(sound, 0.0)[-5].parameters
        for who in (None, speaker.unknown(), somebody_else())
    )
    np.testing.assert_array_equal(plain, unknown)
    assert np.abs(plain - other).max() > 0.1


def somebody_else() -> speaker.Speaker:
    correction = speaker.unknown().correction.copy()
    correction[-1, 0] = 20.0  # hears silence in everything
    return speaker.Speaker("mute", None, correction)


# --- the command


def write_wav(path, sound):
    import wave

    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(16_000)
        file.writeframes((np.clip(sound, -1, 1) * 32767).astype("<i2").tobytes())
    return str(path)


@needs_data
def test_the_command_calibrates_and_keeps(home, tmp_path):
    paths = [write_wav(tmp_path / f"{asked}.wav", take(asked)) for asked in ASKED]
    done = CliRunner().invoke(app, ["calibrate", *paths, "--name", "anna", "--json"])
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert result["held_out_after"] >= result["held_out_before"]
    assert speaker.load_current()[0].name == "anna"


@needs_data
def test_the_command_names_what_is_wrong_and_keeps_nothing(home, tmp_path):
    paths = [write_wav(tmp_path / f"{asked}.wav", take(asked)) for asked in ASKED]
    done = CliRunner().invoke(app, ["calibrate", *paths[:5]])
    assert "VOICE-TAKES" in done.output
    done = CliRunner().invoke(app, ["calibrate", paths[1], paths[0], *paths[2:]])
    assert done.exit_code != 0
    assert "VOICE-WRONG" in done.output
    assert speaker.load_current() == (None, None)
