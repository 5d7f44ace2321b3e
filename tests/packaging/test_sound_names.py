"""The sound cards' names on their way to udev, and the loudspeaker's choice of a card: scripts of
debian/libexec, run as the services run them, with folders in the place of the kernel's."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from hypermask.loudspeaker.configuration import environment, udev_rules, write
from hypermask.loudspeaker.settings import SoundSettings

ROOT = Path(__file__).parents[2]
RULES = "90-hypermask-sound.rules"


class Machine:
    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.udev, self.cards, self.run = folder / "udev", folder / "cards", folder / "run"
        for path in (folder / "bin", self.cards, self.run / "sound", folder / "shipped"):
            path.mkdir(parents=True)
        for name in ("udevadm", "alsaloop"):
            program = folder / "bin" / name
            program.write_text(f'#!/bin/sh\necho {name} "$@" "$HYPERMASK_OUT" >>{folder}/calls\n')
            program.chmod(0o755)
        shipped = (ROOT / "configs/udev" / RULES).read_text("utf-8")
        (folder / "shipped" / RULES).write_text(shipped, "utf-8")

    def card(self, number: int, name: str, *pcms: str, bus: str = "usb1") -> Path:
        folder = self.folder / "devices" / bus / f"card{number}"
        folder.mkdir(parents=True)
        (self.cards / folder.name).symlink_to(folder)
        for pcm in pcms:
            (folder / f"pcmC{number}D0{pcm}").mkdir(parents=True)
        (folder / "id").write_text(f"{name}\n", "utf-8")
        return folder / "id"

    def given(self, text: str) -> None:
        (self.run / "sound" / RULES).write_text(text, "utf-8")

    def script(self, name: str, **more: str) -> list[str]:
        done = subprocess.run(
            ["sh", str(ROOT / "debian" / "libexec" / name)],
            env={
                "PATH": f"{self.folder}/bin:{os.environ['PATH']}",
                "HYPERMASK_RUN": str(self.run),
                "HYPERMASK_RULES": str(self.folder / "shipped"),
                "HYPERMASK_UDEV": str(self.udev),
                "HYPERMASK_CARDS": str(self.cards),
                "HYPERMASK_WAIT_S": "0",
                "HYPERMASK_OUT": "",
                **more,
            },
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        calls = self.folder / "calls"
        said = calls.read_text("utf-8").splitlines() if calls.exists() else []
        calls.unlink(missing_ok=True)
        return said

    @property
    def in_force(self) -> str | None:
        path = self.udev / "rules.d" / RULES
        return path.read_text("utf-8") if path.exists() else None


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def by_sockets() -> SoundSettings:
    return SoundSettings.model_validate(
        {"microphone": {"usb": "1-1.2"}, "loudspeaker": {"usb": "1-1.3"}}
    )


# --- names ---------------------------------------------------------------------------------------


def test_names_by_socket_reach_udev(machine: Machine) -> None:
    write(by_sockets(), machine.run / "sound")
    said = machine.script("sound-names")
    assert machine.in_force == udev_rules(by_sockets())
    assert [call.split()[1] for call in said] == ["control", "trigger", "settle"]
    assert "--subsystem-match=sound" in said[1]
    assert machine.script("sound-names") == [], "nothing is to be done a second time"


def test_names_are_free_before_they_are_given_anew(machine: Machine) -> None:
    """A card keeps a name from others: two could never be exchanged."""
    write(by_sockets(), machine.run / "sound")
    out = machine.card(1, "hypermask_out", "c", "p")
    mic = machine.card(2, "hypermask_mic", "c", "p")
    on_board = machine.card(0, "hypermask_mic2", "p", bus="pci0")
    # udev, which gives the one its new name and has none for the other.
    udev = machine.folder / "bin/udevadm"
    udev.write_text(
        "#!/bin/sh\n"
        f'[ "$1" != trigger ] || {{ cat {out} {mic} {on_board} >{machine.folder}/before; '
        f"echo hypermask_mic >{out}; }}\n"
    )
    machine.script("sound-names")
    before = (machine.folder / "before").read_text("utf-8").split()
    assert before == ["was_card1", "was_card2", "hypermask_mic2"]
    assert out.read_text("utf-8") == "hypermask_mic\n"
    assert mic.read_text("utf-8") == "hypermask_mic\n", "given back; the kernel refuses it here"


@pytest.mark.parametrize("on", [True, False])
def test_the_shipped_names_need_no_file(machine: Machine, on: bool) -> None:
    write(SoundSettings.model_validate({"loudspeaker": {"on": on}}), machine.run / "sound")
    assert machine.script("sound-names") == [] and machine.in_force is None
    write(by_sockets(), machine.run / "sound")
    machine.script("sound-names")
    write(SoundSettings(), machine.run / "sound")
    assert len(machine.script("sound-names")) == 3 and machine.in_force is None


def test_nothing_but_names_is_taken_from_the_shows_user(machine: Machine) -> None:
    good = 'KERNELS=="1-1.2", ATTR{id}!="mask", ATTR{id}="mask"'
    machine.given(
        f'{good}, RUN+="/bin/sh"\nRUN+="/bin/sh"\n{good}\nIMPORT{{program}}="/tmp/x"\n'
        'KERNELS=="1-1.2", ATTR{id}!="mask", ATTR{id}="$(sh)"\n'
        'KERNELS=="*", ATTR{id}!="mask", ATTR{id}="mask"\nLABEL="x", RUN+="/bin/sh"\n'
    )
    machine.script("sound-names")
    assert machine.in_force is not None
    shipped = (ROOT / "configs/udev" / RULES).read_text("utf-8").splitlines()
    assert [line for line in machine.in_force.splitlines() if line not in shipped] == [good]
    assert machine.in_force.splitlines()[1:4] == shipped[1:4]


@pytest.mark.parametrize(
    "table",
    [
        {},
        {"microphone": {"usb": "1-1.2"}},
        {"loudspeaker": {"usb": "3-2"}},
        {"loudspeaker": {"card": "stage"}},
        {"microphone": {"usb": "1-1.2", "card": "a"}, "loudspeaker": {"usb": "1-1.2", "card": "a"}},
    ],
)
def test_every_line_that_is_written_gets_through(
    machine: Machine, table: dict[str, object]
) -> None:
    sound = SoundSettings.model_validate(table)
    machine.given(udev_rules(sound))
    machine.script("sound-names")
    shipped = (ROOT / "configs/udev" / RULES).read_text("utf-8")
    assert (machine.in_force or shipped) == udev_rules(sound)


def named(sound: SoundSettings, socket: str, pcms: str) -> str:
    """What udev makes of the rules for a USB card with these PCMs in this socket."""
    name = "as it was"
    for line in udev_rules(sound).splitlines():
        usb = re.search(r'KERNELS=="([^"]+)"', line)
        there = re.findall(r'TEST=="pcmC%nD0(.)"', line)
        absent = re.findall(r'TEST!="pcmC%nD0(.)"', line)
        if not line.startswith(("KERNELS", "SUBSYSTEMS")) or (usb and usb[1] != socket):
            continue
        if set(there) <= set(pcms) and not set(absent) & set(pcms):
            if "GOTO" in line:
                return name
            name = re.findall(r'ATTR\{id\}="([^"]+)"', line)[0]
    return name


def test_one_interface_for_both_is_the_microphone() -> None:
    plain = SoundSettings()
    assert named(plain, "1-1", "cp") == named(plain, "1-1", "c") == "hypermask_mic"
    assert named(plain, "1-1", "p") == "hypermask_out"


def test_a_socket_says_which_is_which_of_two_interfaces_for_both() -> None:
    only_mic = SoundSettings.model_validate({"microphone": {"usb": "1-1.2"}})
    only_out = SoundSettings.model_validate({"loudspeaker": {"usb": "1-1.3"}})
    for sound in (only_mic, only_out, by_sockets()):
        assert named(sound, "1-1.2", "cp") == "hypermask_mic"
        assert named(sound, "1-1.3", "cp") == "hypermask_out"
    assert named(by_sockets(), "1-1.4", "cp") == "as it was"


# --- the loudspeaker -----------------------------------------------------------------------------


def variables(sound: SoundSettings) -> dict[str, str]:
    lines = environment(sound).splitlines()
    return {key: value.strip('"') for key, _, value in (line.partition("=") for line in lines)}


def test_the_voice_comes_out_of_the_loudspeakers_card(machine: Machine) -> None:
    machine.card(0, "hypermask_mic", "c", "p")
    machine.card(1, "hypermask_out", "p")
    (said,) = machine.script("loudspeaker", **variables(SoundSettings()))
    assert said.startswith("alsaloop --cdevice=hypermask_voice")
    assert said.split()[-1] == "hypermask_out"


def test_one_interface_for_both_is_the_loudspeaker_too(machine: Machine) -> None:
    machine.card(0, "PCH", "p", bus="pci0")
    machine.card(1, "hypermask_mic", "c", "p")
    (said,) = machine.script("loudspeaker", **variables(SoundSettings()))
    assert said.split()[-1] == "hypermask_mic"


def test_a_card_that_cannot_play_or_is_not_meant_stays_silent(machine: Machine) -> None:
    machine.card(1, "hypermask_mic", "c")
    (said,) = machine.script("loudspeaker", **variables(SoundSettings()))
    assert said.split()[-1] == "hypermask_out"
    machine.card(2, "hypermask_mic", "c", "p")
    (said,) = machine.script("loudspeaker", **variables(by_sockets()))
    assert said.split()[-1] == "hypermask_out"


def test_the_names_are_installed_as_root_and_go_with_the_package() -> None:
    unit = (ROOT / "systemd/hypermask-sound.service").read_text("utf-8")
    assert "\nExecStartPost=-+/usr/libexec/hypermask/sound-names\n" in unit
    postrm = (ROOT / "debian/hypermask.postrm").read_text("utf-8")
    assert f"rm -f /run/udev/rules.d/{RULES}" in postrm
