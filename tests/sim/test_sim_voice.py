"""Recordings of every common form, and what is not one."""

import shutil
import struct
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hypermask_drivers.clock import VirtualClock
from hypermask_drivers.errors import HypermaskError
from hypermask_sim.devices.sound import SimSoundIn
from hypermask_sim.scenario import Scenario
from hypermask_sim.voice_source import Voice, find_voice, read_wav, resample, spoken
from hypermask_sim.world import World

SPEECH = sorted((Path(__file__).parents[2].parent / "shared" / "data" / "speech").glob("*.wav"))


def tone(rate: int, seconds: float = 0.5, hz: float = 440.0) -> np.ndarray:
    return 0.5 * np.sin(2 * np.pi * hz * np.arange(int(rate * seconds)) / rate)


def encoded(samples: np.ndarray, bits: int, kind: int) -> bytes:
    if kind == 3:
        return samples.astype(f"<f{bits // 8}").tobytes()
    if bits == 8:
        return np.round(samples * 127 + 128).astype(np.uint8).tobytes()
    whole = np.round(samples * (2 ** (bits - 1) - 1)).astype("<i4")
    if bits == 24:
        return bytes(whole.view(np.uint8).reshape(-1, 4)[:, :3].tobytes())
    return bytes(whole.astype(f"<i{bits // 8}").tobytes())


def wav(
    samples: np.ndarray,
    rate: int,
    bits: int = 16,
    kind: int = 1,
    channels: int = 1,
    wide: bool = False,
) -> bytes:
    """A RIFF file; wide: WAVE_FORMAT_EXTENSIBLE."""
    body = encoded(np.repeat(samples, channels), bits, kind)
    align = channels * bits // 8
    form = struct.pack(
        "<HHIIHH", 0xFFFE if wide else kind, channels, rate, rate * align, align, bits
    )
    if wide:
        form += struct.pack("<HHIH", 22, bits, 0, kind) + bytes.fromhex(
            "000000001000800000AA00389B71"
        )
    chunks = b"LIST" + struct.pack("<I", 5) + b"junk\0\0"
    chunks += b"fmt " + struct.pack("<I", len(form)) + form
    chunks += b"data" + struct.pack("<I", len(body)) + body
    return b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WAVE" + chunks


@pytest.mark.parametrize(("bits", "kind"), [(8, 1), (16, 1), (24, 1), (32, 1), (32, 3), (64, 3)])
@pytest.mark.parametrize("channels", [1, 2, 6])
@pytest.mark.parametrize("wide", [False, True])
def test_every_common_form_is_read(
    tmp_path: Path, bits: int, kind: int, channels: int, wide: bool
) -> None:
    path = tmp_path / "voice.wav"
    path.write_bytes(wav(tone(22050), 22050, bits, kind, channels, wide))
    samples, rate = read_wav(path)
    assert rate == 22050 and samples.dtype == np.float32
    assert samples == pytest.approx(tone(22050), abs=0.02 if bits == 8 else 1e-4)


@pytest.mark.parametrize("rate", [8000, 11025, 22050, 44100, 48000, 96000, 16001])
def test_any_rate_becomes_the_microphones(rate: int) -> None:
    got = resample(tone(rate).astype(np.float32), rate, 16000)
    assert len(got) == pytest.approx(8000, abs=2)
    inner = slice(400, -400)
    assert got[inner] == pytest.approx(tone(16000)[: len(got)][inner], abs=2e-3)


def test_what_the_new_rate_cannot_hold_is_filtered_away() -> None:
    got = resample(tone(48000, hz=11000.0).astype(np.float32), 48000, 16000)
    assert np.abs(got[400:-400]).max() < 1e-3


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"RIFF",
        b"ID3\x03 not a wave file at all",
        wav(tone(16000), 16000)[:30],
        wav(tone(16000), 16000)[:-4001],
        wav(np.zeros(0), 16000),
        wav(tone(16000), 16000, kind=7, bits=8),
        wav(tone(16000), 3),
        wav(tone(16000), 16000).replace(b"\x02\x00\x10\x00", b"\x07\x00\x10\x00"),
    ],
)
def test_what_is_no_recording_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "voice.wav"
    path.write_bytes(data)
    with pytest.raises(HypermaskError) as caught:
        read_wav(path)
    assert caught.value.code == "VOICE-FORMAT" and "voice.wav" in str(caught.value)


