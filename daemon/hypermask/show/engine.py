"""The show engine: key presses become cues, cues change the scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hypermask.blackboard import Record
from hypermask.errors import UsageError
from hypermask.face.expressions import Expression
from hypermask.neck.record import beat, new_neck, order
from hypermask.show.expressions import expressions_of
from hypermask.show.scene import (
    CHARACTERS,
    SCENE,
    brightness_at,
    characters_at,
    show_expression,
)
from hypermask.show.showfile import Cue, Life, ShowFile


@dataclass(frozen=True)
class CueCalled:
    """A cue that took effect at `time_s`."""

    time_s: float
    cue: str


class ShowEngine:
    """Holds the scene of a show; every change is a fade that starts from what is seen now.

    Raises `ConfigError` SHOW-EXPRESSION, EXPR-READ, CFG-* for a cue whose face cannot be made.
    """

    def __init__(self, show: ShowFile, time_s: float) -> None:
        self._show = show
        self._faces = expressions_of(show)
        self._characters = list(show.characters)
        self._blackout = False
        self._wanted_brightness = show.brightness
        self._scene: Record = np.zeros((), SCENE)
        self._scene["characters"][0] = show.characters[0].encode()
        self._scene["opacity"][0] = 1.0
        self._scene["brightness"] = show.brightness
        self._scene["brightness_fade"] = (time_s, 0.0)
        self._scene["voice_intensity"] = show.voice_intensity
        self._live(show.life)
        self._neck = new_neck(time_s)

    @property
    def scene(self) -> Record:
        """The current scene record (dtype SCENE)."""
        return self._scene

    @property
    def blackout(self) -> bool:
        return self._blackout

    def press(self, key: str, time_s: float) -> CueCalled | None:
        """A key was pressed; keys without a cue do nothing."""
        cue = self._show.keys.get(key)
        return self.call(cue, time_s) if cue is not None else None

    def call(self, name: str, time_s: float) -> CueCalled:
        """Call a cue by its name. Raises `UsageError` CUE-NAME for an unknown one."""
        cue = self._show.cues.get(name)
        if cue is None:
            known = ", ".join(self._show.cues) or "none"
            raise UsageError("CUE-NAME", f"this show has no cue '{name}'", f"Known: {known}.")
        face = self._faces.get(name)
        if face is not None:
            self._fade_expression(face, cue, time_s)
        self.perform(cue, time_s)
        return CueCalled(time_s, name)

    def perform(self, cue: Cue, time_s: float) -> None:
        """A cue of nobody's list: all that it asks for but the face's expression.

        Raises `UsageError` CHAR-SHOW for a character that does not play in this show.
        """
        if cue.character not in (None, "next", "previous", *self._characters):
            known = ", ".join(self._characters)
            raise UsageError(
                "CHAR-SHOW", f"'{cue.character}' does not play in this show", f"Known: {known}."
            )
        if cue.life is not None:
            self._live(cue.life)
        if cue.character is not None:
            self._fade_character(cue, time_s)
        self._change_light(cue, time_s)
        self._move_head(cue, time_s)

    def beat(self, time_s: float) -> Record:
        """The neck record (dtype NECK), which says that the show is there at `time_s`."""
        self._neck = beat(self._neck, time_s)
        return self._neck

    def resume(self, scene: Record, neck: Record) -> None:
        """Go on where a show that died left off."""
        self._scene, self._neck = scene.copy(), neck.copy()
        self._blackout = float(scene["brightness"]) == 0
        if not self._blackout:
            self._wanted_brightness = float(scene["brightness"])

    def after(self, neck: Record) -> None:
        """Begin anew, but so that the pan-tilt worker sees an order that it does not know."""
        self._neck["order"] = int(neck["order"]) + 1

    def adopt(self, show: ShowFile) -> tuple[str, ...]:
        """Take over cues, keys and characters of another show file; what is seen stays as it is.

        Returns the characters that were not in the show before. Raises as the constructor does;
        then nothing has changed.
        """
        faces = expressions_of(show)
        guests = [name for name in self._characters if name not in self._show.characters]
        new = tuple(name for name in show.characters if name not in self._characters)
        self._show, self._faces = show, faces
        kept = [name for name in guests if name not in show.characters]
        there = [*(name for name in show.characters if name not in new), *kept]
        self._characters = there or self._characters  # somebody must play until the new ones come
        self._scene["voice_intensity"] = show.voice_intensity
        return new

    def arrive(self, name: str, appear: bool, time_s: float) -> bool:
        """A character came while the show runs: it takes its turn after the others, or with
        `appear` the stage at once. False when this show takes no guests."""
        invited = self._show.guests or name in self._show.characters
        if not invited and name not in self._characters:
            return False
        if name not in self._characters:
            self._characters.append(name)
        if appear:
            self._cross_fade(name, self._show.fades.character_s, time_s)
        return True

    def _fade_expression(self, face: Expression, cue: Cue, time_s: float) -> None:
        default = self._show.fades.expression_s
        if isinstance(cue.expression, str):
            default = float(face.times[0]) or default
        show_expression(self._scene, face, _or(cue.fade_s, default), time_s)

    def _live(self, life: Life) -> None:
        for name in type(life).model_fields:
            self._scene["life"][name] = getattr(life, name)

    def _fade_character(self, cue: Cue, time_s: float) -> None:
        wanted = self._character(str(cue.character), self._current)
        self._cross_fade(wanted, _or(cue.fade_s, self._show.fades.character_s), time_s)

    def _move_head(self, cue: Cue, time_s: float) -> None:
        if cue.gesture is None and cue.look is None:
            return
        look = None if cue.look is None else (math.radians(cue.look[0]), math.radians(cue.look[1]))
        self._neck = order(self._neck, time_s, cue.gesture or "look", look)

    @property
    def current(self) -> str:
        """The character that plays, or comes."""
        return self._current

    @property
    def neck(self) -> Record:
        """What the head is told (dtype NECK)."""
        return self._neck

    @property
    def show(self) -> ShowFile:
        return self._show

    @property
    def characters(self) -> tuple[str, ...]:
        """Those of the show file, then those who came while it runs."""
        return tuple(self._characters)

    @property
    def _current(self) -> str:
        name: bytes = self._scene["characters"][int(np.argmax(self._scene["opacity"]))]
        return name.decode()

    def _cross_fade(self, wanted: str, fade_s: float, time_s: float) -> None:
        if wanted == self._current:
            return
        seen = dict(characters_at(self._scene, time_s))
        # There is room for the wanted one and the most visible others.
        kept = sorted((name for name in seen if name != wanted), key=lambda name: -seen[name])
        names = [wanted, *kept[: CHARACTERS - 1]]
        total = sum(seen.get(name, 0.0) for name in names)
        for index in range(CHARACTERS):
            name = names[index] if index < len(names) else ""
            self._scene["characters"][index] = name.encode()
            self._scene["previous_opacity"][index] = seen.get(name, 0.0) / total
            self._scene["opacity"][index] = float(name == wanted)
        self._scene["character_fade"] = (time_s, fade_s)

    def _character(self, wanted: str, current: str) -> str:
        names = self._characters
        step = {"next": 1, "previous": -1}.get(wanted)
        if step is None:
            return wanted
        if current not in names:  # it left the show file while it played
            return names[0]
        return names[(names.index(current) + step) % len(names)]

    def _change_light(self, cue: Cue, time_s: float) -> None:
        if cue.brightness is not None:
            self._wanted_brightness = cue.brightness
        if cue.brightness_step is not None:
            # Never quite 0: only a blackout makes the stage dark, so that it can be seen as one.
            stepped = self._wanted_brightness + cue.brightness_step
            self._wanted_brightness = float(np.clip(stepped, 0.1, 1.0))
        if cue.blackout is not None:
            self._blackout = {"on": True, "off": False}.get(cue.blackout, not self._blackout)
        target = 0.0 if self._blackout else self._wanted_brightness
        if target == float(self._scene["brightness"]):
            return
        fades = self._show.fades
        default = fades.blackout_s if cue.blackout is not None else fades.brightness_s
        self._scene["previous_brightness"] = brightness_at(self._scene, time_s)
        self._scene["brightness"] = target
        self._scene["brightness_fade"] = (time_s, _or(cue.fade_s, default))


def _or(value: float | None, default: float) -> float:
    return default if value is None else value
