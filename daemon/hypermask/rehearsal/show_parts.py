"""The show's own parts for a rehearsal: which characters play, in which show."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hypermask import paths
from hypermask.face.character import find_character, load_character
from hypermask.show.expressions import expressions_of
from hypermask.show.showfile import ShowFile, load_show
from hypermask.workers.cast import DOTS
from hypermask_sim.scenario import Scenario


@dataclass(frozen=True)
class Casting:
    """show: the show file with the scenario's character first; sources: name -> where it is."""

    show: ShowFile
    sources: dict[str, str]


def casting_of(scenario: Scenario) -> Casting:
    """Who plays. `character = "dots"` is the judge's test picture alone; any other character
    takes the first place in the show's list. Raises CFG-*, SHOW-*, CHAR-ABSENT.
    """
    default = paths.configs() / "shows" / "default.toml"
    path = Path(scenario.show) if scenario.show else default
    show = load_show(path)
    expressions_of(show, str(path))
    if scenario.character == DOTS:
        return Casting(_only(show, DOTS), {DOTS: DOTS})
    name = load_character(find_character(scenario.character)).name
    names = (name, *(other for other in show.characters if other != name))
    sources = {other: other for other in names} | {name: scenario.character}
    return Casting(show.model_copy(update={"characters": names}), sources)


def _only(show: ShowFile, name: str) -> ShowFile:
    """The show with one character: cues that call another one change nothing."""
    cues = {
        key: cue.model_copy(update={"character": None if cue.character is None else name})
        for key, cue in show.cues.items()
    }
    return show.model_copy(update={"characters": (name,), "cues": cues})
