"""A show on the virtual cart, from outside: what it sees and hears, its picture, its processes."""

from __future__ import annotations

import contextlib
import json
import re
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from stage_references import Cart, Image, Place, Verdict, is_lit, judge, likeness

from hypermask_drivers.clock import RealClock
from hypermask_drivers.errors import HypermaskError
from hypermask_sim.appliance.image import Image as Disk
from hypermask_sim.appliance.qemu import Machine, VirtualCart
from hypermask_sim.appliance.watch import Glance, Watcher, dark_moments, longest_freeze_s
from hypermask_sim.emulators.ptu import PtuData, PtuUnit
from hypermask_sim.emulators.ptu_line import PtuLine

T = TypeVar("T")

ROOT = Path(__file__).parents[2]
CART = Cart()
PLACE = Place()
WORKERS = ("stage", "tracker", "voice", "pantilt", "show", "dresser")
PLAYER_HZ = 15
SWAY_S = 12.0
"""Slow enough for steps at the player's rate to look like a motion."""
ASK_S = 2.0
"""Between two questions to the guest; each costs its processors about a second."""
WALL_FACTOR = 60
"""A guest second may take so many of the host's; only a machine that stands still is given up."""
_QUICK: dict[str, Any] = {
    "kernel_arguments": ("init=/usr/local/lib/cart/quick",), "slowness": 1.0, "nice": 10
}  # fmt: skip
NO_LIGHT = 0.0005
"""Share of lit pixels up to which the picture is dark."""


class NotInTime(AssertionError):
    """Something did not happen within its guest time."""


