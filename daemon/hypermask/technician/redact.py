"""Taking out of a text what is nobody's business: names, addresses, numbers, secrets.

Twice: by form (whatever looks like an address, a password, a photograph's name) and by value
(this machine's own names, serial numbers and networks, wherever they are).
"""

from __future__ import annotations

import json
import math
import pwd
import re
import socket
from collections.abc import Iterable
from pathlib import Path
from typing import Any

_LONGEST = 2000
_COMMON = frozenset(
    {"localhost", "hypermask", "debian", "cart", "root", "none", "default", "unknown"}
)
_SECRET = r"(?:[a-z0-9_.-]*(?:passw(?:or)?d|passphrase|psk|secret|token|api[_-]?key|key_?file|ssid|credential|cookie|auth(?:orization)?|pin[_-]?code)[a-z0-9_.-]*)"  # noqa: E501
_MEDIA = "jpe?g|png|gif|heic|heif|webp|bmp|tiff?|raw|dng|wav|mp3|flac|ogg|opus|m4a|mp4|mov|avi|mkv"
_HEX = "[0-9a-f]{1,4}"
_HEXES = f"{_HEX}(?::{_HEX}){{0,6}}"
_VALUE = r"(\"[^\"\n]*\"?|'[^'\n]*'?|[^\s,;}]+)"
_ADDRESS = r"(?<![\d.])(?:\d{1,3}\.){3}\d{1,3}(?![\d.])"
_FORMS = tuple(
    (re.compile(form, flags), mark)
    for form, mark, flags in (
        (r"-----BEGIN [^-]+-----.*?(?:-----END [^-]+-----|\Z)", "[secret]", re.S),
        (rf"(\b{_SECRET}[\"']?\s*[=:]\s*){_VALUE}", r"\1[secret]", re.I),
        (r"\b((?:bearer|basic)\s+)[a-z0-9+/=._-]{8,}", r"\1[secret]", re.I),
        (r"\b([a-z][a-z0-9+.-]*://)[^\s/@]+@", r"\1[user]@", re.I),
        (r"[\w.+-]+@[\w-]+(?:\.[\w-]+)+", "[mail]", 0),
        (rf"([\"'])[^\"'\n]*\.({_MEDIA})\1", r"[file].\2", re.I),
        (rf"(?<![\w/])~?/[^\"'\n]*?\.({_MEDIA})\b", r"[file].\1", re.I),
        (rf"[^\s\"'=(<>\[\]]+\.({_MEDIA})\b", r"[file].\1", re.I),
        (r"\b[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}\b", "[id]", re.I),
        (r"\b(?:[0-9a-f]{2}[:-]){5}[0-9a-f]{2}\b", "[mac]", re.I),
        (rf"(?<![\w:])(?:{_HEXES})?::(?:{_HEXES})?(?:%\w+)?(?:/\d+)?(?![\w:])", "[ip]", re.I),
        (rf"(?<![\w:.])(?:{_HEX}:){{5,7}}{_HEX}(?:%\w+)?(?:/\d+)?(?![\w:])", "[ip]", re.I),
        (_ADDRESS, "[ip]", 0),
        (
            r"\b((?:i?serial(?:[ _-]?(?:number|short|no))?|ID_SERIAL\w*|(?:machine|boot)[_-]?id)"
            rf"[\"']?\s*[=:#]\s*){_VALUE}",
            r"\1[serial]",
            re.I,
        ),
        (r"(/by-id/)[^\s\"']+", r"\1[serial]", 0),
        (r"/(home|media|Users)/[^/\s\"']+", r"/\1/[user]", 0),
        (r"\b[0-9a-f]{24,}\b", "[id]", re.I),
        (r"[A-Za-z0-9+/]{60,}={0,2}", "[data]", 0),
    )
)
_NAMED = re.compile(r"(?i)\b(character|voice|speaker|actor|visitor|guest)s? '([^'\n]{1,64})'")
OURS = frozenset({"mean", "noh", "kabuki", "clown", "dots", "next", "previous"})


