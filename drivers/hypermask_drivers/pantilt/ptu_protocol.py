"""The ASCII protocol of Directed Perception and FLIR pan-tilt units, the receiving side.

PTU-D46 User's Manual 2.14, section 4.2: a command ends in a space or newline; `*` or `* value`
answers success, `! message` failure. `!P` and `!T` come at any time when an axis hits its limit,
even glued to an answer: a reset ends in `!T!T!P!P*`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

_LINE_END = re.compile(rb"[\r\n]+")
_LIMIT = re.compile(r"!([PT])(?=$|[!*\s])")
_ANSWER = re.compile(r"\*(?=$|\s)(.*)", re.DOTALL)
_ERROR = re.compile(r"!\s*(\S.*)", re.DOTALL)
_NUMBER = re.compile(r"(?<!\S)[-+]?\d+(?:\.\d+)?(?!\S)")
_LONGEST = 1024


@dataclass(frozen=True)
class Answer:
    """What the unit said to one command: `text` is the result, or the message of a failure."""

    good: bool
    text: str

    @property
    def number(self) -> float | None:
        """The value in a terse (`-907`) or verbose (`Minimum Tilt position is -907`) result."""
        found = _NUMBER.search(self.text) if self.good else None
        return float(found[0]) if found else None

    @property
    def terse(self) -> bool:
        """Whether the result is a value and nothing else."""
        return self.good and _NUMBER.fullmatch(self.text) is not None


class Reader:
    """Bytes in, answers out. Limit hits, echoes and whatever else comes are kept apart."""

    def __init__(self) -> None:
        self._rest = b""
        self.limit_hits = ""
        """One letter, P or T, for each limit report since it was last cleared."""
        self.unexpected: list[str] = []
        """Lines that were no answer: banners, garbage."""

    def clear(self) -> None:
        self._rest, self.limit_hits, self.unexpected = b"", "", []

    def feed(self, data: bytes, expected: str = "") -> list[Answer]:
        """The answers that `data` completes. expected: the commands sent, for their echo."""
        *lines, self._rest = _LINE_END.split(self._rest + data)
        if len(self._rest) > _LONGEST:
            lines, self._rest = [*lines, self._rest], b""
        answers = []
        for line in lines:
            answer = self._read(line.decode("ascii", "replace").strip(), expected)
            if answer is not None:
                answers.append(answer)
        return answers

    def _read(self, line: str, expected: str) -> Answer | None:
        line = _without_echo(line, expected)
        while limit := _LIMIT.match(line):
            self.limit_hits += limit[1]
            line = line[limit.end() :].lstrip()
        if not line:
            return None
        if good := _ANSWER.match(line):
            return Answer(True, good[1].strip())
        if bad := _ERROR.match(line):
            return Answer(False, bad[1].strip())
        self.unexpected = [*self.unexpected[-9:], line[:200]]
        return None


def _without_echo(line: str, expected: str) -> str:
    """`pp * 22` without the `pp` that a unit with its echo on sends back."""
    for command in expected.lower().split():
        if line.lower().startswith(command):
            line = line[len(command) :].lstrip()
    return line
