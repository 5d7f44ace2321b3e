"""The dresser: makes characters while the show runs, in a process of its own.

Everything heavy of a live swap is done here: landmarks, fit, texture, files, and the textures in
the form in which the GPU takes them. The stage only copies, see `workers.wings`.
"""

from __future__ import annotations

import contextlib
import time
from collections import deque
from pathlib import Path

import numpy as np

from hypermask.blackboard import Record
from hypermask.errors import HypermaskError, UsageError
from hypermask.face.character import Character, find_character, load_character
from hypermask.face.face import Face
from hypermask.mask import Mask
from hypermask.stage.costume import make_costume, write_costume
from hypermask.stage.settings import StageSettings
from hypermask.texture.build import build_character, warm_up
from hypermask.workers import orders
from hypermask.workers.board import KEPT, WARDROBE, Board
from hypermask.workers.costumes import WORN
from hypermask.workers.retry import Report
from hypermask_drivers.clock import Clock

_SLOTS = len(np.zeros((), WARDROBE)["costumes"])


class Dresser:
    """Takes orders; writes costumes into the board's folder and `Board.wardrobe`."""

    def __init__(
        self,
        board: Board,
        shelf: Path,
        mask: Mask,
        clock: Clock,
        report: Report,
        settings: StageSettings | None = None,
        charge_s: float | None = None,
    ) -> None:
        """shelf: where new characters are saved; charge_s: what an order takes on a virtual
        clock, instead of the time that it took."""
        assert board.folder is not None
        self._board, self._folder, self._shelf = board, board.folder, shelf
        self.orders = self._folder / orders.ORDERS
        self.orders.mkdir(parents=True, exist_ok=True)
        self._mask, self._clock, self._report = mask, clock, report
        self._gamma = (settings or StageSettings()).projector_gamma
        self._charge_s = charge_s
        self._made: tuple[float, Record] | None = None
        self.compute_s: deque[float] = deque(maxlen=KEPT)

    def prepare(self) -> None:
        """Load all that an order needs, so that the first one is as quick as the others."""
        with contextlib.suppress(HypermaskError):  # said when somebody orders
            warm_up()

    def step(self) -> bool:
        """Do one order if there is one; False when there was none."""
        if self._made is not None:
            return self._publish()
        found = orders.oldest(self.orders)
        if found is None:
            return False
        number, order = found
        began = time.perf_counter()
        try:
            character = self._character(order)
            self._sew(order, character)
            orders.answer(self.orders, number, {"name": character.name})
        except HypermaskError as error:
            self._report(self._clock.now(), error.code, str(error))
            result = {"error": error.code, "what": error.what, "remedy": error.remedy}
            with contextlib.suppress(HypermaskError):  # a full disk was reported just now
                orders.answer(self.orders, number, result)
        self.compute_s.append(time.perf_counter() - began)
        self._publish()
        return True

    def _character(self, order: orders.Order) -> Character:
        if (order.photo is None) == (order.character is None):
            raise UsageError(
                "ORDER-READ", "an order names either a photo or a character", "Order again."
            )
        if order.photo is not None:
            photo, size = Path(order.photo), order.size
            return build_character(photo, order.name, self._shelf, size=size, source=order.source)
        return load_character(find_character(str(order.character)))

    def _sew(self, order: orders.Order, character: Character) -> None:
        layers = Face(character, self._mask).actor.layers
        record = self._board.wardrobe.latest()
        record = np.zeros((), WARDROBE) if record is None else record.copy()
        version = int(record["latest"]) + 1
        file = f"costume-{version}"
        write_costume(make_costume(layers, self._gamma, WORN), self._folder / file)
        slot = version % _SLOTS
        worn_out = record["costumes"][slot]["file"].decode()
        record["latest"] = version
        entry = (version, order.name.encode(), file.encode(), order.appear, order.ordered_s)
        record["costumes"][slot] = entry
        ready_s = self._clock.now() if self._charge_s is None else order.ordered_s + self._charge_s
        self._made = ready_s, record
        if worn_out:
            (self._folder / worn_out).unlink(missing_ok=True)

    def _publish(self) -> bool:
        if self._made is None or self._clock.now() < self._made[0]:
            return False
        self._board.wardrobe.publish(self._made[1])
        self._made = None
        return True