class Redactor:
    """words: values that must not be seen, and what stands for them."""

    def __init__(self, words: dict[str, str] | None = None) -> None:
        known = {word: mark for word, mark in (words or {}).items() if _telling(word, mark)}
        self._marks = {word.casefold(): mark for word, mark in known.items()}
        ordered = sorted(known, key=len, reverse=True)
        pattern = "|".join(_exactly(word) for word in ordered)
        self._known = (
            re.compile(rf"(?i)(?<![A-Za-z0-9])(?:{pattern})(?![A-Za-z0-9])") if ordered else None
        )

    def __call__(self, text: str, versions: bool = False) -> str:
        """The text without them; control characters and endless lines go as well.

        versions: four numbers with dots are a version here, and no address.
        """
        clean = "".join(sign if sign.isprintable() or sign in "\n\t" else " " for sign in text)
        clean = "\n".join(line[:_LONGEST] for line in clean.split("\n"))
        if self._known is not None:
            clean = self._known.sub(lambda hit: self._marks[hit.group().casefold()], clean)
        for form, mark in _FORMS:
            if versions and form.pattern == _ADDRESS:
                continue
            clean = form.sub(mark, clean)
        return _NAMED.sub(_unnamed, clean)

    def data(self, value: Any) -> Any:
        """Every text in nested tables and lists; the value of a key that sounds secret is gone."""
        if isinstance(value, dict):
            return {
                self(str(key)): "[secret]" if _SECRET_KEY.fullmatch(str(key)) else self.data(item)
                for key, item in value.items()
            }
        if isinstance(value, list | tuple):
            return [self.data(item) for item in value]
        if isinstance(value, float) and not math.isfinite(value):
            return None  # JSON has no such number
        return self(value) if isinstance(value, str) else value

    def json(self, value: Any) -> str:
        return json.dumps(self.data(value), indent=1, ensure_ascii=False, default=str)


_SECRET_KEY = re.compile(rf"(?i){_SECRET}")


def _unnamed(hit: re.Match[str]) -> str:
    """Characters that came with the program are nobody; others may be somebody."""
    kind, name = hit.groups()
    return hit.group() if name.casefold() in OURS or "[" in name else f"{kind} '[name]'"


def _telling(word: str, mark: str) -> bool:
    """Words that are too short or too common would take the text apart; but a name is a name."""
    long = len(word) >= 3 or mark.startswith(("[character", "[voice"))
    return long and word.casefold() not in _COMMON and bool(word) and not word.isspace()


def _exactly(word: str) -> str:
    """Short names only as they are written: Al, not al."""
    return re.escape(word) if len(word) >= 3 else f"(?-i:{re.escape(word)})"


def own_words(root: Path = Path("/"), home: Path | None = None) -> dict[str, str]:
    """What this machine can be recognised by. Never raises."""
    words: dict[str, str] = {}
    words |= dict.fromkeys(_host_names(root), "[host]")
    words |= dict.fromkeys(_people(), "[user]")
    words |= dict.fromkeys(_serials(root), "[serial]")
    words |= dict.fromkeys(_networks(root), "[network]")
    if home is not None:
        made = sorted(path.name for path in _folders(home / "characters"))
        words |= {name: f"[character-{number}]" for number, name in enumerate(made, 1)}
        spoken = sorted(path.stem for path in _files(home / "voices"))
        words |= {name: f"[voice-{number}]" for number, name in enumerate(spoken, 1)}
    return words


def _host_names(root: Path) -> Iterable[str]:
    full = socket.gethostname()
    names = {full, full.partition(".")[0], _text(root / "etc/hostname")}
    for line in _text(root / "etc/hosts").splitlines():
        parts = line.partition("#")[0].split()
        if parts and parts[0].startswith("127.0.1."):
            names.update(parts[1:])
    return filter(None, names)


def _people() -> Iterable[str]:
    for entry in pwd.getpwall():
        if 1000 <= entry.pw_uid < 60000:
            yield entry.pw_name
            yield entry.pw_gecos.partition(",")[0]


def _serials(root: Path) -> Iterable[str]:
    places = (
        "sys/bus/usb/devices/*/serial", "sys/class/dmi/id/*serial", "sys/class/dmi/id/*uuid",
        "proc/device-tree/serial-number", "sys/block/*/device/serial", "sys/block/*/device/cid",
        "etc/machine-id", "sys/class/net/*/address",
    )  # fmt: skip
    for place in places:
        for path in root.glob(place):
            text = _text(path).strip("\0 \n")
            if len(text) >= 5:
                yield text


def _networks(root: Path) -> Iterable[str]:
    """Names and keys of wireless networks that this machine knows."""
    places = ("etc/NetworkManager/system-connections/*", "etc/wpa_supplicant/*.conf",
              "var/lib/iwd/*", "etc/netplan/*.yaml")  # fmt: skip
    for place in places:
        for path in root.glob(place):
            yield path.stem
            for hit in re.finditer(
                r"(?im)^\s*\"?(?:ssid|psk|password|passphrase)\"?\s*[=:]\s*\"?([^\"\n]+?)\"?\s*$",
                _text(path),
            ):
                yield hit.group(1)


def _text(path: Path) -> str:
    try:
        return path.read_text("utf-8", errors="replace").strip()
    except OSError:
        return ""


def _folders(folder: Path) -> list[Path]:
    try:
        return [path for path in folder.iterdir() if path.is_dir()]
    except OSError:
        return []


def _files(folder: Path) -> list[Path]:
    try:
        return [path for path in folder.iterdir() if path.is_file()]
    except OSError:
        return []
