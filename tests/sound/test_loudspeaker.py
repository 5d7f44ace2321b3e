"""The voice's way to the loudspeaker: what is written works in libasound itself."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from hypermask.errors import ConfigError
from hypermask.loudspeaker.__main__ import main
from hypermask.loudspeaker.configuration import asound_conf, environment, udev_rules, write
from hypermask.loudspeaker.offset import LIP_SYNC, LipSync, LipSyncMeter
from hypermask.loudspeaker.settings import Loudspeaker, SoundSettings, load_sound
from hypermask.voice.wav import read_wav
from hypermask_drivers.sound.alsa import AlsaSettings

ROOT = Path(__file__).parents[2]
SYSTEM = Path("/usr/share/alsa/alsa.conf")
RATE_HZ = 48000

libasound = pytest.mark.skipif(
    not (SYSTEM.exists() and shutil.which("arecord")), reason="alsa-utils is not installed"
)
plugins = pytest.mark.skipif(
    not Path("/usr/lib/ladspa/gate_1410.so").exists(), reason="swh-plugins is not installed"
)


def sound(**loudspeaker: object) -> SoundSettings:
    return SoundSettings.model_validate({"loudspeaker": loudspeaker})


def tone(hz: float, level_db: float, seconds: float = 1.0) -> np.ndarray:
    time_s = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    return 10 ** (level_db / 20) * np.sin(2 * np.pi * hz * time_s)


def level_db(samples: np.ndarray) -> float:
    """Of a sine's amplitude, in the second half of its second."""
    half = samples[int(0.5 * RATE_HZ) : int(0.95 * RATE_HZ)]
    return 10 * np.log10(2 * np.mean(half**2) + 1e-12)