@given(st.integers(0, 60), st.binary(min_size=1, max_size=8))
def test_a_garbled_header_is_read_or_refused(place: int, junk: bytes) -> None:
    data = wav(tone(16000, 0.02), 16000, wide=True)
    with NamedTemporaryFile(suffix=".wav") as file:
        file.write(data[:place] + junk + data[place + len(junk) :])
        file.flush()
        try:
            samples, _ = read_wav(Path(file.name))
        except HypermaskError as error:
            assert error.code == "VOICE-FORMAT"
        else:
            assert np.isfinite(samples).all() and np.abs(samples).max() <= 1


def test_an_absent_recording_is_named() -> None:
    with pytest.raises(HypermaskError, match=r"VOICE-ABSENT: .*gone\.wav"):
        find_voice(("gone.wav",), 16000)


@pytest.mark.skipif(not SPEECH, reason="no ../shared/data/speech")
def test_real_speech_is_read() -> None:
    voice = find_voice((str(SPEECH[0]),), 16000)
    assert len(voice.samples) > 16000 and 0.05 < np.abs(voice.samples).max() <= 1


@pytest.mark.skipif(shutil.which("espeak-ng") is None, reason="espeak-ng is not installed")
def test_espeak_speaks_and_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HYPERMASK_CACHE", str(tmp_path))
    first = spoken("Good evening.", 16000)
    assert len(first.samples) > 8000 and first.note == ""
    monkeypatch.setattr("subprocess.run", lambda *_, **__: pytest.fail("spoken twice"))
    assert np.array_equal(spoken("Good evening.", 16000).samples, first.samples)


def test_without_espeak_there_is_silence_and_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda _: None)
    world = World(Scenario().with_changes(["performer.voice=speech"]))
    assert not len(world.voice.samples)
    assert "espeak-ng" in world.notes[0]


def test_the_microphone_hears_the_recording_when_it_is_spoken(tmp_path: Path) -> None:
    path = tmp_path / "voice.wav"
    path.write_bytes(wav(tone(16000), 16000))
    changes = [
        f"performer.voice={path}",
        "performer.voice_start_s=0.25",
        "microphone.noise_db=-160",
    ]
    clock = VirtualClock()
    microphone = SimSoundIn(World(Scenario().with_changes(changes)), clock)
    microphone.open()
    heard = np.zeros(16000, np.float32)
    while microphone.next_block_s() < 1.0:
        clock.sleep_until(microphone.next_block_s())
        block = microphone.read(0.0)
        assert block is not None
        start = round(block.time_s * 16000)
        heard[start : start + len(block.samples)] = block.samples
    assert heard[4000:12000] == pytest.approx(tone(16000), abs=1e-4)
    assert np.abs(heard[:4000]).max() < 1e-5 and np.abs(heard[12000:15000]).max() < 1e-5


def test_a_recording_can_be_heard_again_and_again_with_pauses() -> None:
    once = Voice(np.ones(100, np.float32), 1000)
    again = once.repeated(pause_s=0.05, duration_s=1.0)
    assert len(again.samples) >= 1000
    assert again.samples[:310].sum() == 210
    assert again.block(100, 50).sum() == 0 and again.block(150, 100).sum() == 100
    assert len(Voice(np.zeros(0, np.float32), 1000).repeated(0.1, 1.0).samples) == 0


def test_values_that_are_no_numbers_reach_the_microphone_and_spoil_no_others(
    tmp_path: Path,
) -> None:
    samples = tone(48000)
    samples[9000:9300] = np.nan
    path = tmp_path / "voice.wav"
    path.write_bytes(wav(samples, 48000, bits=32, kind=3))
    voice = find_voice((str(path),), 16000).samples
    lost = np.flatnonzero(np.isnan(voice))
    assert lost.min() >= 3000 and lost.max() <= 3100 and len(lost) == 100
    inner = slice(200, 2900)
    assert voice[inner] == pytest.approx(tone(16000)[inner], abs=2e-3)
