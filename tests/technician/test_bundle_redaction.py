"""The bundle for support: nothing that was planted comes out, what helps does."""

from __future__ import annotations

import io
import json
import socket
import stat
import tarfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from hypermask.errors import HypermaskError
from hypermask.technician import bundle, redact

SECRETS = (
    "hunter2-correct-horse", "sk-live-51HxyzABCDEF",  # known by what stands before them
    "S3cr3tPsk!", "GrandTheatreBackstage",
    "anna.smith@example.org", "192.168.17.44", "fe80::1c2d:3eff:fe4f:5a6b", "2001:db8:85a3::8a2e",
    "b8:27:eb:12:34:56", "WXYZ-SN-00417", "0000000012ab34cd", "theatre-kyoto-7",
    "4f1c9a7e2b6d4c0e9f8a7b6c5d4e3f2a", "annasmith", "anna-as-queen", "Anna Smith",
    "1b4e28ba-2fa1-11d2-883f-0016d3cca427", "other-theatre.example",
)  # fmt: skip
"""What is planted everywhere; none of it may come out."""


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A machine full of what is nobody's business."""
    with pytest.MonkeyPatch.context() as patch:
        yield plant(tmp_path_factory.mktemp("machine"), patch)


def plant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    home, run, etc = (tmp_path / name for name in ("home", "run", "etc"))
    for name, folder in (("HOME", home), ("RUN", run), ("ETC", etc)):
        monkeypatch.setenv(f"HYPERMASK_{name}", str(folder))
        folder.mkdir()
    monkeypatch.setattr(socket, "gethostname", lambda: "theatre-kyoto-7")
    monkeypatch.setattr(redact, "_people", lambda: ["annasmith", "Anna Smith"])
    monkeypatch.setattr(redact, "_serials", lambda root: ["WXYZ-SN-00417", "0000000012ab34cd"])
    monkeypatch.setattr(redact, "_networks", lambda root: ["GrandTheatreBackstage", "S3cr3tPsk!"])
    _photographs(home, run)
    (etc / "machine.toml").write_text(
        '# wifi password: hunter2-correct-horse\nmachine = "sim"\nname = "GrandTheatreBackstage"\n'
        '[stream.send]\nhost = "other-theatre.example"\n'
    )
    events = run / "events"
    events.mkdir(exist_ok=True)
    lines = [_event(f"NET-TEST: here is {secret} in the middle") for secret in SECRETS[2:]]
    lines.append(_event("WIFI: psk=hunter2-correct-horse ssid='GrandTheatreBackstage'"))
    lines.append(_event("PHOTO-FORMAT: the photo /media/usb/Anna Smith holiday.jpeg is none"))
    lines.append(_event("CHAR-JOINS: The character 'anna-as-queen' joins the show."))
    lines.append(_event("CAM-LOST: the camera vanished"))
    (events / "show.jsonl").write_text(
        "\n".join([*lines, "not json hunter2-correct-horse", "\x1b[2J"])
    )
    return tmp_path


def _event(text: str) -> str:
    entry = {
        "time_s": 1.0,
        "wall_s": 1e9,
        "worker": "show",
        "priority": 4,
        "code": "X",
        "text": text,
    }
    return json.dumps(entry)


def _photographs(home: Path, run: Path) -> None:
    picture = np.random.default_rng(3).integers(0, 255, (64, 64, 3), np.uint8)
    character = home / "characters" / "anna-as-queen"
    voices = home / "voices"
    for folder in (character, voices, run / "events", home / "faults", home / "calibration"):
        folder.mkdir(parents=True, exist_ok=True)
    data = cv2.imencode(".jpg", picture)[1].tobytes()
    for path in (
        character / "photo.jpg", character / "texture.png", run / "events" / "show.jsonl.1",
        home / "faults" / "000001-x.json", home / "calibration" / "0001-click.json",
    ):  # fmt: skip
        path.write_bytes(data)
    (voices / "annasmith.json").write_text(json.dumps({"secret": "hunter2-correct-horse"}))
    fault = {"unit": "hypermask-show", "last": ["token=sk-live-51HxyzABCDEF", "Anna Smith"]}
    (home / "faults" / "000002-y.json").write_text(json.dumps(fault))