class Bench:
    """The configuration in libasound, with files in the place of the cards."""

    def __init__(self, folder: Path, settings: SoundSettings) -> None:
        self.folder = folder
        channels = settings.loudspeaker.channels
        of = "type plug slave { format S16_LE rate 48000 channels %d pcm { %s } }"
        source = f'type file slave.pcm.type null file /dev/null infile "{folder}/in.raw" format raw'
        sink = f'type file slave.pcm.type null file "{folder}/out.raw" format raw'
        text = asound_conf(
            settings,
            "{ " + of % (settings.microphone.channels, source) + " }",
            "{ " + of % (channels, sink) + " }",
        )
        (folder / "a.conf").write_text(text)

    def run(self, *command: str) -> None:
        done = subprocess.run(
            command, env={**os.environ, "ALSA_CONFIG_PATH": f"{SYSTEM}:{self.folder}/a.conf"},
            capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr

    def record(self, pcm: str, samples: np.ndarray) -> np.ndarray:
        """What a program hears at `pcm` while `samples` (n,) or (n, channels) are spoken."""
        (samples * 32767).astype("<i2").tofile(self.folder / "in.raw")
        wav = self.folder / "heard.wav"
        self.run("arecord", "-D", pcm, "-f", "S16_LE", "-r", "48000", "-d", "1", str(wav))
        return read_wav(wav)[0]

    def play(self, samples: np.ndarray) -> np.ndarray:
        (samples * 32767).astype("<i2").tofile(self.folder / "play.raw")
        arguments = ("-f", "S16_LE", "-r", "48000", "-c", "1", "-t", "raw")
        self.run("aplay", "-D", "hypermask_loudspeaker", *arguments, f"{self.folder}/play.raw")
        return np.fromfile(self.folder / "out.raw", "<i2").astype(float) / 32768


@libasound
def test_the_analysis_hears_the_microphone_untouched(tmp_path: Path) -> None:
    said = tone(300, -70)
    heard = Bench(tmp_path, sound()).record("hypermask_mic", said)
    np.testing.assert_allclose(heard, said[: len(heard)], atol=1e-4)


@libasound
@plugins
def test_the_gate_lets_the_voice_through_and_shuts_out_the_stage(tmp_path: Path) -> None:
    bench = Bench(tmp_path, sound())
    assert level_db(bench.record("hypermask_voice", tone(300, -12))) == pytest.approx(-12, abs=1)
    assert level_db(bench.record("hypermask_voice", tone(300, -60))) < -90


@libasound
@plugins
def test_a_notch_takes_one_frequency_out(tmp_path: Path) -> None:
    bench = Bench(tmp_path, sound(notches=[{"hz": 1250}, {"hz": 2500}]))
    for hz in (1250, 2500):
        assert level_db(bench.record("hypermask_voice", tone(hz, -6))) < -6 - 35
    for hz in (600, 5000):
        heard = level_db(bench.record("hypermask_voice", tone(hz, -6)))
        assert heard == pytest.approx(-6, abs=1)


@libasound
@plugins
@pytest.mark.parametrize("channels", [1, 2, 6])
def test_the_limiter_holds_on_every_channel(tmp_path: Path, channels: int) -> None:
    bench = Bench(tmp_path, sound(channels=channels, gain_db=12.0, limiter={"limit_db": -6.0}))
    loud = bench.play(tone(440, -3)).reshape(-1, channels)
    assert np.abs(loud).max(axis=0).min() > 0.45
    assert np.abs(loud).max() <= 10 ** (-6 / 20) + 1e-3
    soft = bench.play(tone(440, -40)).reshape(-1, channels)
    for channel in soft.T:
        assert level_db(channel) == pytest.approx(-28, abs=0.5)


@libasound
def test_without_gate_notches_and_limiter_nothing_but_alsa_is_needed(tmp_path: Path) -> None:
    plain = sound(gate={"on": False}, limiter={"on": False}, gain_db=-6.0)
    assert "ladspa" not in asound_conf(plain)
    bench = Bench(tmp_path, plain)
    assert level_db(bench.record("hypermask_voice", tone(300, -12))) == pytest.approx(-12, abs=0.1)
    assert level_db(bench.play(tone(300, -12)).reshape(-1, 2)[:, 1]) == pytest.approx(-18, abs=0.1)


@libasound
@plugins
def test_the_right_one_of_several_channels_is_the_voice(tmp_path: Path) -> None:
    settings = SoundSettings.model_validate({"microphone": {"channels": 2, "channel": 1}})
    said = np.column_stack([tone(500, -3), tone(300, -12)])
    heard = Bench(tmp_path, settings).record("hypermask_voice", said)
    assert level_db(heard) == pytest.approx(-12, abs=1)


@libasound
def test_the_shared_microphone_itself_is_understood(tmp_path: Path) -> None:
    """Without a card dsnoop must fail for the card's sake only."""
    (tmp_path / "a.conf").write_text(asound_conf(SoundSettings()))
    done = subprocess.run(
        ["arecord", "-D", "hypermask_mic", "-d", "1", "/dev/null"],
        env={**os.environ, "ALSA_CONFIG_PATH": f"{SYSTEM}:{tmp_path}/a.conf"},
        capture_output=True, text=True, timeout=30,
    )  # fmt: skip
    if done.returncode == 0:
        pytest.skip("this machine has a card of that name")
    assert re.search("card|slave", done.stderr) and "nknown" not in done.stderr
    for word in ("hypermask_mic", "hypermask_voice", "hypermask_loudspeaker"):
        assert f"pcm.{word} " in (tmp_path / "a.conf").read_text()


def test_the_delay_goes_to_alsaloop_less_what_the_limiter_takes() -> None:
    assert "--tlatency=52000 " in environment(sound(delay_ms=57.0))
    assert "--tlatency=57000 " in environment(sound(delay_ms=57.0, limiter={"on": False}))
    assert "--sync=4" in environment(sound())
    assert "--sync=0" in environment(sound(card="hypermask_mic"))


def test_the_shipped_files_are_those_of_the_defaults(tmp_path: Path) -> None:
    write(SoundSettings(), tmp_path)
    shipped = {
        "asound.conf": "configs/sound/asound.conf",
        "loudspeaker.env": "configs/sound/loudspeaker.env",
        "90-hypermask-sound.rules": "configs/udev/90-hypermask-sound.rules",
    }
    assert {path.name for path in tmp_path.iterdir()} == set(shipped)
    for name, path in shipped.items():
        assert (tmp_path / name).read_text() == (ROOT / path).read_text()
    assert load_sound(ROOT / "configs" / "sound" / "sound.toml") == SoundSettings()


def test_the_driver_listens_to_the_shared_microphone() -> None:
    assert f"pcm.{AlsaSettings().device} " in asound_conf(SoundSettings())


def test_a_card_gets_its_name_by_its_socket() -> None:
    settings = SoundSettings.model_validate(
        {"microphone": {"usb": "1-1.2", "card": "mask"}, "loudspeaker": {"usb": "1-1.3"}}
    )
    rules = udev_rules(settings)
    assert 'KERNELS=="1-1.2", ATTR{id}!="mask", ATTR{id}="mask"' in rules
    assert 'KERNELS=="1-1.3", ATTR{id}!="hypermask_out", ATTR{id}="hypermask_out"' in rules


def test_a_machine_without_a_loudspeaker_has_no_environment(tmp_path: Path) -> None:
    write(SoundSettings(), tmp_path)
    write(sound(on=False), tmp_path)
    assert not (tmp_path / "loudspeaker.env").exists()


@pytest.mark.parametrize(
    "table",
    [
        'microphone.card = "1"',
        'microphone.card = "a b"',
        'microphone.card = "x}"',
        "microphone.channel = 1",
        'loudspeaker.usb = "../1"',
        "loudspeaker.delay_ms = 5",
        "loudspeaker.dealy_ms = 50",
    ],
)
def test_settings_that_cannot_be_meant_are_refused(tmp_path: Path, table: str) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(f"[sound]\n{table}\n")
    with pytest.raises(ConfigError):
        load_sound(path)
    assert main(["--machine", str(path), "--out", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "out").exists()


def test_the_offset_is_the_mouth_s_lag_less_the_loudspeaker_s_delay() -> None:
    meter = LipSyncMeter(Loudspeaker(delay_ms=57.0))
    assert meter.measured() is None and meter.record(1.0) is None
    for lag_ms in (50, 60, 70, None, 900):
        meter.add(None if lag_ms is None else lag_ms * 1e-3)
    record = meter.record(12.5)
    assert record is not None and record.dtype == LIP_SYNC
    assert float(record["offset_s"]) == pytest.approx(0.003)
    assert float(record["time_s"]) == 12.5
    assert meter.wanted_delay_ms() == 60.0


@pytest.mark.parametrize(
    ("offset_ms", "verdict"),
    [(0, "together"), (14, "together"), (-44, "together"), (30, "noticeable"),
     (-100, "noticeable"), (46, "apart"), (-130, "apart")],
)  # fmt: skip
def test_the_mouth_behind_the_sound_is_the_bad_side(offset_ms: float, verdict: str) -> None:
    found = LipSync(0.2 + offset_ms * 1e-3, 0.2)
    assert found.verdict == verdict
    assert f"{abs(offset_ms)} ms {'after' if offset_ms >= 0 else 'before'}" in found.sentence()


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="systemd is not installed")
def test_the_unit_is_hardened() -> None:
    unit = str(ROOT / "systemd" / "hypermask-loudspeaker.service")
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=25", unit],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-400:] + done.stderr
    if Path("/usr/bin/alsaloop").exists():
        checked = subprocess.run(
            ["systemd-analyze", "verify", "--man=no", unit],
            capture_output=True,
            text=True,
            timeout=60,
        )
        said = [line for line in checked.stderr.splitlines() if "is not executable" not in line]
        assert not [line for line in said if "hypermask-loudspeaker" in line], checked.stderr


@libasound
def test_the_loudspeakers_card_is_the_one_that_its_unit_chose(tmp_path: Path) -> None:
    (tmp_path / "a.conf").write_text(asound_conf(SoundSettings()))
    for chosen in ({}, {"HYPERMASK_OUT": "hypermask_mic"}):
        done = subprocess.run(
            ["aplay", "-D", "hypermask_out_card", "-d", "1", "/dev/zero"],
            env={**os.environ, "ALSA_CONFIG_PATH": f"{SYSTEM}:{tmp_path}/a.conf", **chosen},
            capture_output=True, text=True, timeout=30,
        )  # fmt: skip
        if done.returncode == 0:
            pytest.skip("this machine has a card of that name")
        assert f"for {chosen.get('HYPERMASK_OUT', 'hypermask_out')}\n" in done.stderr