class VirtualShow:
    """One machine with its light, its pan-tilt unit and a watcher of its picture.

    work: a folder of its own, emptied. keep_disk: what is written outlives a power cut. show: else
    the machine boots no further than to a look at its disk, as quickly as it can.
    """

    def __init__(self, disk: Disk, work: Path, keep_disk: bool = False, show: bool = True) -> None:
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        self.work = work
        self.line = PtuLine(PtuUnit(PtuData()), RealClock(), work / "ptu")
        self.line.do(lambda unit, now_s: unit.power_cycle(now_s))
        self.line.plug()
        machine = Machine(
            disk,
            work,
            ROOT,
            screen=(CART.width, CART.height),
            ptu=work / "ptu",
        )
        machine = machine.own_disk(work / "disk.qcow2") if keep_disk else machine
        self._machine = machine if show else replace(machine, **_QUICK)
        self.light(CART.frames(PLACE))
        self.silence()
        self.switch_on()

    def switch_on(self) -> None:
        self.cart = VirtualCart(self._machine)
        self.watcher = Watcher(self.cart.second_monitor())
        self.watcher.start()

    def with_a_show(self) -> None:
        """From the next start on."""
        usual = Machine(self._machine.image, self.work, ROOT)
        self._machine = replace(self._machine, **{name: getattr(usual, name) for name in _QUICK})

    def power_cut(self) -> None:
        self.watcher.stop()
        self.cart.power_cut()

    def close(self) -> None:
        self.power_cut()
        self.line.close()
        (self.work / "disk.qcow2").unlink(missing_ok=True)

    # What it sees and hears

    def light(self, frames: bytes) -> None:
        """The LEDs as the camera sees them from now on."""
        _put(self.work / "leds.grey", frames)

    def hold(self, place: Place) -> None:
        self.light(CART.frames(place))

    def sway(self, place: Place = PLACE) -> None:
        self.light(CART.moving_frames(place, PLAYER_HZ, SWAY_S))

    def silence(self, seconds: float = 2.0) -> None:
        self.sound(np.zeros(round(16000 * seconds)))

    def sound(self, samples: np.ndarray) -> None:
        """samples: (n,) -1 to 1 at 16 kHz, played again and again from the next start on."""
        import wave

        path = self.work / "voice.part"
        with wave.open(str(path), "wb") as file:
            file.setnchannels(1)
            file.setsampwidth(2)
            file.setframerate(16000)
            file.writeframes((samples * 32767).astype("<i2").tobytes())
        path.rename(self.work / "voice.wav")

    # Waiting, in the guest's time

    def until(
        self, found: Callable[[], T | None], guest_s: float, what: str, pause_s: float = 0.3
    ) -> T:
        """The first answer of `found` that is not None or False; `NotInTime` without one."""
        start_s, began = self.watcher.now_s, time.monotonic()
        while True:
            answer = found()
            if answer is not None and answer is not False:
                return answer
            spent_s = self.watcher.now_s - start_s
            if spent_s > guest_s or time.monotonic() - began > guest_s * WALL_FACTOR:
                raise NotInTime(f"{what}: not within {guest_s:.0f} s of the guest's time")
            time.sleep(pause_s)

    def rest(self, guest_s: float) -> None:
        end_s = self.watcher.now_s + guest_s
        self.until(lambda: self.watcher.now_s >= end_s, guest_s + 60, "time passes", 0.05)

    # The picture

    def picture(self) -> Image:
        return self.cart.screenshot("screen")

    def shows(
        self, place: Place, character: str = "mean", cue: str = "neutral", guest_s: float = 60
    ) -> tuple[Image, Verdict]:
        """Wait until the face is where it must be, of that character, with that expression."""
        wanted = CART.reference(place, character, cue)
        seen: list[Verdict] = []

        def there() -> tuple[Image, Verdict] | None:
            picture = self.picture()
            verdict = judge(picture, wanted)
            seen.append(verdict)
            at_its_place = verdict.overlap > 0.9 and verdict.shift_px < 3
            right = (
                at_its_place
                and self.who(picture, place, cue) == character
                and self.mood(picture, place, character) == cue
            )
            return (picture, verdict) if right else None

        try:
            return self.until(there, guest_s, f"{character}, {cue}, at {place}")
        except NotInTime as error:
            raise NotInTime(f"{error}; last seen: {seen[-1]}") from None

    @staticmethod
    def who(picture: Image, place: Place, cue: str = "neutral") -> str:
        """Which character of the show the picture is most like."""
        names = CART.show.characters
        return max(names, key=lambda name: likeness(picture, CART.reference(place, name, cue)))

    @staticmethod
    def mood(picture: Image, place: Place, character: str) -> str:
        """Which of the expressions that differ clearly the picture is most like."""
        cues = ("neutral", "anger", "surprise")
        return max(cues, key=lambda cue: likeness(picture, CART.reference(place, character, cue)))

    def dark(self, guest_s: float = 60) -> Image:
        def nothing() -> Image | None:
            picture = self.picture()
            return picture if is_lit(picture).mean() <= NO_LIGHT and has_mode(picture) else None

        return self.until(nothing, guest_s, "darkness")

    def face(self, guest_s: float = 60) -> Image:
        """Wait until there is any face."""

        def light() -> Image | None:
            picture = self.picture()
            return picture if is_lit(picture).mean() > 0.01 and has_mode(picture) else None

        return self.until(light, guest_s, "a face")

    @contextlib.contextmanager
    def never_frozen(self, longest_s: float = 1.0) -> Iterator[None]:
        """Within it no lit picture may stand for longer than `longest_s` of guest time."""
        start_s = self.watcher.now_s
        yield
        frozen_s = longest_freeze_s(self.looks_since(start_s))
        assert frozen_s <= longest_s, f"the picture stood for {frozen_s:.2f} s of guest time"

    @contextlib.contextmanager
    def never_dark(self) -> Iterator[None]:
        """Nor may the picture be missing."""
        start_s = self.watcher.now_s
        with self.never_frozen():
            yield
        glances = self.looks_since(start_s)
        dark = dark_moments(glances)
        assert not dark, f"{len(dark)} of {len(glances)} looks found no picture: {dark[:20]}"

    def looks_since(self, start_s: float) -> list[Glance]:
        glances = self.watcher.between(start_s, self.watcher.now_s)
        assert glances, "nobody looked at the picture"
        return glances

    # Inside

    def run(self, command: str, guest_s: float = 60, check: bool = True) -> str:
        return self.cart.run(command, timeout_s=guest_s * WALL_FACTOR, check=check)

    def journal(self, lines: int = 200) -> str:
        return self.run(
            f"journalctl -b --no-pager -o short-monotonic -u 'hypermask*' -n {lines}", check=False
        )

    def worker(self, name: str) -> Worker:
        told = self.run(
            f"systemctl show hypermask-{name} "
            "-p MainPID,ActiveState,SubState,NRestarts,Result,StatusText",
            check=False,
        )
        values = dict(line.split("=", 1) for line in told.splitlines() if "=" in line)
        return Worker(
            name, int(values.get("MainPID", 0)), values.get("ActiveState", ""),
            int(values.get("NRestarts", 0) or 0), values.get("StatusText", ""),
        )  # fmt: skip

    def working(self, name: str, not_pid: int = 0, guest_s: float = 120) -> Worker:
        """Wait until a worker runs (again), told to systemd by itself."""

        def runs() -> Worker | None:
            worker = self.worker(name)
            return worker if worker.state == "active" and worker.pid not in (0, not_pid) else None

        return self.until(runs, guest_s, f"{name} works", ASK_S)

    def all_work(self, guest_s: float = 240) -> dict[str, Worker]:
        return {name: self.working(name, guest_s=guest_s) for name in WORKERS}

    def press(self, key: str) -> None:
        self.cart.press(key)

    def press_until(self, key: str, place: Place, cue: str) -> None:
        """As a player does whose key was not heard: a show that has just begun may not have opened
        its keypad yet."""
        for _ in range(2):
            self.press(key)
            with contextlib.suppress(NotInTime):
                self.shows(place, cue=cue, guest_s=10)
                return
        self.press(key)
        self.shows(place, cue=cue)

    def mark(self) -> float:
        """Now, on the clock of the journal."""
        return float(self.run("cat /proc/uptime").split()[0])

    def told(self, code: str, since: float, guest_s: float = 60) -> str:
        """Wait until the journal has a message with this code after `since`; the message."""

        def found() -> str | None:
            lines = self.run(
                "journalctl -b --no-pager -o short-monotonic -u 'hypermask*' -n 2000 | "
                f"grep -F {code!r} | tail -n 5; true"
            )
            for line in lines.splitlines():
                stamped = re.match(r"\[\s*([\d.]+)\] (.*)", line)
                if stamped and float(stamped[1]) >= since:
                    return stamped[2]
            return None

        return self.until(found, guest_s, f"the message {code}", ASK_S)

    def leaks(self) -> dict[str, float]:
        """What must not grow: open files and memory of each worker, files in /run, zombies."""
        script = (
            "import json,os,glob\n"
            "r={}\n"
            "for p in glob.glob('/proc/[0-9]*'):\n"
            "  try:\n"
            "    a=open(p+'/cmdline').read().split(chr(0))\n"
            "    s=open(p+'/status').read()\n"
            "    if 'hypermask.services' in a:\n"
            "      n=a[a.index('hypermask.services')+1]\n"
            "      r['fds '+n]=len(os.listdir(p+'/fd'))\n"
            "      r['kB '+n]=int(s.split('VmRSS:')[1].split()[0])\n"
            "    if 'State:\\tZ' in s: r['zombies']=r.get('zombies',0)+1\n"
            "  except (OSError,IndexError): pass\n"
            "r['files in /run']=sum(len(f) for d,_,f in os.walk('/run/hypermask')"
            " if '/versions' not in d)\n"
            "print(json.dumps(r))\n"
        )
        _put(self.work / "leaks.py", script.encode())
        found = self.run("python3 /host/leaks.py")
        return {"zombies": 0, **json.loads(found.strip().splitlines()[-1])}


@dataclass(frozen=True)
class Worker:
    name: str
    pid: int
    state: str
    restarts: int
    status: str


def _put(path: Path, data: bytes) -> None:
    part = path.with_name(f"{path.name}.part")
    part.write_bytes(data)
    part.rename(path)


def has_mode(picture: Image) -> bool:
    """Whether it is the projector's, and not QEMU's own while there is no mode."""
    return picture.shape[:2] == (CART.height, CART.width)


def codes(text: str) -> set[str]:
    """The stable codes of the messages in a log."""
    return set(re.findall(r"\b[A-Z]{3,6}-[A-Z]+\b", text))


__all__ = ["HypermaskError", "NotInTime", "VirtualShow", "Worker", "codes"]
