"""What microphones do to a show: from the sound driver to the mouth on the stage, in lock-step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from voice_sounds import spoken

from hypermask.stage.scene import live_mouth
from hypermask.stage.settings import StageSettings
from hypermask.workers.board import Board
from hypermask.workers.microphone import QUIET_S, SoundCheck, Troubles
from hypermask.workers.voice import VoiceWorker
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.sound import SoundBlock, SoundIn
from hypermask_drivers.sound.alsa import AlsaSettings, AlsaSoundIn
from hypermask_sim.devices.sound import SimSoundIn
from hypermask_sim.emulators.alsa import EmulatedAlsa, EmulatedCard
from hypermask_sim.scenario import Scenario
from hypermask_sim.voice_source import Voice, resample
from hypermask_sim.world import World

VOWEL = spoken("a", 1.0)
SHUT, OPEN = 0.02, 0.2
FROM_S, TO_S = 1.5, 4.0
STEP_S = 0.004


@dataclass
class House:
    """A microphone, the voice worker, and the mouth as the stage would draw it."""

    clock: VirtualClock
    microphone: SoundIn
    said: list[tuple[float, str, str]] = field(default_factory=list)
    mouths: list[tuple[float, float]] = field(default_factory=list)
    at: dict[float, Callable[[], None]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.board = Board.local()
        self.worker = VoiceWorker(
            self.microphone, self.board, self.clock, lambda *said: self.said.append(said)
        )

    def play(self, until_s: float) -> None:
        while self.clock.now() < until_s:
            self.clock.sleep_until(self.clock.now() + STEP_S)
            for due in [time_s for time_s in self.at if time_s <= self.clock.now()]:
                self.at.pop(due)()
            for _ in range(1000):
                if not self.worker.step():
                    break
            else:
                raise AssertionError("the worker never comes to rest")
            self.mouths.append((self.clock.now(), self.drawn()))

    def drawn(self) -> float:
        record = self.board.mouth.latest()
        if record is None:
            return 0.0
        age_s = self.clock.now() - float(record["time_s"])
        mouth = live_mouth(record["parameters"], age_s, StageSettings())
        assert np.isfinite(mouth).all()
        return float(np.abs(mouth).max())

    def widest(self, from_s: float, to_s: float) -> float:
        return max(mouth for time_s, mouth in self.mouths if from_s < time_s <= to_s)

    def narrowest(self, from_s: float, to_s: float) -> float:
        return min(mouth for time_s, mouth in self.mouths if from_s < time_s <= to_s)

    @property
    def codes(self) -> list[str]:
        return [code for _, code, _ in self.said]


def simulated(*faults: dict[str, Any], voice: np.ndarray = VOWEL, **microphone: Any) -> House:
    """An actor who sings one vowel for ever."""
    world = World(
        Scenario.model_validate({"faults": faults, "microphone": microphone, "duration_s": 20})
    )
    rate_hz = world.scenario.microphone.rate_hz
    world.__dict__["voice"] = Voice(resample(voice, 16_000, rate_hz), rate_hz).repeated(0.0, 20)
    clock = VirtualClock()
    return House(clock, SimSoundIn(world, clock))


def emulated(signal: Callable[[np.ndarray], np.ndarray] | None = None, **card: Any) -> House:
    """The real driver over an emulated card that hears the same vowel."""
    clock = VirtualClock()
    rate_hz = card.get("rate_hz", 48_000)
    vowel = resample(VOWEL, 16_000, rate_hz)
    plugged = EmulatedCard(clock, signal=signal or (lambda n: vowel[n % len(vowel)]), **card)
    settings = AlsaSettings(device="hw:CARD=hypermask_mic")
    house = House(clock, AlsaSoundIn(settings, clock, EmulatedAlsa([plugged])))
    house.card = plugged  # type: ignore[attr-defined]
    return house


def expect_closed_and_back(house: House) -> None:
    """Open before, shut 0.2 s after the trouble began, open again within 2 s of its end."""
    house.play(TO_S + 2.5)
    assert house.narrowest(0.5, FROM_S) > OPEN
    assert house.widest(FROM_S + 0.2, TO_S) < SHUT
    assert house.narrowest(TO_S + 2.0, TO_S + 2.5) > OPEN


def expect_one_message(house: House, code: str, remedy: str) -> None:
    assert house.codes in ([code], [code, "SOUND-BACK"])
    (text,) = [text for _, said, text in house.said if said == code]
    assert text.startswith(f"{code}: ") and remedy in text


def fault(kind: str) -> dict[str, Any]:
    return {"kind": kind, "from_s": FROM_S, "to_s": TO_S}


@pytest.mark.parametrize(
    ("kind", "code", "remedy"),
    [
        ("sound_lost", "SND-LOST", "Check the cable"),
        ("sound_silent", "SND-SILENT", "muted"),
        ("sound_nan", "SND-BROKEN", "plug it in again"),
        ("sound_stuck", "SND-SILENT", "muted"),
    ],
)
def test_a_microphone_that_gives_no_voice_closes_the_mouth_and_is_told_once(kind, code, remedy):
    house = simulated(fault(kind))
    expect_closed_and_back(house)
    expect_one_message(house, code, remedy)


@pytest.mark.parametrize("microphone", [{"rate_hz": 48_000}, {"block_ms": 20}, {"block_ms": 3}])
def test_whatever_its_rate_and_blocks(microphone):
    house = simulated(fault("sound_nan"), **microphone)
    expect_closed_and_back(house)
    expect_one_message(house, "SND-BROKEN", "plug it in again")


def test_a_voice_that_clips_moves_the_mouth_and_is_told_once():
    house = simulated(fault("sound_clipped"))
    house.play(TO_S + 2.5)
    assert house.narrowest(0.5, TO_S) > OPEN
    assert house.narrowest(TO_S + 0.5, TO_S + 2.5) > OPEN  # 20 dB softer again
    expect_one_message(house, "SND-CLIPS", "Turn its gain down")


def test_a_voice_that_clips_a_little_is_heard_as_it_is():
    block = SoundBlock(np.clip(4 * VOWEL, -1, 1), 16_000.0, 0.0, 0)
    assert 0.001 < np.mean(np.abs(block.samples) >= 1) < 0.15
    check = SoundCheck(lambda *said: None)
    assert np.array_equal(check.samples(block, 1.0), block.samples)


def test_a_clipped_voice_that_ends_closes_the_mouth():
    sentence = np.r_[np.clip(100 * VOWEL, -1, 1), np.zeros(16_000, np.float32)]
    house = simulated(voice=sentence)
    house.play(4.0)
    for pause_s in (1.0, 3.0):
        assert house.widest(pause_s + 0.25, pause_s + 0.95) < SHUT
    assert house.codes == ["SND-CLIPS"]


def test_a_microphone_that_changes_to_192_khz_is_followed():
    house = simulated(fault("sound_resampled"))
    house.play(TO_S + 2.5)
    assert house.narrowest(FROM_S + 0.5, TO_S) > OPEN
    assert house.narrowest(TO_S + 0.5, TO_S + 2.5) > OPEN
    assert set(house.codes) == {"SOUND-RATE"}
    assert len(house.codes) <= 2


def test_blocks_of_absurd_sizes_are_heard_all_the_same():
    house = simulated(fault("sound_garbled"))
    house.play(TO_S + 2.5)
    assert house.widest(FROM_S + 0.2, TO_S) > OPEN
    assert house.narrowest(TO_S + 0.5, TO_S + 2.5) > OPEN
    assert house.codes == []


# --- the real driver


def test_a_card_that_is_pulled_and_plugged_in_elsewhere():
    house = emulated()
    house.at = {FROM_S: house.card.unplug, TO_S: lambda: house.card.plug(number=3)}
    expect_closed_and_back(house)
    expect_one_message(house, "SND-LOST", "Check the cable")


def test_a_card_that_comes_back_at_192_khz_stereo():
    house = emulated()

    def another() -> None:
        vowel = resample(VOWEL, 16_000, 192_000)
        card = EmulatedCard(
            house.clock, rate_hz=192_000, channels=2, formats=("S32_LE",),
            signal=lambda n: vowel[n % len(vowel)],
        )  # fmt: skip
        house.microphone._given.cards[:] = [card]

    house.at = {FROM_S: house.card.unplug, TO_S: another}
    expect_closed_and_back(house)
    assert sorted(house.codes) == ["SND-LOST", "SOUND-BACK", "SOUND-RATE"]


def test_a_float_card_that_goes_mad():
    vowel = resample(VOWEL, 16_000, 48_000)

    def signal(frames: np.ndarray) -> np.ndarray:
        mad = (frames >= FROM_S * 48_000) & (frames < TO_S * 48_000)
        return np.where(mad, np.nan, vowel[frames % len(vowel)])

    house = emulated(signal, formats=("FLOAT_LE",))
    expect_closed_and_back(house)
    expect_one_message(house, "SND-BROKEN", "plug it in again")


def test_a_card_that_is_there_and_gives_nothing_is_told_once_and_not_each_second():
    house = emulated()
    house.at = {
        FROM_S: lambda: setattr(house.card, "mute", True),
        20.0: lambda: setattr(house.card, "mute", False),
    }
    house.play(23.0)
    assert house.widest(FROM_S + 0.2, 20.0) < SHUT
    assert house.narrowest(22.0, 23.0) > OPEN
    expect_one_message(house, "SND-LOST", "Check the cable")


def test_a_card_with_a_muted_switch():
    house = emulated(lambda n: np.where(n < FROM_S * 48_000, 0.1 * np.sin(0.1 * n), 0.0))
    house.play(8.0)
    assert house.widest(FROM_S + 0.2, 8.0) < SHUT
    expect_one_message(house, "SND-SILENT", "muted")


# --- drivers that lie


class Lies(SoundIn):
    """Blocks as they are given, one each 8 ms."""

    def __init__(self, clock: VirtualClock, blocks: Callable[[int], SoundBlock]) -> None:
        super().__init__()
        self._clock, self._blocks, self._next = clock, blocks, 0

    @property
    def rate_hz(self) -> float:
        return 16_000.0

    def open(self) -> None:
        from hypermask_drivers.device import DeviceState

        self._state = DeviceState.READY

    def close(self) -> None:
        return

    def read(self, timeout_s: float) -> SoundBlock | None:
        if (self._next + 1) * 0.008 > self._clock.now() + 1e-9:
            return None
        self._next += 1
        return self._blocks(self._next - 1)


def lying(change: Callable[[int, SoundBlock], SoundBlock]) -> House:
    clock = VirtualClock()

    def block(index: int) -> SoundBlock:
        samples = np.take(VOWEL, np.arange(128) + 128 * index, mode="wrap")
        told = SoundBlock(samples, 16_000.0, index * 0.008, 0)
        return change(index, told) if FROM_S <= index * 0.008 < TO_S else told

    return House(clock, Lies(clock, block))


@pytest.mark.parametrize("rate_hz", [0.0, -16_000.0, float("nan"), float("inf"), 1e12])
def test_an_impossible_rate_closes_the_mouth_and_is_told_once(rate_hz):
    house = lying(lambda index, told: SoundBlock(told.samples, rate_hz, told.time_s, 0))
    expect_closed_and_back(house)
    expect_one_message(house, "SND-RATE", "Choose 16000")


@pytest.mark.parametrize(
    "samples",
    [
        np.zeros(0, np.float32),
        np.full(128, 1e30, np.float32),
        np.full(128, -np.inf, np.float32),
        np.full((128, 2), np.nan, np.float32),
    ],
)
def test_blocks_without_sound_close_the_mouth(samples):
    house = lying(lambda index, told: SoundBlock(samples, 16_000.0, told.time_s, 0))
    expect_closed_and_back(house)
    assert len(house.codes) <= 2


@pytest.mark.parametrize("time_s", [float("nan"), float("inf"), -1e9, 1e9])
def test_impossible_times_are_replaced_by_the_clock(time_s):
    house = lying(lambda index, told: SoundBlock(told.samples, 16_000.0, time_s, 0))
    house.play(TO_S + 1.0)
    assert house.narrowest(0.5, TO_S + 1.0) > OPEN
    assert house.codes == []


def test_a_few_bad_samples_are_mended_in_silence():
    def change(index: int, told: SoundBlock) -> SoundBlock:
        samples = told.samples.copy()
        samples[::64] = np.nan
        return SoundBlock(samples, 16_000.0, told.time_s, 0)

    house = lying(change)
    house.play(TO_S)
    assert house.narrowest(0.5, TO_S) > OPEN
    assert house.codes == []


def test_a_stereo_block_is_mixed():
    check = SoundCheck(lambda *said: None)
    block = SoundBlock(np.array([[1.0, 0.0], [0.5, 0.5]], np.float32), 16_000.0, 0.0, 0)
    assert check.samples(block, 0.0).tolist() == [0.5, 0.5]


# --- not a flood


def test_a_trouble_that_comes_and_goes_is_told_three_times_at_most_until_it_stayed_away():
    said: list[str] = []
    troubles = Troubles(lambda time_s, code, text: said.append(code))
    for k in range(100):
        troubles.wrong(float(k), "SND-LOST", "it vanished. Look.")
        troubles.right(k + 0.5, "SND-LOST")
    assert said == ["SND-LOST", "SOUND-BACK"] * 3
    troubles.wrong(100.0 + QUIET_S, "SND-LOST", "it vanished. Look.")
    assert said[6:] == ["SND-LOST"]


def test_a_radio_microphone_with_a_gate_is_told_once_in_a_night():
    words = np.r_[VOWEL, np.zeros(3 * 16_000, np.float32)]
    house = simulated(voice=words, noise_db=-160)
    house.play(20.0)
    assert house.codes == ["SND-SILENT", "SOUND-BACK"]
