"""Runs the virtual cart: boots a disk in QEMU, runs commands in it, looks at its screen.

Emulated without hardware acceleration (TCG), so it runs anywhere; function can be judged there,
speed cannot. The guest sees two folders of the host: /host (written by both) and /source (read
only). What it writes on its disk is dropped at the end, unless the disk is a copy of one's own.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from hypermask_drivers.errors import HypermaskError
from hypermask_sim.appliance.guest import PORT_NAME
from hypermask_sim.appliance.image import Image
from hypermask_sim.appliance.monitor import Lines, Monitor

_KERNEL_LINE = (
    # Without mitigations: each system call would flush the emulated TLB, and nothing is guarded.
    # Nor with the check of the timer, which counts on a processor that nobody else's load stops:
    # on a busy host the kernel panics there.
    "root=/dev/vda rw console=ttyS0 quiet loglevel=3 systemd.show_status=false"
    " vt.global_cursor_default=0 mitigations=off no_timer_check"
)
_PANIC = re.compile(r"^\[ *(\d+\.\d+)\] Kernel panic - ", re.M)
_NO_DISK_YET_S = 1.5
_LOOK_S = 5.0
_SOCKETS = ("agent.sock", "qmp.sock", "watch.sock")
_USB = "usb"
KEYPAD = {"driver": "usb-kbd", "id": "keypad", "bus": f"{_USB}.0"}
PTU = {"driver": "usb-serial", "id": "ptu", "chardev": "ptu", "bus": f"{_USB}.0"}
"""USB devices that can be pulled and plugged in again."""
QCODES = {
    **{str(digit): f"kp_{digit}" for digit in range(10)},
    "dot": "kp_decimal", "enter": "kp_enter", "plus": "kp_add", "minus": "kp_subtract",
    "star": "kp_multiply", "slash": "kp_divide", "numlock": "num_lock", "backspace": "backspace",
}  # fmt: skip
"""QEMU's names of the keypad's keys."""


@dataclass(frozen=True)
class Machine:
    """work: folder for sockets, logs and pictures, seen by the guest as /host; source: what it sees
    as /source; disk: one over the image's that keeps what is written (made by `own_disk`),
    else that is dropped; ptu: host end of the pan-tilt unit's line; extra: further
    arguments of QEMU; kernel_arguments: added to the kernel's line.

    slowness: the host's seconds in one of the guest's. An emulated processor is slow; by a clock
    that is slower still it is fast enough for a show, and no time limit needs another value.
    nice: how much it gives way to others on the host.
    """

    image: Image
    work: Path
    source: Path
    memory_mb: int = 2048
    slowness: float = 8.0
    nice: int = 0
    screen: tuple[int, int] = (1280, 800)
    disk: Path | None = None
    ptu: Path | None = None
    extra: Sequence[str] = ()
    kernel_arguments: Sequence[str] = field(default_factory=tuple)

    def command(self) -> list[str]:
        work = self.work
        width, height = self.screen
        disk = (
            f"file={self.disk},format=qcow2"
            if self.disk
            else f"file={self.image.disk},format=raw,snapshot=on"
        )
        return [
            *(("nice", "-n", str(self.nice)) if self.nice else ()), "qemu-system-x86_64",
            "-machine", "q35", "-accel", "tcg,thread=multi", "-cpu", "Nehalem",
            "-smp", str(os.cpu_count() or 1), "-m", str(self.memory_mb), "-rtc", "clock=vm",
            "-kernel", str(self.image.kernel), "-initrd", str(self.image.initrd),
            "-append", " ".join([_KERNEL_LINE, *self.kernel_arguments]),
            "-drive", f"{disk},if=virtio",
            "-display", "none", "-vga", "none", "-nic", "none",
            "-device", f"virtio-gpu-pci,id=gpu,xres={width},yres={height}",
            "-device", "i6300esb", "-action", "watchdog=reset",
            "-device", f"qemu-xhci,id={_USB}",
            *_as_arguments("-device", KEYPAD),
            *self._ptu(),
            "-serial", f"file:{work / 'console.log'}",
            "-chardev", f"socket,id=agent,path={work / 'agent.sock'},server=on,wait=off",
            "-device", "virtio-rng-pci", "-device", "virtio-serial-pci",
            "-device", f"virtserialport,chardev=agent,name={PORT_NAME}",
            "-qmp", f"unix:{work / 'qmp.sock'},server=on,wait=off",
            "-qmp", f"unix:{work / 'watch.sock'},server=on,wait=off",
            "-virtfs", f"local,path={work},mount_tag=host,security_model=none,id=host",
            "-virtfs", f"local,path={self.source},mount_tag=source,security_model=none,"
            "readonly=on,id=source",
            *self.extra,
        ]  # fmt: skip

    def environment(self) -> dict[str, str]:
        """QEMU's: its clock goes slowly. The guest's kernel measures the cycle counter by it at its
        start and finds that one so much quicker: all of the guest's clocks agree.

        Raises `HypermaskError` APL-TOOL.
        """
        if not list(Path("/usr/lib").glob("*/faketime/libfaketimeMT.so.1")):
            raise HypermaskError("APL-TOOL", "there is no libfaketime", "Install libfaketime.")
        return {
            **os.environ,
            "LD_PRELOAD": "/usr/$LIB/faketime/libfaketimeMT.so.1",
            "FAKETIME": f"+0 x{1 / self.slowness:.6f}",
            "NO_FAKE_STAT": "1",
        }

    def _ptu(self) -> list[str]:
        if self.ptu is None:
            return []
        return ["-chardev", f"serial,id=ptu,path={self.ptu}", *_as_arguments("-device", PTU)]

    def own_disk(self, disk: Path) -> Machine:
        """The same machine with a disk that remembers what is written, over the image's.

        Raises `HypermaskError` APL-TOOL.
        """
        base = ["-b", str(self.image.disk.resolve()), "-F", "raw"]
        try:
            subprocess.run(
                ["qemu-img", "create", "-q", "-f", "qcow2", *base, str(disk)], check=True
            )
        except FileNotFoundError:
            raise HypermaskError(
                "APL-TOOL", "there is no qemu-img", "Install qemu-utils."
            ) from None
        return replace(self, disk=disk)


def stumbles(console: str) -> int:
    """How often the kernel panicked before it had looked at anything but its processor.

    On a busy host QEMU's emulated processors now and then execute an instruction that another of
    them is just patching ("Oops: int3"), as the kernel does in the first second of each start.
    """
    return sum(float(found[1]) < _NO_DISK_YET_S for found in _PANIC.finditer(console))


def _as_arguments(option: str, device: dict[str, str]) -> list[str]:
    rest = (f"{key}={value}" for key, value in device.items() if key != "driver")
    return [option, ",".join([device["driver"], *rest])]


class VirtualCart:
    """A running machine; a context manager that switches it off."""

    def __init__(self, machine: Machine) -> None:
        """Raises `HypermaskError` APL-TOOL or APL-START."""
        if shutil.which("qemu-system-x86_64") is None:
            raise HypermaskError(
                "APL-TOOL", "there is no qemu-system-x86_64", "Install qemu-system-x86."
            )
        self.machine = machine
        machine.work.mkdir(parents=True, exist_ok=True)
        for name in _SOCKETS:
            (machine.work / name).unlink(missing_ok=True)
        self._request = 0
        self.stumbles = 0
        """How often the emulated processor stumbled at the start, and was reset."""
        self._log = (machine.work / "qemu.log").open("wb")
        self._process = subprocess.Popen(
            machine.command(),
            env=machine.environment(),
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
        )
        try:
            self._agent = self._lines("agent.sock")
            self._monitor = Monitor(self._lines("qmp.sock"))
        except BaseException:
            self.power_cut()
            raise

    def _lines(self, name: str) -> Lines:
        deadline = time.monotonic() + 20
        while True:
            link = socket.socket(socket.AF_UNIX)
            with contextlib.suppress(OSError):
                link.connect(str(self.machine.work / name))
                return Lines(link)
            link.close()
            if self._process.poll() is not None or time.monotonic() > deadline:
                raise HypermaskError(
                    "APL-START", "QEMU does not start", f"Read {self.machine.work / 'qemu.log'}."
                )
            time.sleep(0.05)

    # From outside

    def monitor(self, command: str, **arguments: Any) -> Any:
        """A command of QEMU's monitor protocol. Raises `HypermaskError` APL-MONITOR."""
        return self._monitor.run(command, **arguments)

    def wait_event(self, name: str, timeout_s: float) -> dict[str, Any]:
        """The next event of that name, or one that was seen already. Raises `TimeoutError`."""
        return self._monitor.wait_event(name, timeout_s)

    def forget_events(self) -> None:
        self._monitor.forget_events()

    def second_monitor(self) -> Monitor:
        """Another connection, for another thread."""
        return Monitor(self._lines("watch.sock"))

    def screenshot(self, name: str = "screen") -> NDArray[np.uint8]:
        """What the display shows: (height, width, 3) RGB, row 0 at the top; kept as a PNG."""
        picture = self._monitor.screenshot()
        cv2.imwrite(str(self.machine.work / f"{name}.png"), picture[..., ::-1])
        return picture

    def press(self, key: str, hold_s: float = 0.2) -> None:
        """A key of the USB keypad goes down and up again, by its name in `QCODES`."""
        for down in (True, False):
            pressed = {"down": down, "key": {"type": "qcode", "data": QCODES[key]}}
            self.monitor("input-send-event", events=[{"type": "key", "data": pressed}])
            time.sleep(hold_s if down else 0.05)

    def unplug(self, device: dict[str, str]) -> None:
        self.monitor("device_del", id=device["id"])
        self.wait_event("DEVICE_DELETED", 30)

    def plug(self, device: dict[str, str]) -> None:
        self.monitor("device_add", **device)

    def stand_still(self, seconds: float) -> None:
        """As a machine whose disk or memory holds it up: nothing in it goes on, its clocks do.
        seconds: of the host's time."""
        self._process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        self._process.send_signal(signal.SIGCONT)

    def power_cut(self) -> None:
        """As if the plug was pulled. May be called again."""
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._log.close()

    # Inside

    def wait_booted(self, timeout_s: float = 300) -> float:
        """Seconds until the guest answers; one whose processor stumbled is reset.

        Raises `HypermaskError` APL-BOOT.
        """
        began = time.monotonic()
        while True:
            left_s = timeout_s - (time.monotonic() - began)
            try:
                if self._agent.receive(min(left_s, _LOOK_S)).get("id") == 0:
                    return time.monotonic() - began
            except TimeoutError:
                if left_s <= _LOOK_S:
                    raise HypermaskError(
                        "APL-BOOT",
                        "the guest does not boot",
                        f"Read {self.machine.work}/console.log.",
                    ) from None
                self._reset_if_stumbled()

    def _reset_if_stumbled(self) -> None:
        log = self.machine.work / "console.log"
        count = stumbles(log.read_text("utf-8", "replace") if log.exists() else "")
        if count > self.stumbles:
            self.stumbles = count
            self.monitor("system_reset")

    def run(self, command: str, timeout_s: float = 120, check: bool = True) -> str:
        """Output of a shell command in the guest. Raises `HypermaskError` APL-COMMAND."""
        self._request += 1
        self._agent.send({"id": self._request, "command": command, "timeout_s": timeout_s})
        deadline = time.monotonic() + timeout_s + 30
        while True:
            try:
                answer = self._agent.receive(deadline - time.monotonic())
            except TimeoutError:
                answer = {"id": self._request, "status": 124, "output": "the guest is silent"}
            if answer.get("id") == self._request:
                break
        if check and answer["status"]:
            raise HypermaskError(
                "APL-COMMAND",
                f"`{command}` ended with {answer['status']}: {answer['output'].strip()[-2000:]}",
                "Read the guest's journal.",
            )
        return str(answer["output"])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.power_cut()
