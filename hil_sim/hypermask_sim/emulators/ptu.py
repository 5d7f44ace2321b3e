"""A pan-tilt unit of Directed Perception, byte for byte: PTU-D46 User's Manual 2.14, section 4.

Pure logic: bytes in at a time, bytes out due at a time. `ptu_line` puts it on a real pty.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from hypermask_sim.emulators import ptu_words as words
from hypermask_sim.emulators.ptu_axis import PAN, TILT, Axis, AxisData

_DELIMITERS = b" \r\n"
_AXIS_COMMAND = re.compile(r"([PT])([PORNXSDABUL])([-+]?\d+)?")
_RESET_ANSWERS = {"R": "!T!T!P!P*\r\n", "RE": "!T!T!P!P*\r\n", "RP": "!P!P*\r\n", "RT": "!T!T*\r\n"}


@dataclass
class PtuData:
    """What a unit is like; homing_s: time of a reset."""

    pan: AxisData = field(default_factory=lambda: replace(PAN))
    tilt: AxisData = field(default_factory=lambda: replace(TILT))
    homing_s: float = 3.0
    baud: int | None = 9600
    """None: bytes take no time."""
    input_v: float = 24.0
    temperature_f: float = 86.0


class PtuUnit:
    """`receive` and `transmit` with rising times; everything else follows from them.

    It comes up as from the factory: echo on, verbose, position limits on, its axes anywhere.
    """

    def __init__(self, data: PtuData | None = None) -> None:
        self.data = data or PtuData()
        self.axes = {"P": Axis("P", self.data.pan), "T": Axis("T", self.data.tilt)}
        self._out: list[tuple[float, int]] = []  # when the byte is whole, and the byte
        self._in: list[tuple[float, int]] = []
        self._line_free_s = self._heard_s = 0.0
        self._byte_s = 10.0 / self.data.baud if self.data.baud else 0.0
        self._silent_until_s = 0.0
        self._mangle: list[Callable[[str], str]] = []
        self._jammed = False
        self.heard: list[str] = []
        """Every command that was carried out, for tests."""
        self._defaults(0.0)
        for axis in self.axes.values():
            axis.place((axis.data.low + axis.data.high) / 2, 0.0)

    def _defaults(self, now_s: float) -> None:
        self.echo = self.verbose = self.limited = self.immediate = True
        self._word = ""
        self._busy_until_s = now_s
        self._done: Callable[[float], None] | None = None
        self._queue: list[str] = []
        self._slaved: dict[str, int] = {}

    # --- the line -------------------------------------------------------------------------

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes that the other side began to send at `now_s`."""
        self._heard_s = max(self._heard_s, now_s)
        for byte in data:
            self._heard_s += self._byte_s
            self._in.append((self._heard_s, byte))
        self.advance(now_s)

    def _hear(self, byte: int, now_s: float) -> None:
        if now_s < self._silent_until_s:
            return
        character = chr(byte)
        if self.echo:
            self._emit(character, now_s)
        if byte not in _DELIMITERS:
            self._word += character
        elif self._word:
            self._queue.append(self._word.upper())
            self._word = ""
            self._work(now_s)

    def transmit(self, now_s: float) -> bytes:
        """The bytes that are on the other side by `now_s`."""
        self.advance(now_s)
        due = bytes(byte for time_s, byte in self._out if time_s <= now_s)
        self._out = self._out[len(due) :]
        return due

    def next_s(self) -> float:
        """When `transmit` next has something; infinite when nothing is coming."""
        times = [line[0][0] for line in (self._in, self._out) if line]
        if self._done is not None:
            times.append(self._busy_until_s)
        return min(times, default=float("inf"))

    def _emit(self, text: str, now_s: float) -> None:
        if now_s < self._silent_until_s:
            return
        self._line_free_s = max(self._line_free_s, now_s)
        for byte in text.encode("latin-1"):
            self._line_free_s += self._byte_s
            self._out.append((self._line_free_s, byte))

    def _say(self, text: str, now_s: float) -> None:
        for mangle in self._mangle:
            text = mangle(text)
        self._mangle = []
        self._emit(text, now_s)

    # --- faults ---------------------------------------------------------------------------

    def power_cycle(self, now_s: float) -> None:
        """Banner, defaults, and it finds its zero anew; what was under way is forgotten."""
        self.advance(now_s)
        self._in, self._out = [], []
        self._line_free_s = self._heard_s = now_s
        self._defaults(now_s)
        self._emit(words.BANNER, now_s)
        self._begin_reset("R", now_s, "*\r\n")

    def fall_silent(self, until_s: float) -> None:
        """Nothing is heard or said until then."""
        self._silent_until_s = until_s

    def garble(self, noise: str = "\xff\x81x\xfe") -> None:
        """The next answer has noise in it."""
        self._mangle.append(lambda text: text[:2] + noise + text[2:])

    def halve(self) -> None:
        """The next answer breaks off in the middle."""
        self._mangle.append(lambda text: text[: max(1, len(text) // 2)])

    def jam(self) -> None:
        """The next reset ends without a zero."""
        self._jammed = True

    def intrude(self, text: str, now_s: float) -> None:
        """Say something that nobody asked for, such as `!P`."""
        self._emit(text, now_s)

    # --- commands -------------------------------------------------------------------------

    def advance(self, now_s: float) -> None:
        """Do all that is due, in its order."""
        while self._in and self._in[0][0] <= now_s:
            time_s, byte = self._in.pop(0)
            self._work(time_s)
            self._hear(byte, time_s)
        self._work(now_s)

    def _work(self, now_s: float) -> None:
        """Finish what takes time, then go on with what was sent meanwhile (section 4.3.7)."""
        while True:
            if self._done is not None:
                if now_s < self._busy_until_s:
                    return
                done, self._done = self._done, None
                done(self._busy_until_s)
            if not self._queue:
                return
            command = self._queue.pop(0)
            if now_s >= self._silent_until_s:
                self.heard.append(command)
                self._obey(command, now_s)

    def _obey(self, command: str, now_s: float) -> None:
        if command in _RESET_ANSWERS:
            self._begin_reset(command, now_s, _RESET_ANSWERS[command])
        elif command == "A":
            self._await(now_s)
        elif (simple := self._simple(command)) is not None:
            self._say(simple, now_s)
        elif command in ("H", "HP", "HT"):
            for letter in command[1:] or "PT":
                self.axes[letter].halt(now_s)
                self._slaved.pop(letter, None)
            self._say("*\r\n", now_s)
        elif match := _AXIS_COMMAND.fullmatch(command):
            self._say(self._axis_command(match[1], match[2], match[3], now_s), now_s)
        else:
            self._say(f"! Illegal command: {command}\r\n", now_s)

    def _begin_reset(self, command: str, now_s: float, text: str) -> None:
        letters = {"RP": "P", "RT": "T"}.get(command, "PT")

        def done(end_s: float) -> None:
            jammed, self._jammed = self._jammed, False
            if jammed:
                self._say(words.JAMMED, end_s)
                return
            for letter in letters:
                self.axes[letter].place(0.0, end_s)
            self._say(text, end_s)

        for letter in letters:
            self.axes[letter].halt(now_s)
        self._busy_until_s, self._done = now_s + self.data.homing_s, done

    def _await(self, now_s: float) -> None:
        """Section 4.3.7; slaved positions start now (4.3.6)."""
        for letter, target in self._slaved.items():
            self.axes[letter].go(target, now_s)
        self._slaved = {}
        end_s = max(now_s, *(axis.end_s for axis in self.axes.values()))
        self._busy_until_s, self._done = end_s, lambda time_s: self._say("*\r\n", time_s)

    def _simple(self, command: str) -> str | None:
        """Commands without an axis that answer at once."""
        switches: dict[str, tuple[str, bool]] = {
            "EE": ("echo", True), "ED": ("echo", False), "FV": ("verbose", True),
            "FT": ("verbose", False), "LE": ("limited", True), "LD": ("limited", False),
            "I": ("immediate", True), "S": ("immediate", False),
        }  # fmt: skip
        if command in switches:
            setattr(self, *switches[command])
            return "*\r\n"
        volts, heat = self.data.input_v, self.data.temperature_f
        replies = {
            "CI": "*",
            "DS": "*",
            "DR": "*",
            "DF": "*",
            "E": f"* Echoing {'ON' if self.echo else 'OFF'}",
            "F": f"* ASCII {'verbose' if self.verbose else 'terse'} mode",
            "L": "* Limit bounds are ENABLED (soft limits enabled)"
            if self.limited
            else "* Limit bounds are DISABLED (hard limits only: use care)",
            "V": f"* {words.VERSION}",
            "O": f"* Input {volts:.0f} VDC @ {heat:.0f} degF",
            "?": f"* {words.HELP}",
        }
        return f"{replies[command]}\r\n" if command in replies else None

    def _axis_command(self, letter: str, kind: str, value: str | None, now_s: float) -> str:
        axis = self.axes[letter]
        if value is None:
            return words.answer(kind, letter, self._value(axis, kind, now_s), self.verbose)
        if kind in "PO":
            base = axis.position(now_s) if kind == "O" else 0
            return self._go(axis, base + int(value), now_s)
        if kind in "SD":
            base = axis.data.speed if kind == "D" else 0
            return self._set_speed(axis, base + int(value))
        if kind in "ABUL":
            return self._set_bound(axis, kind, int(value))
        return f"! Illegal command: {letter}{kind}{value}\r\n"

    def _value(self, axis: Axis, kind: str, now_s: float) -> str:
        data = axis.data
        target = self._slaved.get(axis.letter, axis.target)
        return {
            "P": str(axis.position(now_s)),
            "O": str(target),
            "R": f"{data.resolution:.4f}",
            "N": str(data.low),
            "X": str(data.high),
            "S": str(data.speed),
            "D": str(axis.speed(now_s)),
            "A": str(data.acceleration),
            "B": str(data.base),
            "U": str(data.fastest),
            "L": str(data.slowest),
        }[kind]

    def _go(self, axis: Axis, target: int, now_s: float) -> str:
        if self.limited and not axis.data.low <= target <= axis.data.high:
            return words.beyond(axis.letter, axis.data.low, axis.data.high, target)
        if self.immediate:
            axis.go(target, now_s)
        else:
            self._slaved[axis.letter] = target
        return "*\r\n"

    def _set_speed(self, axis: Axis, speed: int) -> str:
        if speed > axis.data.fastest:
            return words.too_fast(axis.letter, axis.data.fastest)
        if speed < axis.data.slowest:
            return words.too_slow(axis.letter, axis.data.slowest)
        axis.data.speed = speed
        return "*\r\n"

    def _set_bound(self, axis: Axis, kind: str, value: int) -> str:
        if kind == "L" and value < 31:
            return "! Motor speed cannot be less than 31 pos/sec\r\n"
        if value <= 0:
            return f"! Illegal argument: {value}\r\n"
        name = {"A": "acceleration", "B": "base", "U": "fastest", "L": "slowest"}[kind]
        setattr(axis.data, name, value)
        return "*\r\n"
