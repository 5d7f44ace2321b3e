"""The driver on the real libasound, with PCMs that need no sound card."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hypermask_drivers.sound.alsa_library import load

pytest.importorskip("alsaaudio", reason="pyalsaaudio is not installed")
SYSTEM = Path("/usr/share/alsa/alsa.conf")
if not SYSTEM.exists():
    pytest.skip("libasound's configuration is not installed", allow_module_level=True)

READ = """
import json, sys
from hypermask_drivers.errors import DeviceError
from hypermask_drivers.sound.alsa import AlsaSettings, AlsaSoundIn
settings = AlsaSettings.model_validate(json.loads(sys.argv[1]))
driver = AlsaSoundIn(settings)
try:
    driver.open()
    blocks = [driver.read(0.5) for _ in range(8)]
except DeviceError as error:
    print(json.dumps({"code": error.code}))
    sys.exit()
print(json.dumps({
    "samples": [float(x) for block in blocks for x in block.samples],
    "rate": driver.rate_hz, "times": [block.time_s for block in blocks],
    "format": driver.status.format, "channels": driver.status.channels,
}))
driver.close()
driver.close()
"""


def read(tmp_path: Path, pcm: str, **settings: object) -> dict:
    """In a process of its own, as libasound reads its configuration once."""
    import json

    config = tmp_path / "asound.conf"
    config.write_text(pcm)
    environment = {**os.environ, "ALSA_CONFIG_PATH": f"{SYSTEM}:{config}"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    done = subprocess.run(
        [sys.executable, "-c", READ, json.dumps(settings)],
        env=environment, capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert done.stderr == ""  # what libasound says besides is hushed
    return json.loads(done.stdout)


def from_file(path: Path, form: str = "S16_LE") -> str:
    return (
        f"pcm.recorded {{ type file slave.pcm.type null file /dev/null"
        f' infile "{path}" format "raw" }}'
    )


def test_a_recorded_stream_arrives_sample_for_sample(tmp_path: Path) -> None:
    sound = (np.arange(20000) % 30000 - 15000).astype("<i2")
    sound.tofile(tmp_path / "in.raw")
    found = read(tmp_path, from_file(tmp_path / "in.raw"), device="recorded")
    heard = np.array(found["samples"]) * 2**15
    at = int(heard[0]) + 15000  # the read that starts a stream may take a period along
    np.testing.assert_array_equal(heard, sound[at : at + len(heard)])
    assert at in (0, 192) and found["format"] == "S16_LE"
    assert np.isfinite(found["times"]).all()


@pytest.mark.parametrize("form", ["S16_LE", "S32_LE", "S24_3LE", "FLOAT_LE"])
def test_192_khz_stereo_in_every_format(tmp_path: Path, form: str) -> None:
    from hypermask_sim.emulators.alsa import encode

    wave = 0.5 * np.sin(np.arange(60000) / 50)
    (tmp_path / "in.raw").write_bytes(encode(np.column_stack([wave, 0 * wave]), form))
    settings = {"device": "recorded", "rate_hz": 192000, "channels": 2, "channel": 0}
    found = read(tmp_path, from_file(tmp_path / "in.raw"), format=form, **settings)
    assert (found["rate"], found["channels"], found["format"]) == (192000, 2, form)
    heard = np.array(found["samples"])
    at = 0 if abs(heard[0] - wave[0]) < 1e-3 else 768
    np.testing.assert_allclose(heard, wave[at : at + len(heard)], atol=2**-15)


@pytest.mark.parametrize("device", ["hw:CARD=nobody_s_card", "no_such_pcm"])
def test_a_card_that_is_not_there_is_absent(tmp_path: Path, device: str) -> None:
    assert read(tmp_path, "", device=device) == {"code": "SND-ABSENT"}


def test_the_installed_binding_has_what_the_driver_needs() -> None:
    pcm = load().PCM
    for name in ("avail", "htimestamp", "info", "polldescriptors", "set_tstamp_type"):
        assert hasattr(pcm, name)
