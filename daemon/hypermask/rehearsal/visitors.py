"""Visitors hand in photographs while the show runs; when does their light leave the projector?"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from hypermask.errors import ConfigError, DataError
from hypermask.face.character import check_name
from hypermask.stage.renderer import DrawItem
from hypermask.workers.orders import Order, place
from hypermask_sim.scenario import Scenario

SHELF = "characters"


def check_photos(scenario: Scenario, has_faces: bool) -> None:
    """Raises `DataError` PHOTO-ABSENT, `UsageError` CHAR-NAME, `ConfigError` CFG-VALUE in a show of
    test dots."""
    for _, photo, name in scenario.performer.photos:
        check_name(name)
        if not has_faces:
            raise ConfigError(
                "CFG-VALUE", "the test dots take no photographs", "Choose another character."
            )
        if not Path(photo).exists():
            raise DataError("PHOTO-ABSENT", f"there is no {photo}", "Correct performer.photos.")


class Visitors:
    """Places the scenario's orders when their time has come."""

    def __init__(self, scenario: Scenario, orders: Path, origin_s: float) -> None:
        self._waiting = sorted(scenario.performer.photos)
        self._orders, self._origin_s = orders, origin_s

    def step(self, now_s: float) -> None:
        while self._waiting and self._origin_s + self._waiting[0][0] <= now_s:
            time_s, photo, name = self._waiting.pop(0)
            ordered_s = max(self._origin_s + time_s, 0.0)
            place(self._orders, Order(name=name, photo=photo, ordered_s=ordered_s))


class Arrivals:
    """The first light of every character that came during the show."""

    def __init__(self, scenario: Scenario) -> None:
        self._photos = scenario.performer.photos
        self._first_s: dict[str, float] = {}
        self._whole_s: dict[str, float] = {}

    def look(self, items: tuple[DrawItem, ...], light_s: float) -> None:
        """items: what the frame of this light shows."""
        for item in items if self._photos else ():
            if item.opacity > 0:
                self._first_s.setdefault(item.key, light_s)
            if item.opacity >= 1:
                self._whole_s.setdefault(item.key, light_s)

    def report(self, origin_s: float) -> list[dict[str, Any]]:
        return [self._one(time_s, photo, name, origin_s) for time_s, photo, name in self._photos]

    def _one(self, time_s: float, photo: str, name: str, origin_s: float) -> dict[str, Any]:
        first_s, whole_s = self._first_s.get(name), self._whole_s.get(name)
        return {
            "name": name,
            "photo": Path(photo).name,
            "ordered_s": time_s,
            "photo_to_light_s": _since(first_s, origin_s + time_s),
            "photo_to_alone_s": _since(whole_s, origin_s + time_s),
        }


def _since(light_s: float | None, ordered_s: float) -> float | None:
    return None if light_s is None else round(light_s - ordered_s, 6)


def keep_characters(board: Path | None, out: Path) -> None:
    """What visitors left stays with the rehearsal's pictures."""
    if board is not None and (board / SHELF).is_dir():
        shutil.copytree(board / SHELF, out / SHELF, dirs_exist_ok=True)
