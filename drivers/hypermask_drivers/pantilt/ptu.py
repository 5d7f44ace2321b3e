"""Pan-tilt units of Directed Perception and FLIR (PTU-46, D46, D47, E46...) on a serial line.

Commands are those of the PTU-D46 User's Manual 2.14, section 4. The units have no watchdog of
their own and keep going to their last target when the host dies: whoever moves the head sends
targets that are near (see `hypermask.workers.pantilt`). A unit that does not answer within
`silence_s` is sent a halt and given up.

Whether its zero is known is kept in the unit itself: this driver makes it terse (FT) once it is
homed, and verbose (FV) as soon as the zero is in doubt. Power-up turns its echo on, which this
driver turns off. So a unit without echo that answers tersely has kept its zero, whichever process
homed it, and need not swing through its range again.
"""

from __future__ import annotations

import contextlib
import errno
import time
from collections.abc import Callable
from typing import Literal, NoReturn

from pydantic import Field

from hypermask_drivers.clock import Clock, RealClock
from hypermask_drivers.device import DeviceState
from hypermask_drivers.errors import DeviceError
from hypermask_drivers.hardware import Hardware, plain
from hypermask_drivers.pantilt import PanTilt, PanTiltLimits, PanTiltState
from hypermask_drivers.pantilt.ptu_axis import Axis
from hypermask_drivers.pantilt.ptu_protocol import Answer, Reader
from hypermask_drivers.pantilt.serial_line import SerialLine
from hypermask_drivers.settings import Settings

_QUIET_S = 0.03
_SENTENCE_BITS = 500  # of a verbose answer on the line
_OPEN_TRIES = 3


class PtuSettings(Settings):
    """device: stable name of the line. *_limits_deg: soft limits, inside those of the unit.

    *_sign: -1 where the unit hangs upside down or its axis counts the other way.
    silence_s: how long the unit may be silent after a command before it is halted and given up.
    homing_s: how long a reset may take (the manual's units take about 20 s).
    """

    device: str = "/dev/hypermask/ptu"
    baud: int = Field(9600, ge=300, le=115200)
    pan_limits_deg: tuple[float, float] = (-180.0, 180.0)
    tilt_limits_deg: tuple[float, float] = (-90.0, 90.0)
    pan_sign: Literal[1, -1] = 1
    tilt_sign: Literal[1, -1] = 1
    silence_s: float = Field(0.5, gt=0, le=10)
    homing_s: float = Field(45.0, gt=0, le=300)


