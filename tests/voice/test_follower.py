"""The mouth follows the voice, whatever arrives."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from voice_sounds import DATA, FORMANTS, at_level, needs_data, noise, recorded, silence, spoken

from hypermask.voice.follower import MouthFollower, MouthFrame
from hypermask.voice.resample import resample
from hypermask.voice.settings import VoiceSettings
from hypermask.voice.shapes import (
    CLOSED,
    SHAPE_NAMES,
    Interpolation,
    nearest_shape,
    reference_shapes,
)
from hypermask.voice.wav import read_wav

SHAPES = reference_shapes()


def follow(sound, rate_hz=16_000, block=160, start_s=0.0, **settings) -> list[MouthFrame]:
    follower = MouthFollower(rate_hz, VoiceSettings(**settings))
    frames = []
    for at in range(0, len(sound), block):
        frames += follower.feed(sound[at : at + block], start_s + at / rate_hz)
    return frames


def opening(frames: list[MouthFrame]) -> np.ndarray:
    """0 for the closed mouth, 1 for a whole vowel."""
    parameters = np.array([frame.parameters for frame in frames])
    return 1.0 - Interpolation(SHAPES).linear(parameters)[:, CLOSED]


def during(frames: list[MouthFrame], begin_s: float, end_s: float) -> list[MouthFrame]:
    return [frame for frame in frames if begin_s <= frame.time_s < end_s]


# --- what it does


def test_the_mouth_opens_for_a_voice_and_shuts_after_it():
    frames = follow(np.concatenate([silence(0.3), spoken("a", 0.4), silence(0.4)]))
    assert opening(during(frames, 0.0, 0.27)).max() < 0.01
    assert opening(during(frames, 0.4, 0.65)).min() > 0.5
    assert opening(during(frames, 0.9, 1.1)).max() < 0.01


@needs_data
@pytest.mark.parametrize("speaker", ["m10", "w10", "b10", "g10"])
@pytest.mark.parametrize(("vowel", "mouth"), [("ah", "a"), ("iy", "i"), ("uw", "u")])
def test_a_recorded_vowel_makes_its_mouth(speaker, vowel, mouth):
    spoken_vowel = recorded(speaker, vowel)
    frames = follow(spoken_vowel.samples)
    middle = (spoken_vowel.start + spoken_vowel.end) / 2 / 16_000
    seen = np.mean([f.parameters for f in during(frames, middle - 0.03, middle + 0.03)], axis=0)
    assert SHAPE_NAMES[nearest_shape(seen[None], SHAPES)[0]] == mouth


@pytest.mark.parametrize("level_db", [-80.0, -60.0, -40.0, -25.0])
def test_steady_noise_of_the_stage_leaves_the_mouth_shut(level_db):
    frames = follow(noise(3.0, level_db))
    assert opening(during(frames, 1.0, 3.0)).max() < 0.1


def test_noise_that_sets_in_is_learnt_in_seconds():
    frames = follow(np.r_[noise(1.0, -60), noise(4.0, -25, slope=0.5, seed=1)])
    assert opening(during(frames, 4.3, 5.0)).max() < 0.1


def test_a_voice_is_followed_above_noise():
    sound = noise(3.0, -45)
    sound[32_000:40_000] += spoken("a", 0.5, level_db=-20)
    frames = follow(sound)
    assert opening(during(frames, 2.1, 2.4)).min() > 0.3
    assert opening(during(frames, 2.75, 3.0)).max() < 0.1


def test_a_long_note_holds_the_mouth_open():
    frames = follow(np.concatenate([silence(0.2), spoken("a", 6.0)]))
    assert opening(during(frames, 0.5, 6.0)).min() > 0.5


def test_a_softer_voice_opens_it_less():
    sound = np.concatenate([spoken("a", 1.0, level_db=-20), spoken("a", 0.3, level_db=-36)])
    frames = follow(np.concatenate([silence(0.2), sound]))
    loud, soft = (opening(during(frames, *when)).mean() for when in ((0.6, 1.1), (1.35, 1.45)))
    assert 0.02 < soft < 0.6 * loud


def test_the_gain_of_the_microphone_is_learnt():
    voice = np.concatenate([np.tile(np.r_[spoken("a", 0.4), silence(0.2)], 10)])
    for gain_db in (-45.0, -6.0):
        frames = follow(at_level(voice, gain_db))
        assert np.percentile(opening(during(frames, 4.0, 6.0)), 60) > 0.6


def test_after_a_scream_the_usual_voice_soon_opens_the_mouth_again():
    usual = np.tile(np.r_[spoken("a", 0.4, level_db=-25), silence(0.1)], 8)
    scream = spoken("a", 1.0, level_db=-6)
    frames = follow(np.r_[silence(0.2), usual, scream, usual])
    assert np.percentile(opening(during(frames, 7.2, 9.2)), 50) > 0.5


def test_it_does_not_chatter():
    """Held vowels in noise: between two frames of 10 ms the opening moves by next to nothing."""
    sound = np.concatenate([spoken(vowel, 0.5) for vowel in FORMANTS]) + noise(1.5, -45)
    frames = follow(sound)
    steps = np.abs(np.diff(opening(during(frames, 0.1, 1.4))))
    assert steps.max() < 0.35  # no lips open or shut in less than 30 ms
    for begin in (0.1, 0.6, 1.1):  # where one vowel is cut to the next, a closure may be heard
        assert np.abs(np.diff(opening(during(frames, begin, begin + 0.35)))).mean() < 0.005


@needs_data
def test_read_sentences_open_on_vowels_and_shut_in_pauses():
    import json

    sound, rate_hz = read_wav(DATA / "speech" / "austen-0890.wav")
    sentence = json.loads((DATA / "speech" / "austen-0890.phone.json").read_text())
    phones = [phone for word in sentence["w"] for phone in word.get("w", [])]
    frames = follow(sound, rate_hz)

    def at(labels: set[str], after: float = 0.0) -> np.ndarray:
        """Where phones are spoken that last longer than `after`, from so long after their begin."""
        spans = [(p["b"] + after, p["b"] + p["d"]) for p in phones if p["t"] in labels]
        spans = [span for span in spans if span[1] > span[0]]
        return np.concatenate([opening(during(frames, *span)) for span in spans])

    vowels = at({"AA", "AE", "AO", "AW", "AY", "EH", "EY", "IY", "OW", "UW"})
    assert np.mean(vowels > 0.3) > 0.8
    assert np.mean(at({"SIL"}, after=0.05) > 0.15) < 0.05  # lips take a moment to close


def test_paper_mode_gives_a_mouth_each_32_ms_as_the_network_says():
    frames = follow(np.concatenate([silence(0.2), spoken("a", 0.5)]), mode="paper")
    assert np.diff([frame.time_s for frame in frames]) == pytest.approx(0.032)
    assert opening(during(frames, 0.0, 0.17)).max() < 0.01
    assert opening(during(frames, 0.25, 0.65)).min() > 0.5


# --- time


@pytest.mark.parametrize("rate_hz", [16_000, 44_100, 48_000, 192_000])
def test_a_frame_bears_the_time_of_its_middle(rate_hz):
    click = np.zeros(rate_hz, np.float32)
    click[rate_hz // 2] = 1.0
    frames = follow(click, rate_hz, block=rate_hz // 100, start_s=1000.0)
    loudest = max(frames, key=lambda frame: frame.level_db)
    assert loudest.time_s == pytest.approx(1000.5, abs=0.006)
    assert np.diff([frame.time_s for frame in frames]) == pytest.approx(0.010, abs=1e-6)


def test_a_frame_comes_as_soon_as_its_sound_is_there():
    follower = MouthFollower(48_000)
    for at in range(0, 48_000, 48):
        for frame in follower.feed(np.zeros(48, np.float32), at / 48_000):
            assert (at + 48) / 48_000 - frame.time_s <= follower.latency_s + 0.0011
    assert follower.latency_s < 0.018


@pytest.mark.parametrize("rate_hz", [16_000, 44_100])
def test_the_blocks_sizes_make_no_difference(rate_hz):
    sound = spoken("i", 0.5, rate_hz)
    one, many = follow(sound, rate_hz, block=10**6), follow(sound, rate_hz, block=37)
    assert len(one) == len(many)
    for a, b in zip(one, many, strict=True):
        np.testing.assert_allclose(a.parameters, b.parameters, atol=1e-9)
        assert a.time_s == pytest.approx(b.time_s, abs=1e-9)


def test_the_time_stamps_of_the_blocks_are_followed_so_that_nothing_creeps():
    """A sound card that runs 200 ppm fast: after a minute its frames are still on time."""
    follower = MouthFollower(16_000)
    for block in range(600):
        true_s = block * 0.1 * (1 - 200e-6)
        frames = follower.feed(np.zeros(1600, np.float32), true_s)
        assert all(true_s - 0.035 < frame.time_s < true_s + 0.1 for frame in frames)


# --- whatever arrives


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf, 3e38])
def test_broken_samples_do_no_harm(broken):
    follower = MouthFollower(16_000)
    follower.feed(spoken("a", 0.3), 0.0)
    rubbish = np.full(8000, broken, np.float32)
    frames = follower.feed(rubbish, 0.3)
    frames += follower.feed(np.concatenate([silence(0.3), spoken("a", 0.4)]), 0.8)
    assert all(np.isfinite([*frame.parameters, frame.level_db]).all() for frame in frames)
    assert opening(during(frames, 0.6, 0.78)).max() < 0.01
    assert opening(during(frames, 1.25, 1.45)).min() > 0.3


def test_a_clipped_voice_still_moves_the_mouth():
    frames = follow(np.clip(20 * np.r_[silence(0.2), spoken("a", 0.5)], -1, 1))
    assert opening(during(frames, 0.3, 0.6)).min() > 0.3


def test_an_offset_of_the_sound_card_makes_no_difference():
    sound = np.r_[silence(0.3), spoken("a", 0.4), silence(0.4)]
    frames = follow(sound + np.float32(0.3))
    assert opening(during(frames, 0.0, 0.27)).max() < 0.01
    assert opening(during(frames, 0.4, 0.65)).min() > 0.5
    assert opening(during(frames, 0.9, 1.1)).max() < 0.01


def test_digital_silence_is_a_closed_mouth():
    frames = follow(silence(1.0))
    assert np.array([frame.parameters for frame in frames]) == pytest.approx(
        np.tile(SHAPES[CLOSED], (len(frames), 1))
    )


def test_after_a_gap_it_goes_on_with_the_new_times():
    follower = MouthFollower(16_000)
    before = follower.feed(spoken("a", 0.5), 0.0)
    after = follower.feed(np.r_[silence(0.1), spoken("a", 0.5)], 5.0)
    assert opening(before[-1:])[0] > 0.5
    assert opening(after[:1])[0] < 0.01
    assert after[0].time_s == pytest.approx(5.0125, abs=0.001)
    assert opening(during(after, 5.3, 5.5)).min() > 0.5


def test_the_mouth_shuts_when_no_sound_comes_any_more():
    follower = MouthFollower(16_000)
    last = follower.feed(spoken("a", 0.5), 0.0)[-1]
    openings = opening([follower.idle(last.time_s + s) for s in (0.0, 0.03, 0.1, 0.5)])
    assert openings[0] == pytest.approx(opening([last])[0])
    assert np.all(np.diff(openings) <= 0)
    assert openings[-1] < 0.001


def test_nothing_and_a_broken_time_are_taken_calmly():
    follower = MouthFollower(16_000)
    assert follower.feed(np.zeros(0, np.float32), 0.0) == []
    assert opening([follower.idle(1.0)])[0] == 0.0
    follower.feed(silence(0.1), 7.0)
    frames = follower.feed(silence(0.1), float("nan"))
    assert frames[-1].time_s == pytest.approx(7.18, abs=0.01)


def test_a_face_with_other_shapes_is_driven_without_training_anew():
    other = np.random.default_rng(5).standard_normal((6, 13))
    sound = np.r_[silence(0.2), spoken("a", 0.4)]
    mine = follow(sound)
    theirs = MouthFollower(16_000, shapes=other).feed(sound, 0.0)
    for a, b in zip(mine, theirs, strict=True):
        weights = Interpolation(SHAPES).linear(a.parameters[None])[0]
        np.testing.assert_allclose(b.parameters, weights @ other, atol=1e-3)


def test_the_settings_have_limits():
    with pytest.raises(ValidationError):
        VoiceSettings(lookahead_ms=15)
    with pytest.raises(ValidationError):
        VoiceSettings(openning=1.0)


def test_a_telephone_and_a_studio_give_the_same_mouth():
    sound = np.r_[silence(0.2), spoken("a", 0.4, 48_000)]
    direct = follow(sound, 48_000)
    ours = follow(resample(sound, 48_000))
    assert np.abs(opening(direct)[: len(ours)] - opening(ours)[: len(direct)]).max() < 0.02


def test_stereo_at_192_khz_is_the_same_voice():
    sound = np.r_[silence(0.2, 192_000), spoken("a", 0.3, 192_000)]
    follower = MouthFollower(192_000)
    frames = []
    for at in range(0, len(sound), 1920):
        block = np.stack([sound[at : at + 1920]] * 2, axis=1)
        frames += follower.feed(block, at / 192_000)
    assert opening(during(frames, 0.0, 0.17)).max() < 0.01
    assert opening(during(frames, 0.3, 0.45)).min() > 0.5


@pytest.mark.parametrize(
    "trouble",
    [
        np.zeros(16_000, np.float32),
        np.full(16_000, np.nan, np.float32),
        np.sign(np.sin(np.arange(16_000))).astype(np.float32),
        noise(1.0, -3, slope=0.0),
    ],
    ids=["silence", "no numbers", "full scale", "noise at full scale"],
)
def test_within_two_seconds_of_any_trouble_the_voice_is_followed_again(trouble):
    usual = np.tile(np.r_[spoken("a", 0.3, level_db=-25), silence(0.1)], 8)
    frames = follow(np.r_[usual, trouble, usual])
    assert np.percentile(opening(during(frames, 6.2, 7.2)), 50) > 0.4
    assert all(np.isfinite(frame.parameters).all() for frame in frames)


def test_waiting_for_more_sound_is_told_in_the_times():
    """With a look-ahead the same sound's frame comes later and bears the same time."""
    sound = np.r_[silence(0.3), spoken("a", 0.4)]
    for lookahead_ms in (0, 10, 20, 30):
        frames = follow(sound, lookahead_ms=lookahead_ms)
        opened = next(f.time_s for f in frames if opening([f])[0] > 0.3)
        assert opened == pytest.approx(0.31, abs=0.035)
        follower = MouthFollower(16_000, VoiceSettings(lookahead_ms=lookahead_ms))
        assert follower.latency_s == pytest.approx(0.0125 + lookahead_ms / 1000)


def test_two_minutes_of_silence_change_nothing():
    sentence = np.r_[silence(0.3), spoken("a", 0.4, level_db=-25), silence(0.3)]
    follower = MouthFollower(16_000)
    first = follower.feed(sentence, 0.0)
    hiss = noise(20.0, -75)
    for k in range(6):
        frames = follower.feed(hiss, 1.0 + 20 * k)
        assert opening(frames).max() < 0.05
    again = follower.feed(sentence, 121.0)
    openings = [
        opening(during(f, s + 0.45, s + 0.65)).mean() for f, s in ((first, 0), (again, 121))
    ]
    assert openings[1] == pytest.approx(openings[0], abs=0.15)


def test_excitement_is_in_the_frames():
    calm = np.tile(np.r_[spoken("a", 0.3, level_db=-30), silence(0.1)], 10)
    frames = follow(calm)
    assert 0 < frames[-20].arousal < 0.6