def commands(command: Sequence[str]) -> tuple[int, str]:
    """What systemd, the kernel and dpkg would say."""
    name = command[0]
    if name == "journalctl":
        return 0, "\n".join(
            json.dumps(
                {"MESSAGE": f"<4>{secret} was here", "__REALTIME_TIMESTAMP": "1000000000000000",
                 "_SYSTEMD_UNIT": "hypermask-show.service", "_HOSTNAME": "theatre-kyoto-7"}
            )
            for secret in ("password=hunter2-correct-horse", *SECRETS[2:])
        )  # fmt: skip
    if name == "dmesg":
        return 0, (
            "[1.0] usb 1-1: SerialNumber: QQ77-XX-99\n[2.0] wlan0: SSID=GrandTheatreBackstage\n"
            "[3.0] eth0: 192.168.17.44 b8:27:eb:12:34:56\n"
            "[4.0] uvcvideo 1-1: Found UVC 1.00 device\n"
            "[5.0] Kernel command line: root=PARTUUID=1b4e28ba-2fa1-11d2-883f-0016d3cca427 quiet\n"
        )
    if name == "dpkg-query":
        return 0, "hypermask 0.1.0.1 installed\n"
    return 0, " ".join(SECRETS[2:])


@pytest.fixture(scope="module")
def opened(planted: Path) -> dict[str, str]:
    out = planted / "b.tar.gz"
    bundle.make(out, commands)
    with tarfile.open(out) as archive:
        files = {}
        for member in archive:
            file = archive.extractfile(member)
            assert file is not None and member.isfile() and not member.name.startswith("/")
            assert (member.uid, member.uname) == (0, "")
            files[member.name.removeprefix("hypermask-bundle/")] = file.read().decode()
    return files


@pytest.mark.parametrize("secret", [*SECRETS, "QQ77-XX-99", "anna", "holiday"])
def test_nothing_that_was_planted_comes_out(opened: dict[str, str], secret: str) -> None:
    found = [name for name, text in opened.items() if secret.casefold() in text.casefold()]
    assert not found, f"{secret} in {found}"


def test_no_photograph_and_no_recording_is_in_it(planted: Path, opened: dict[str, str]) -> None:
    names = set(opened)
    assert all(name.endswith((".txt", ".json", ".toml")) for name in names)
    packed = (planted / "b.tar.gz").read_bytes()
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        everything = b"".join(
            file.read() for member in archive if (file := archive.extractfile(member))
        )
    for start in (b"\xff\xd8\xff", b"\x89PNG", b"RIFF"):
        assert start not in everything
    assert "JFIF" not in everything.decode(errors="replace")


def test_what_helps_is_still_there(opened: dict[str, str]) -> None:
    assert "CAM-LOST: the camera vanished" in opened["events.txt"]
    assert "PHOTO-FORMAT" in opened["events.txt"]
    assert "Found UVC 1.00 device" in opened["kernel.txt"]
    assert 'driver = "sim"' in opened["config.toml"]
    assert json.loads(opened["characters.json"])["made_here"] == 1
    assert {found["check"] for found in json.loads(opened["doctor.json"])} > {"disk", "graphics"}
    assert "Python 3" in opened["versions.txt"] and "numpy" in opened["versions.txt"]
    assert "hypermask 0.1.0.1 installed" in opened["versions.txt"]
    assert "hypermask-show" in opened["faults.json"]


def test_terminal_tricks_do_not_survive(opened: dict[str, str]) -> None:
    assert not any("\x1b" in text for text in opened.values())


def test_only_its_maker_may_read_it(planted: Path, opened: dict[str, str]) -> None:
    assert stat.S_IMODE((planted / "b.tar.gz").stat().st_mode) == 0o600


def test_a_machine_on_which_nothing_works_still_gives_a_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("HOME", "RUN", "ETC"):
        monkeypatch.setenv(f"HYPERMASK_{name}", str(tmp_path / "none"))
    monkeypatch.setattr(bundle, "_doctor", lambda: 1 / 0)
    parts = bundle.make(tmp_path / "b.tar.gz", lambda command: (127, "no such program"))
    assert len(parts) >= 12
    with tarfile.open(tmp_path / "b.tar.gz") as archive:
        file = archive.extractfile("hypermask-bundle/status.json")
        assert file is not None and b"SHOW-NONE" in file.read()


def test_a_place_that_cannot_be_written_is_told(planted: Path) -> None:
    (planted / "file").write_text("")
    with pytest.raises(HypermaskError, match="DISK-WRITE"):
        bundle.make(planted / "file" / "b.tar.gz", commands)