class DirectedPerceptionPtu(Hardware, PanTilt):
    """`restarted` says whether the unit may have come from power-up when it was opened.

    Such a unit does not know where it stands. One that was found silent is taken for one too.
    """

    code, noun = "PTU", "pan-tilt unit"

    def __init__(
        self,
        settings: PtuSettings | None = None,
        clock: Clock | None = None,
        connect: Callable[[str, int], SerialLine] = SerialLine,
    ) -> None:
        super().__init__()
        self.settings = settings or PtuSettings()
        self.place = self.settings.device
        self.restarted = self._unsure = False
        self._clock = clock or RealClock()
        self._connect = connect
        self._line: SerialLine | None = None
        self._reader = Reader()
        self._axes: tuple[Axis, ...] = ()
        self._homing_s: float | None = None  # clock time when homing began
        self._homed = self._terse = False
        self._limit_hits = 0
        self._targets: tuple[int, ...] | None = None
        self._speed: tuple[int, ...] = ()
        self._last: tuple[int, ...] = (0, 0)

    # --- opening and losing ---------------------------------------------------------------

    def open(self) -> None:
        """Halts the head and reads what it can do.

        Raises `DeviceAbsent` PTU-ABSENT, PTU-RIGHTS, PTU-BUSY, PTU-SILENT, PTU-STRANGE.
        """
        if self._state is DeviceState.READY:
            return
        self._state = DeviceState.OPENING
        try:
            self._line = self._connect(self.place, self.settings.baud)
        except DeviceError:
            self._state = DeviceState.ABSENT
            raise
        except OSError as error:
            self._refuse(error)
        # While it starts, a unit obeys later what it is sent now, even to turn its echo off.
        unsure, self._unsure = self._unsure, True
        try:
            self._greet()
            self.restarted |= unsure
            self._homed = self._kept_its_zero()
            self._axes = self._survey()
        except OSError as error:
            self._absent("ABSENT", f"the {self.noun} vanished ({plain(error)})", "Check its cable.")
        self._homing_s, self._targets, self._speed, self._limit_hits = None, None, (), 0
        self._unsure = False
        self._state = DeviceState.READY

    def _refuse(self, error: OSError) -> None:
        number = error.errno
        if number in (errno.EACCES, errno.EPERM):
            self._absent("RIGHTS", f"{self.place} may not be opened", "Join the group dialout.")
        if number in (errno.EBUSY, errno.EAGAIN) or "lock" in str(error).lower():
            self._absent("BUSY", f"{self.place} is used by another program", "Stop that program.")
        self._absent(
            "ABSENT",
            f"there is no {self.noun} at {self.place}",
            "Check cable and power, and the name of the line.",
        )

    def _greet(self) -> None:
        """Halt at once, whatever it was doing; then without echo, in position mode."""
        assert self._line is not None
        self._reader.clear()
        self._line.write(b"\rh ")
        heard = self._drain(self.settings.silence_s)
        # A unit that still repeats what it is sent has forgotten that it was told not to.
        self.restarted = b"h" in heard.lower().split(b"*")[0]
        for _ in range(_OPEN_TRIES):
            self._line.write(b"ed ci i le ")
            heard += self._drain(self.settings.silence_s)
            if b"*" in heard:
                return
        self._absent(
            "SILENT",
            f"nothing answers at {self.place}",
            "Check its power and its baud rate; after power-up it takes a while.",
        )

    def _drain(self, first_s: float) -> bytes:
        """All that comes until the line is quiet."""
        assert self._line is not None
        heard, wait_s = b"", first_s
        end_s = time.monotonic() + 10 * first_s
        while (data := self._line.read(wait_s)) and time.monotonic() < end_s:
            heard, wait_s = heard + data, _QUIET_S
        self._reader.feed(heard + b"\n")
        return heard

    def _kept_its_zero(self) -> bool:
        """By its terse answer; where firmware knows none, as far as this driver remembers."""
        doubted = self._terse and not self._homed
        self._terse = False
        self._terse = self._answer("pp").terse
        return not self.restarted and not doubted and (self._terse or self._homed)

    def _survey(self) -> tuple[Axis, ...]:
        axes = []
        chosen = zip(
            "PT",
            (self.settings.pan_sign, self.settings.tilt_sign),
            (self.settings.pan_limits_deg, self.settings.tilt_limits_deg),
            strict=True,
        )
        for letter, sign, soft in chosen:
            values = {kind: self._number(letter.lower() + kind) for kind in "rnxlu"}
            if sign < 0:
                soft = (-soft[1], -soft[0])
            if values["r"] <= 0 or values["n"] > values["x"] or values["u"] <= 0:
                self._strange(f"limits {values}")
            axis = Axis(letter, values, soft)
            axis.sign = sign
            if axis.low > axis.high:
                self._absent(
                    "LIMITS",
                    f"the soft limits {soft} leave nothing of the range of the {self.noun}",
                    "Correct pan_limits_deg and tilt_limits_deg.",
                )
            axes.append(axis)
        return tuple(axes)

    def _number(self, query: str) -> float:
        return self._answer(query).number or 0.0

    def _answer(self, query: str) -> Answer:
        """One with a number, asked again when noise spoiled it, as it does after power-up."""
        said = "nothing"
        for _ in range(_OPEN_TRIES):
            with contextlib.suppress(TimeoutError):
                *others, answer = self._ask(query)
                if answer.number is not None and not others:
                    return answer
                said = answer.text
            self._drain(_QUIET_S)
        return self._strange(said)

    def _strange(self, text: str) -> NoReturn:
        self._absent(
            "STRANGE",
            f"what answers at {self.place} is no {self.noun} (it said: {plain(text)[:60]})",
            "Check the line's name and the baud rate.",
        )

    def _release(self) -> None:
        line, self._line = self._line, None
        if line is not None:
            with contextlib.suppress(Exception):
                line.write(b"\rh ")  # also after a command that broke off
            line.close()

    # --- asking ---------------------------------------------------------------------------

    def _ask(self, *commands: str, share: float = 1.0) -> list[Answer]:
        """One answer a command. Raises `TimeoutError` after that share of `silence_s`, `OSError`
        when the line vanished."""
        assert self._line is not None
        text = "".join(f"{command} " for command in commands)
        self._drop_late()
        self._line.write(text.encode("ascii"))
        answers: list[Answer] = []
        bits = 20 * len(text) + (0 if self._terse else _SENTENCE_BITS * len(commands))
        allowed_s = share * self.settings.silence_s + bits / self.settings.baud
        end_s = time.monotonic() + allowed_s
        while len(answers) < len(commands):
            data = self._line.read(max(0.0, end_s - time.monotonic()))
            if not data:
                raise TimeoutError(errno.ETIMEDOUT, "no answer")
            answers += self._reader.feed(data, text)
        self._note_limits()
        return answers

    def _drop_late(self) -> None:
        """What came without being asked for, or too late, must not pass for the next answer."""
        assert self._line is not None
        while data := self._line.read(0.0):
            self._reader.feed(data)

    def _note_limits(self) -> None:
        """Outside a reset a unit that hits a limit has lost its zero (manual, section 4.3.5)."""
        if self._reader.limit_hits:
            self._limit_hits += len(self._reader.limit_hits)
            self._homed = False
        self._reader.limit_hits = ""

    def _tell(self, *commands: str) -> list[Answer]:
        """`_ask` of an open unit, which is lost when it does not answer.

        Asked twice, as noise may have spoiled it; every command may be given twice.
        """
        self._check()
        try:
            try:
                return self._ask(*commands, share=0.4)
            except TimeoutError:
                self._drain(_QUIET_S)
                return self._ask(*commands, share=0.5)
        except TimeoutError:
            self._silent()
        except OSError as error:
            self._vanished(error)
        raise AssertionError

    def _silent(self) -> None:
        self._lose(
            "SILENT",
            f"the {self.noun} has not answered for {self.settings.silence_s * 1000:.0f} ms",
            "It was sent a halt; check cable and power.",
        )

    # --- the interface --------------------------------------------------------------------

    @property
    def limits(self) -> PanTiltLimits:
        """Raises `DeviceError` PTU-CLOSED before it was first opened."""
        if not self._axes:
            self._check()
        pan, tilt = self._axes
        speed = min(axis.fastest * axis.step_rad for axis in self._axes)
        step = max(axis.step_rad for axis in self._axes)
        return PanTiltLimits(pan.range_rad, tilt.range_rad, speed, step)

    def home(self) -> None:
        self._tell("h")
        self._homed = False
        self._mark_zero()
        assert self._line is not None
        try:
            self._drop_late()
            self._line.write(b"r ")
        except OSError as error:
            self._vanished(error)
        self._homing_s, self._targets, self._speed = self._clock.now(), None, ()

    def move(self, pan_rad: float, tilt_rad: float, speed_rad_s: float) -> None:
        """Raises `DeviceError` PTU-HOMING while the zero is sought, PTU-REFUSED."""
        self._check()
        if self._homing():
            raise DeviceError("PTU-HOMING", f"the {self.noun} is finding its zero", "Wait for it.")
        angles = (pan_rad, tilt_rad)
        targets = tuple(a.steps(angle) for a, angle in zip(self._axes, angles, strict=True))
        speed = tuple(axis.speed(speed_rad_s) for axis in self._axes)
        commands = []
        for index, axis in enumerate(self._axes):
            letter = axis.letter.lower()
            if self._speed[index : index + 1] != (speed[index],):
                commands.append(f"{letter}s{speed[index]}")
            if self._targets is None or self._targets[index] != targets[index]:
                commands.append(f"{letter}p{targets[index]}")
        for answer in self._tell(*commands) if commands else []:
            if not answer.good:
                self._targets, self._speed = None, ()
                raise DeviceError(
                    "PTU-REFUSED",
                    f"the {self.noun} refused to move ({plain(answer.text)})",
                    "Home it; if that does not help, check its limits and its load.",
                )
        self._targets, self._speed = targets, speed

    def halt(self) -> None:
        """Ends homing too; the zero then is unknown."""
        self._check()
        self._homing_s, self._targets = None, None
        self._tell("h")
        self._last = self._positions()

    def read(self) -> PanTiltState:
        self._check()
        if self._homing():
            return self._state_of(self._last, True)
        position = self._positions()
        self._mark_zero()
        goal = self._last if self._targets is None else self._targets
        self._last = position
        return self._state_of(position, position != goal)

    def _mark_zero(self) -> None:
        """Terse while the zero is known, for whoever opens the unit next."""
        if self._terse != self._homed:
            self._tell("ft" if self._homed else "fv")
            self._terse = self._homed

    def _positions(self) -> tuple[int, ...]:
        numbers = [answer.number for answer in self._tell("pp", "tp")]
        if None in numbers or len(numbers) != len(self._axes):
            self._drain(_QUIET_S)
            numbers = [answer.number for answer in self._tell("pp", "tp")]
        if None in numbers or len(numbers) != len(self._axes):
            self._lose("GARBLED", f"the {self.noun} answers nonsense", "Check cable and baud rate.")
        return tuple(int(number or 0) for number in numbers)

    def _state_of(self, steps: tuple[int, ...], moving: bool) -> PanTiltState:
        pan, tilt = (
            axis.sign * axis.step_rad * count + 0.0
            for axis, count in zip(self._axes, steps, strict=True)
        )
        return PanTiltState(pan, tilt, moving, self._clock.now(), self._homed, self._limit_hits)

    def _homing(self) -> bool:
        """True while the reset goes on; takes its answer `!T!T!P!P*` when it has come."""
        if self._homing_s is None:
            return False
        assert self._line is not None
        try:
            while data := self._line.read(0.0):
                for answer in self._reader.feed(data, "r"):
                    self._homed_or_not(answer)
        except OSError as error:
            self._vanished(error)
        if self._homing_s is not None and (
            self._clock.now() - self._homing_s > self.settings.homing_s
        ):
            self._lose(
                "HOMING-LONG",
                f"the {self.noun} has not found its zero in {self.settings.homing_s:.0f} s",
                "Look whether something blocks it.",
            )
        return self._homing_s is not None

    def _homed_or_not(self, answer: Answer) -> None:
        """Limit hits belong to a reset."""
        self._reader.limit_hits = ""
        self._homing_s, self._homed, self._last = None, answer.good, (0, 0)
