"""What the control socket's requests mean: cues, light, characters, the head, modes, devices.

{"do": "cue", "name": "wink"}                   {"do": "blackout", "to": "on" | "off" | "toggle"}
{"do": "press", "key": "5"}                     {"do": "brightness", "level": 0.8}
{"do": "character", "name": "noh"}              {"do": "gesture", "name": "nod", "look": [20, 0]}
{"do": "mode", "action": "begin", "name": "calibrate"}         also "cancel", "press" with a "key"
{"do": "devices", "action": "list" | "probe" | "test", "kind": "lamp"}
{"do": "status"}   {"do": "cues"}   {"do": "reload"}
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from typing import Any, Literal, Protocol, TypeVar

from pydantic import Field

from hypermask.config import Settings, parse
from hypermask.errors import UsageError
from hypermask.show.engine import ShowEngine
from hypermask.show.scene import brightness_at, characters_at, describe
from hypermask.show.showfile import KEY_NAMES, Cue
from hypermask.workers.modes import ModeKeeper

Table = dict[str, Any]
Request = TypeVar("Request", bound=Settings)


class _CueRequest(Settings):
    do: str
    name: str


class _Blackout(Settings):
    do: str
    to: Literal["on", "off", "toggle"] = "toggle"


class _Press(Settings):
    do: str
    key: str


class _Brightness(Settings):
    do: str
    level: float = Field(ge=0.1, le=1)
    """As with the keypad, only a blackout makes the stage dark."""


class _Character(Settings):
    do: str
    name: str


class _Gesture(Settings):
    do: str
    name: Literal["look", "nod", "shake", "park"]
    look: tuple[float, float] | None = None


class _Mode(Settings):
    do: str
    action: Literal["begin", "cancel", "press"]
    name: str | None = None
    key: str | None = None


class _Devices(Settings):
    do: str
    action: Literal["list", "probe", "test"] = "list"
    kind: str | None = None


class _Plain(Settings):
    do: str


class Desk(Protocol):
    """The show worker as a request sees it."""

    @property
    def engine(self) -> ShowEngine: ...
    @property
    def keeper(self) -> ModeKeeper: ...
    def take(self, key: str, now_s: float) -> str | None:
        """A key is pressed, by whoever; returns the cue that it called."""

    def changed(self, now_s: float, code: str, text: str) -> None:
        """Publish scene and neck, and write down why."""

    def welcome(self, name: str) -> str:
        """A character that does not play yet is sent for; says so. Raises CHAR-*."""

    def reload(self, now_s: float) -> str: ...
    def device(self, action: str, kind: str | None, now_s: float) -> Table: ...


class Commands:
    """Carries requests out at a desk."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._known: dict[str, Callable[[Table, float], Table]] = {
            "cue": self._cue,
            "cues": self._cues,
            "blackout": self._blackout,
            "press": self._press,
            "mode": self._mode,
            "brightness": self._brightness,
            "gesture": self._gesture,
            "character": self._character,
            "status": self._status,
            "devices": self._devices,
            "reload": self._reload,
        }

    def carry_out(self, request: Table, now_s: float) -> Table:
        """The answer. Raises `UsageError` CTL-DO, CFG-*, and what the request's subject raises."""
        do = request.get("do")
        if not isinstance(do, str) or do not in self._known:
            near = difflib.get_close_matches(str(do)[:40], self._known, n=1)
            hint = f"Did you mean '{near[0]}'?" if near else f"Known: {', '.join(self._known)}."
            raise UsageError("CTL-DO", f"there is no request {str(do)[:40]!r}", hint)
        return self._known[do](request, now_s)

    def _cue(self, request: Table, now_s: float) -> Table:
        name = _read(_CueRequest, request).name
        self._desk.engine.call(name, now_s)
        self._desk.changed(now_s, "CUE", f"Control: {name}")
        return {"text": f"The cue '{name}' is called."}

    def _cues(self, request: Table, now_s: float) -> Table:
        _read(_Plain, request)
        show = self._desk.engine.show
        keys = {cue: key for key, cue in show.keys.items()}
        return {
            "show": show.name,
            "cues": [{"name": name, "key": keys.get(name)} for name in show.cues],
            "characters": list(self._desk.engine.characters),
        }

    def _perform(self, cue: Cue, now_s: float, text: str) -> Table:
        self._desk.engine.perform(cue, now_s)
        self._desk.changed(now_s, "CUE", f"Control: {text}")
        return {"text": text}

    def _blackout(self, request: Table, now_s: float) -> Table:
        to = _read(_Blackout, request).to
        engine = self._desk.engine
        dark = (not engine.blackout) if to == "toggle" else to == "on"
        text = "The stage is dark." if dark else "The stage is lit."
        return self._perform(Cue(blackout=to), now_s, text) | {"blackout": dark}

    def _brightness(self, request: Table, now_s: float) -> Table:
        level = _read(_Brightness, request).level
        return self._perform(Cue(brightness=level), now_s, f"The light goes to {level:.0%}.")

    def _gesture(self, request: Table, now_s: float) -> Table:
        wanted = _read(_Gesture, request)
        if wanted.name == "look" and wanted.look is None:
            raise UsageError("CTL-VALUE", "'look' says not where to", "Give pan and tilt.")
        gesture = None if wanted.name == "look" else wanted.name
        cue = parse(Cue, {"gesture": gesture, "look": wanted.look}, "gesture")
        return self._perform(cue, now_s, f"The head is told: {wanted.name}.")

    def _character(self, request: Table, now_s: float) -> Table:
        name = _read(_Character, request).name
        known = (*self._desk.engine.characters, "next", "previous")
        if name not in known:
            return {"text": self._desk.welcome(name)}
        return self._perform(Cue(character=name), now_s, f"The character '{name}' comes.")

    def _press(self, request: Table, now_s: float) -> Table:
        key = _key(_read(_Press, request).key)
        cue = self._desk.take(key, now_s)
        return {"text": f"The key '{key}' is pressed.", "cue": cue}

    def _mode(self, request: Table, now_s: float) -> Table:
        wanted, keeper = _read(_Mode, request), self._desk.keeper
        if wanted.action == "begin":
            keeper.begin(_given(wanted.name, "name"), now_s)
        elif wanted.action == "cancel":
            keeper.cancel(now_s)
        else:
            key = _key(_given(wanted.key, "key"))
            if not keeper.active:
                raise UsageError("MODE-NONE", "no mode is on", "Begin one first.")
            keeper.press(key, now_s)
        return self._words()

    def _words(self) -> Table:
        keeper = self._desk.keeper
        return {"mode": keeper.active, "words": keeper.words}

    def _status(self, request: Table, now_s: float) -> Table:
        _read(_Plain, request)
        engine = self._desk.engine
        return {
            "show": engine.show.name,
            "scene": describe(engine.scene, now_s),
            "characters": [name for name, _ in characters_at(engine.scene, now_s)],
            "brightness": round(brightness_at(engine.scene, now_s), 3),
            "blackout": engine.blackout,
            "modes": list(self._desk.keeper.names),
            **self._words(),
        }

    def _devices(self, request: Table, now_s: float) -> Table:
        wanted = _read(_Devices, request)
        kind = None if wanted.action == "list" else _given(wanted.kind, "kind")
        return self._desk.device(wanted.action, kind, now_s)

    def _reload(self, request: Table, now_s: float) -> Table:
        _read(_Plain, request)
        return {"text": self._desk.reload(now_s)}


def _read(model: type[Request], request: Table) -> Request:
    return parse(model, request, f"request '{request['do']}'")


def _given(value: str | None, key: str) -> str:
    if not value:
        raise UsageError("CTL-VALUE", f"the request needs '{key}'", "Give it.")
    return value


def _key(key: str) -> str:
    if key not in KEY_NAMES:
        raise UsageError(
            "KEY-NAME", f"there is no key '{key[:40]}'", f"Keys: {', '.join(KEY_NAMES)}."
        )
    return key
