"""How hot the processor is and whether it is slowed down, from the kernel's files alone.

Temperature: /sys/class/thermal (kernel documentation, driver-api/thermal/sysfs-api.rst). Slowing
down: the firmware's flags of a Raspberry Pi (`get_throttled`), elsewhere a cooling device that
holds the processor's clock down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

SYSFS = Path("/sys")
UNDER_VOLTAGE, CAPPED, THROTTLED, SOFT_LIMIT = 1, 2, 4, 8
_WORDS = {
    UNDER_VOLTAGE: "supply voltage too low",
    CAPPED: "clock capped",
    THROTTLED: "slowed down",
    SOFT_LIMIT: "near its heat limit",
}
_PAST = 16
"""The same flags that many bits higher: it happened since the start."""
NOW = (1 << _PAST) - 1
HOT_C, COOL_C = 80.0, 75.0
"""From where on it is too hot, and below which it is fine again."""
_PROCESSOR = ("cpu", "soc", "x86_pkg", "coretemp", "acpitz")
_CLOCK = ("cpufreq", "processor")


@dataclass(frozen=True)
class Heat:
    """temperature_c: NaN where nobody says; flags: as the firmware's; known: somebody says."""

    temperature_c: float
    flags: int
    known: bool

    @property
    def now(self) -> int:
        return self.flags & NOW


def words_of(flags: int) -> str:
    """What the flags mean, `not slowed down` for none."""
    now = [text for bit, text in _WORDS.items() if flags & bit]
    past = [text for bit, text in _WORDS.items() if flags >> _PAST & bit and not flags & bit]
    said = now + [f"{text} earlier" for text in past]
    return ", ".join(said) or "not slowed down"


def read_heat(sysfs: Path = SYSFS) -> Heat:
    """Never raises: a file that cannot be read says nothing."""
    flags = _firmware(sysfs)
    if flags is None:
        flags = _cooling(sysfs)
    return Heat(_temperature(sysfs), flags or 0, flags is not None)


def _temperature(sysfs: Path) -> float:
    found: list[tuple[bool, float]] = []
    for zone in sorted(sysfs.glob("class/thermal/thermal_zone*")):
        milli = _number(zone / "temp")
        if milli is not None and -50_000 < milli < 200_000:
            kind = _text(zone / "type").lower()
            found.append((any(word in kind for word in _PROCESSOR), milli / 1000))
    ours = [celsius for mine, celsius in found if mine] or [celsius for _, celsius in found]
    return max(ours, default=math.nan)


def _firmware(sysfs: Path) -> int | None:
    for name in ("get_throttled", "throttled"):
        for file in sysfs.glob(f"devices/platform/soc/*/{name}"):
            flags = _number(file, 16)
            if flags is not None:
                return flags
    return None


def _cooling(sysfs: Path) -> int | None:
    known = None
    for device in sysfs.glob("class/thermal/cooling_device*"):
        if any(word in _text(device / "type").lower() for word in _CLOCK):
            known = (known or 0) | (THROTTLED if _number(device / "cur_state") else 0)
    return known


def _text(file: Path) -> str:
    try:
        return file.read_text("utf-8", errors="replace").strip()
    except OSError:
        return ""


def _number(file: Path, base: int = 10) -> int | None:
    try:
        return int(_text(file), base)
    except ValueError:
        return None
