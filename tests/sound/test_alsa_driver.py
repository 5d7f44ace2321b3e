"""The ALSA driver on emulated cards: what goes wrong with microphones."""

import itertools

import numpy as np
import pytest

from hypermask.voice.follower import MouthFollower
from hypermask.workers.board import Board
from hypermask.workers.voice import VoiceWorker
from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.errors import ConfigError, DeviceAbsent, DeviceError, DeviceLost
from hypermask_drivers.registry import driver_class
from hypermask_drivers.settings import parse
from hypermask_drivers.sound import SoundBlock
from hypermask_drivers.sound.alsa import AlsaSettings, AlsaSoundIn
from hypermask_sim.emulators.alsa import EmulatedAlsa, EmulatedCard, EmulatedPcm

NAME = "hw:CARD=hypermask_mic"


@pytest.fixture(params=["0.11", "0.10"], autouse=True)
def version(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Debian 13's pyalsaaudio cannot ask the card how much waits."""
    if request.param == "0.10":
        monkeypatch.delattr(EmulatedPcm, "avail")
    return str(request.param)


def make(**card: object) -> tuple[AlsaSoundIn, EmulatedCard, VirtualClock]:
    clock = VirtualClock(1000.0)
    emulated = EmulatedCard(clock, **card)  # type: ignore[arg-type]
    driver = AlsaSoundIn(AlsaSettings(device=NAME), clock, EmulatedAlsa([emulated]))
    return driver, emulated, clock


def listen(
    driver: AlsaSoundIn, clock: VirtualClock, seconds: float, step_s: float = 0.004
) -> list[SoundBlock]:
    found = []
    for _ in range(round(seconds / step_s)):
        clock.sleep_until(clock.now() + step_s)
        while (block := driver.read(0.0)) is not None:
            found.append(block)
    return found


def numbers(frames: np.ndarray) -> np.ndarray:
    """Samples that tell their own frame's number (modulo 2^20, exact in 24 bits)."""
    return (frames % 2**20) / 2**20


@pytest.mark.parametrize("rate_hz", [8000, 16000, 44100, 48000, 192000])
@pytest.mark.parametrize("form", ["S24_3LE", "S32_LE", "FLOAT_LE"])
def test_every_sample_has_the_time_at_which_it_sounded(rate_hz: int, form: str) -> None:
    """A stereo card, 100 ppm fast, with steps of 1 ms and time stamps up to 1 ms late."""
    driver, card, clock = make(
        rate_hz=rate_hz, channels=2, formats=(form,), signal=numbers,
        drift_ppm=100.0, step_s=0.001, jitter_s=0.001,
    )  # fmt: skip
    driver.open()
    blocks = listen(driver, clock, 20)
    assert blocks[0].rate_hz == rate_hz
    assert sum(len(block.samples) for block in blocks) == pytest.approx(20 * rate_hz, rel=0.002)
    for block in blocks[1250:]:
        number = round(float(block.samples[0]) * 2**20)
        frames = round(card.frame_at(block.time_s))
        away = (frames - number + 2**19) % 2**20 - 2**19
        assert abs(away / rate_hz) < 0.0015
        assert np.array_equal(
            np.round(block.samples * 2**20) % 2**20,
            (number + np.arange(len(block.samples))) % 2**20,
        )
    steps = [after.time_s - before.time_s for before, after in itertools.pairwise(blocks[2500:])]
    assert np.ptp(steps) < 50e-6
    assert driver.status.drift_ppm == pytest.approx(100, abs=30)


def test_time_stamps_that_a_plugin_leaves_out_are_read_off_the_clock() -> None:
    driver, card, clock = make()
    card.stamps = False
    driver.open()
    for block in listen(driver, clock, 2):
        assert block.time_s + len(block.samples) / 48000 <= clock.now()
    assert block.time_s == pytest.approx(clock.now() - 0.004, abs=0.005)


def test_the_converter_s_latency_is_taken_off() -> None:
    times = []
    for latency_ms in (0.0, 7.0):
        clock = VirtualClock(5.0)
        settings = AlsaSettings(device=NAME, latency_ms=latency_ms)
        driver = AlsaSoundIn(settings, clock, EmulatedAlsa([EmulatedCard(clock)]))
        driver.open()
        times.append(listen(driver, clock, 1)[-1].time_s)
    assert times[0] - times[1] == pytest.approx(0.007)


def test_an_overrun_is_counted_and_the_stream_goes_on() -> None:
    driver, _, clock = make(signal=numbers, formats=("S32_LE",))
    driver.open()
    before = listen(driver, clock, 1)
    clock.sleep_until(clock.now() + 3)
    after = listen(driver, clock, 1)
    assert (before[-1].overruns, driver.status.overruns) == (0, 1)
    missing_s = after[0].time_s - before[-1].time_s
    assert after[0].overruns == round(missing_s / 0.004) - 1
    assert missing_s == pytest.approx(3, abs=0.02)
    assert after[-1].overruns == after[0].overruns


def test_one_of_several_channels_is_the_microphone() -> None:
    clock = VirtualClock(0.0)
    card = EmulatedCard(
        clock, channels=4, signal=lambda frames: np.tile([0.1, 0.2, 0.3, 0.4], (len(frames), 1))
    )
    driver = AlsaSoundIn(AlsaSettings(device=NAME, channel=2), clock, EmulatedAlsa([card]))
    driver.open()
    assert listen(driver, clock, 0.1)[-1].samples[0] == pytest.approx(0.3, abs=1e-4)


def test_samples_that_are_no_numbers_are_silence_and_counted() -> None:
    driver, _, clock = make(formats=("FLOAT_LE",), signal=lambda n: np.where(n % 5, 0.5, np.nan))
    driver.open()
    blocks = listen(driver, clock, 0.5)
    total = sum(len(block.samples) for block in blocks)
    assert all(np.isfinite(block.samples).all() for block in blocks)
    assert driver.status.repaired == pytest.approx(total / 5, abs=len(blocks))


def test_a_renumbered_card_is_found_by_its_name() -> None:
    driver, card, clock = make()
    driver.open()
    card.unplug()
    with pytest.raises(DeviceLost) as caught:
        driver.read(0.0)
    assert caught.value.code == "SND-LOST"
    card.plug(number=3)
    driver.open()
    assert listen(driver, clock, 0.1)


def test_a_card_that_falls_silent_without_an_error_is_lost() -> None:
    driver, card, clock = make()
    driver.open()
    listen(driver, clock, 1)
    card.mute = True
    with pytest.raises(DeviceLost, match="no sound any more"):
        listen(driver, clock, 0.7)
    assert driver.state is DeviceState.LOST
    card.mute = False
    driver.open()
    assert listen(driver, clock, 0.1)


def test_a_card_may_take_its_time_before_its_first_sample() -> None:
    driver, card, clock = make()
    card.mute = True
    driver.open()
    assert listen(driver, clock, 1.5) == []
    card.mute = False
    assert listen(driver, clock, 0.1)
    driver.close()
    card.mute = True
    driver.open()
    with pytest.raises(DeviceLost):
        listen(driver, clock, 2.5)


@pytest.mark.parametrize(
    ("change", "code", "kind"),
    [
        ({"busy": True}, "SND-BUSY", DeviceAbsent),
        ({"forbidden": True}, "SND-RIGHTS", DeviceError),
        ({"present": False}, "SND-ABSENT", DeviceAbsent),
        ({"formats": ("MU_LAW",)}, "SND-FORMAT", DeviceError),
    ],
)
def test_every_refusal_has_its_own_code(
    change: dict[str, object], code: str, kind: type[DeviceError]
) -> None:
    driver, card, _ = make()
    for name, value in change.items():
        setattr(card, name, value)
    with pytest.raises(kind) as caught:
        driver.open()
    assert caught.value.code == code
    assert driver.state is DeviceState.ABSENT


@pytest.mark.parametrize("device", ["hw:0", "hw:1,0", "plughw:2", "hw:CARD=1,DEV=0", "default:0"])
def test_a_card_s_number_is_no_name(device: str) -> None:
    with pytest.raises(ConfigError, match="numbered anew"):
        parse(AlsaSettings, {"device": device}, "machine.toml")


@pytest.mark.parametrize("device", ["hypermask_mic", "plughw:CARD=Mic,DEV=0", "null"])
def test_a_name_is(device: str) -> None:
    assert parse(AlsaSettings, {"device": device}, "machine.toml").device == device


def test_the_registry_knows_it() -> None:
    assert driver_class("sound", "alsa") is AlsaSoundIn


def test_a_mouth_that_loses_its_microphone_closes_and_recovers() -> None:
    """192 kHz stereo; the card vanishes in mid-vowel and is back after 5 s under another number."""

    def vowel(frames: np.ndarray) -> np.ndarray:
        time_s = frames / 192000
        return sum(0.25 / k * np.sin(2 * np.pi * 130 * k * time_s) for k in range(1, 9))

    driver, card, clock = make(rate_hz=192000, channels=2, formats=("S24_3LE",), signal=vowel)
    said: list[str] = []
    board = Board.local()
    worker = VoiceWorker(driver, board, clock, lambda time_s, code, text: said.append(code))

    def opening(seconds: float) -> float:
        for _ in range(round(seconds / 0.004)):
            clock.sleep_until(clock.now() + 0.004)
            while worker.step():
                pass
        record = board.mouth.latest()
        assert record is not None and clock.now() - record["time_s"] < 0.1
        return float(np.abs(record["parameters"]).max())

    assert opening(1.0) > 0.2
    card.unplug()
    assert opening(0.3) < 0.02
    assert opening(4.7) < 0.02
    card.plug(number=2)
    assert opening(2.0) > 0.2
    assert said == ["SND-LOST", "SOUND-BACK"]


def test_the_mouth_s_time_does_not_creep_over_a_minute() -> None:
    driver, card, clock = make(rate_hz=16000, drift_ppm=-200.0, step_s=0.001, jitter_s=0.001)
    driver.open()
    follower = MouthFollower(driver.rate_hz)
    times = [
        frame.time_s
        for block in listen(driver, clock, 60, 0.010)
        for frame in follower.feed(block.samples, block.time_s)
    ]
    off = np.array(times) - np.arange(len(times)) * 160 / card.frames_hz
    assert len(times) > 5900
    assert np.ptp(off[500:]) < 0.5e-3
